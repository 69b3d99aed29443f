"""How long a solve takes on this machine, told before it begins: the work that is to be expected, times the speed of the kernels here.

    seconds = OTHER (copies * c + bases * b + changes * d)        each count in particles times substeps

A *copy* is one simulation among several, a *base* one that is kept and linearised so that changes can be carried along it, a *change*
one direction so carried; c, b and d [s] are measured by a short run of the kernels and kept beside them. How often the solve does each is
foreseen from its schedule (`solve.block`, `solve.first_field`, `solve.onward`), of which a usual clip takes the part that `Usual` says.
Few clips are far from it; a body that strays and is followed again takes several times as long, and a force that needs a knot in every
frame up to twice as long, and nobody knows before.

What is foreseen needs no solver, so that a preview can say it, too.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import systems
from ..materials import PLASTIC_LAWS, find
from ..mpm.courant import substeps_of
from ..progress import NoProgress
from ..records import Material, Particles, PointTargets, TrackTargets
from ..settings import RecoverSettings
from .blocks import blocks, most_modes
from .prior.basis import SpatialBasis, spatial_basis
from .solve.constants import PACE

FILE = "solver_speed.json"

COLUMNS = 2.5
"""That are carried for all changes (`mpm.body.columns`), for each coefficient of a frame's force: 1.7 to 2.4 on development scenes."""

OTHER = 1.0
"""What a solve takes, learning the prior's sizes and linear algebra too, in units of what is foreseen of its simulations: 0.6 to 1.3 on
development scenes of free and held bodies, 90 to 120 frames."""


@dataclass(frozen=True)
class Speed:
    """Of the kernels: seconds per particle and substep."""

    copy: float
    base: float
    change: float


@dataclass(frozen=True)
class Usual:
    """What a block usually takes; chosen on the falling leaf, the potted plant, and rendered clips of a post, a plate and clay."""

    copies: float
    """Simulations of the whole block."""
    coarse: float
    """Jacobians with few modes and sparse knots."""
    fine: float
    """Those with all."""


FREE = Usual(copies=30.0, coarse=1.3, fine=1.8)
HELD = Usual(copies=50.0, coarse=2.5, fine=2.1)
FLOWING = Usual(copies=60.0, coarse=3.0, fine=3.0)
ONWARD = Usual(copies=8.0, coarse=0.0, fine=2.0)
"""A later block of a body that does not flow."""


@dataclass(frozen=True)
class Work:
    """In particles times substeps."""

    copies: float
    bases: float
    changes: float
    plastic: bool
    """Bodies that flow have kernels of their own."""

    def seconds(self, speed: Speed) -> float:
        """At the speed of their kernels."""
        return OTHER * (self.copies * speed.copy + self.bases * speed.base + self.changes * speed.change)


def work_of(particles: Particles, material: Material, fps: float, frames: int, points: int, settings: RecoverSettings) -> Work | None:
    """What a solve is expected to take; None of the paper's schedule, of which nothing is known.

    Args:
        frames: T.
        points: that are followed; a body that is seen as one point has a uniform force.
    """
    if settings.schedule == "paper" or particles.pinned.all():
        return None
    plastic, held = material.law in PLASTIC_LAWS, bool(particles.pinned.any())
    basis = _modes(particles, points)
    few = int(np.count_nonzero(basis.degree <= 2))
    # How many modes a force is worth is learnt from the clip: one that bends a held body takes most of those that there are.
    worth = round(math.sqrt(few * len(basis.degree))) if held else few
    each = float(len(particles.x) * substeps_of(particles, material, fps))
    work = np.zeros(3)
    for number, (begin, end) in enumerate(blocks(frames)):
        usual = FLOWING if plastic else HELD if held else FREE
        if not plastic and number and settings.iterations > 1:
            usual = ONWARD
        work += each * _block(usual, end - begin, 0 if number else 6, few, worth, settings.iterations)
    copies, bases, changes = work.tolist()
    return Work(copies, bases, changes, plastic)


def _block(usual: Usual, frames: int, start: int, few: int, worth: int, iterations: int) -> np.ndarray:
    """(3,) copies, bases and changes times frames of the fine model; `start` unknowns are those of the initial motion.

    Derivatives are taken of the rough model. A change costs nothing before its knot, so half of the frames on average; and where there are
    many, fewer columns are carried in their place.
    """
    coarse, fine = min(usual.coarse, iterations), min(usual.fine, max(iterations - 1, 0))
    ahead = frames / PACE.hop * PACE.horizon + PACE.first_horizon * PACE.first_horizon_steps
    bases = ahead + frames * (coarse + fine)
    carried = sum(
        times * min(0.5 * (3 * modes * knots + start), COLUMNS * 3 * modes)
        for times, modes, knots in ((coarse, few, frames / 4.0 + 1.0), (fine, worth, frames / PACE.knot + 1.0))
    )
    changes = ahead * (3 * min(few, 4) + start) + frames * carried
    share = min(1.0, (coarse + fine) / (usual.coarse + usual.fine))
    return np.array([share * usual.copies * frames, PACE.rough * bases, PACE.rough * changes])


def _modes(particles: Particles, points: int) -> SpatialBasis:
    most = max(1, min(most_modes(particles), points))
    return spatial_basis(particles.x, np.where(particles.pinned, 0.0, particles.volume), most)


def points_in(targets: PointTargets | list[TrackTargets]) -> int:
    """That are followed, in all views."""
    return targets.visible.shape[1] if isinstance(targets, PointTargets) else sum(one.visible.shape[1] for one in targets)


def known_speed(plastic: bool) -> Speed | None:
    """What was measured last on this machine, if anything was."""
    try:
        kept = json.loads(_file().read_text(encoding="utf-8"))
        if kept["machine"] != _machine():
            return None
        speed = Speed(**kept[_kind(plastic)])
    except (OSError, ValueError, KeyError, TypeError):  # never measured, or damaged: then nothing is known
        return None
    return speed if all(isinstance(value, float) and 0.0 < value < np.inf for value in dataclasses.astuple(speed)) else None


def measure_speed(plastic: bool) -> Speed:
    """A short run of the kernels, under a second once they are loaded. Kept for `known_speed`, where the place can be written."""
    speed = _measured(plastic)
    kept: dict[str, Any] = {"machine": _machine()}
    with contextlib.suppress(OSError, ValueError):
        before = json.loads(_file().read_text(encoding="utf-8"))
        kept |= before if isinstance(before, dict) and before.get("machine") == _machine() else {}
    kept[_kind(plastic)] = dataclasses.asdict(speed)
    with contextlib.suppress(OSError):  # a place that nobody may write to: it is measured again next time
        _file().parent.mkdir(parents=True, exist_ok=True)
        handle, aside = tempfile.mkstemp(dir=_file().parent, prefix=FILE)
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            json.dump(kept, stream)
        systems.replace(aside, _file())
    return speed


def _file() -> Path:
    """Beside the compiled kernels, where the environment says where these are, else in the engine's own Python."""
    return Path(os.environ.get("TI_OFFLINE_CACHE_FILE_PATH") or sys.prefix) / FILE


def _machine() -> str:
    """Such as can be told from another that shares the folder."""
    return f"{platform.node()} {platform.machine()} {os.cpu_count()}"


def _kind(plastic: bool) -> str:
    return "plastic" if plastic else "elastic"


PROBED = (20, 15, 2)
"""Particles of the block that is simulated, along each side."""
SUBSTEPS, FRAMES, REPEATS = 24, 2, 3
FEW, MANY = 16, 256
"""Changes that are carried; what they differ by is the price of the changes."""


def _measured(plastic: bool) -> Speed:
    """The median of some runs; the first one loads or compiles the kernels."""
    from ..mpm.batch import rollout_batch
    from ..mpm.model_for import model_for
    from ..mpm.state import State
    from ..mpm.tangent import Changes, tangents

    x = 0.01 * np.stack(np.meshgrid(*(np.arange(float(side)) for side in PROBED), indexing="ij"), axis=-1).reshape(-1, 3)
    count = len(x)
    body = Particles(x, np.full(count, 1e-6), np.zeros(count, bool), 0.01)
    stuff = dataclasses.replace(find("leaf"), youngs_modulus=2e4, law="von_mises" if plastic else "corotated", yield_stress=1e3)
    model = dataclasses.replace(model_for(body, stuff, 30.0)[0], substeps=SUBSTEPS)
    # So many modes that no change is a mixture of others.
    modes = MANY // 6 + 1
    phi, slope, start = np.ones((count, modes)), np.zeros((count, modes, 3)), State.at_rest(x)

    def copies() -> None:
        rollout_batch(model, start, phi, slope, np.zeros((2, FRAMES, modes, 3)))

    def carried(changes: int) -> None:
        force = np.zeros((FRAMES, modes, 3))
        tangents(model, start, phi, slope, force, Changes(np.ones((changes, *force.shape))), NoProgress())

    runs = []
    for _ in range(1 + REPEATS):
        runs.append([_seconds(copies), _seconds(lambda: carried(FEW)), _seconds(lambda: carried(MANY))])
    pair, few, many = np.median(runs[1:], axis=0) / (count * SUBSTEPS * FRAMES)
    change = max(many - few, 0.01 * many) / (MANY - FEW)
    return Speed(float(pair / 2.0), float(max(few - FEW * change, 0.1 * few)), float(change))


def _seconds(work: Callable[[], None]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began
