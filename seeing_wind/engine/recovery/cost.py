"""An estimate, before a solve begins, of how long it will take on this machine: the expected work times the speed of the kernels.

    seconds = OTHER (copies * c + bases * b + changes * d)        each count in particles times substeps

A *copy* is one of several simulations run together; a *base* is a simulation that is kept and linearised so that tangents can be carried
along it; a *change* is one such tangent. c, b and d [s] are measured by a short run of the kernels and stored beside these. The counts are
estimated from the schedule of the solve (`solve.block`, `solve.first_field`, `solve.onward`) and from what a block usually needs (`Usual`).
Few clips need much more. But a body that strays and is sought again takes several times as long, and a force that needs a knot in every
frame up to twice as long. Neither can be foreseen; once a body has strayed, the estimate is made again with what that adds (`DENSELY`,
`FINELY`).

The estimate does not need the solver, so that a preview can state it, too.
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
from ..materials import PLASTIC_LAWS, Material, find
from ..mpm.courant import substeps_of
from ..progress import NoProgress
from ..records import Particles, PointTargets, TrackTargets
from ..settings import RecoverSettings
from .blocks import blocks, most_modes
from .prior.basis import SpatialBasis, spatial_basis
from .solve.constants import PACE

FILE = "solver_speed.json"

COLUMNS = 2.5
"""Columns carried in place of all changes (`mpm.body.columns`) per coefficient of a frame's force: 1.7 to 2.4 on development scenes."""

OTHER = 1.0
"""Duration of a solve, learning and linear algebra included, relative to the estimate for its simulations: 0.6 to 1.3 on development scenes
of free and held bodies, 90 to 120 frames."""


@dataclass(frozen=True)
class Speed:
    """Speed of the kernels: seconds per particle and substep."""

    copy: float
    base: float
    change: float


@dataclass(frozen=True)
class Usual:
    """What a block usually needs; chosen on the falling leaf, the potted plant, and rendered clips of a post, a plate and clay."""

    copies: float
    """Simulations of the whole block."""
    coarse: float
    """Jacobians with few modes and sparse knots."""
    fine: float
    """Jacobians with all modes and knots."""


FREE = Usual(copies=30.0, coarse=1.3, fine=1.8)
HELD = Usual(copies=50.0, coarse=2.5, fine=2.1)
FLOWING = Usual(copies=60.0, coarse=3.0, fine=3.0)
ONWARD = Usual(copies=8.0, coarse=0.0, fine=2.0)
"""A later block of a body that does not flow."""


DENSELY = Usual(copies=15.0, coarse=2.0, fine=1.0)
"""What a block needs in addition if a free body strays and is found with denser knots; chosen on two clips of a painted flower."""
FINELY = Usual(copies=60.0, coarse=0.0, fine=4.0)
"""What a block needs in addition if the body is followed again finely; chosen on a painted flower whose head is sheared."""


@dataclass(frozen=True)
class Work:
    """The expected work of a solve, in particles times substeps."""

    copies: float
    bases: float
    changes: float
    plastic: bool
    """Whether the body flows: such bodies have kernels of their own."""

    def seconds(self, speed: Speed) -> float:
        """Duration of the work [s] at the given speed of the kernels."""
        return OTHER * (self.copies * speed.copy + self.bases * speed.base + self.changes * speed.change)


def work_of(
    particles: Particles,
    material: Material,
    fps: float,
    frames: int,
    points: int,
    settings: RecoverSettings,
    densely: int = 0,
    finely: int = 0,
) -> Work | None:
    """The expected work of a solve; None for the paper's schedule, for which there is no estimate, and for a body that is held entirely.

    Args:
        frames: number of intervals T.
        points: number of points that are followed; a body that is seen as one point has a uniform force.
        densely, finely: numbers of blocks in which the body strays, and is found with denser knots or followed again finely.
    """
    if settings.schedule == "paper" or particles.pinned.all():
        return None
    plastic, held = material.law in PLASTIC_LAWS, bool(particles.pinned.any())
    basis = _modes(particles, points)
    few = int(np.count_nonzero(basis.degree <= 2))
    # How many modes a force requires is learnt from the clip; a force that bends a held body requires most of them.
    worth = round(math.sqrt(few * len(basis.degree))) if held else few
    each, cuts = float(len(particles.x) * substeps_of(particles, material, fps)), blocks(frames)
    work = np.zeros(3)
    for number, (begin, end) in enumerate(cuts):
        usual = FLOWING if plastic else HELD if held else FREE
        if not plastic and number and settings.iterations > 1:
            usual = ONWARD
        work += each * _block(usual, end - begin, 0 if number else 6, few, worth, settings.iterations)
    length, every = sum(end - begin for begin, end in cuts) / len(cuts), len(basis.degree)
    for times, usual in ((densely, DENSELY), (finely, FINELY)):
        work += times * each * _again(usual, length, few if usual is DENSELY else every, every, settings.iterations)
    copies, bases, changes = work.tolist()
    return Work(copies, bases, changes, plastic)


def _block(usual: Usual, frames: int, start: int, few: int, worth: int, iterations: int) -> np.ndarray:
    """(3,) copies, bases and changes of a block, each times frames of the fine model; `start`: number of unknowns of the initial motion."""
    ahead = frames / PACE.hop * PACE.horizon + PACE.first_horizon * PACE.first_horizon_steps
    work = _solves(usual, frames, start, (few, frames / 4.0 + 1.0), (worth, frames / PACE.knot + 1.0), iterations)
    return work + PACE.rough * np.array([0.0, ahead, ahead * (3 * min(few, 4) + start)])


def _again(usual: Usual, frames: float, few: int, every: int, iterations: int) -> np.ndarray:
    """(3,) as `_block`: what is added where a body strays; its force changes so fast that it gets a knot in every frame in the end."""
    return _solves(usual, frames, 0, (few, frames / PACE.knot + 1.0), (every, frames + 1.0), iterations)


def _solves(
    usual: Usual, frames: float, start: int, coarse: tuple[int, float], fine: tuple[int, float], iterations: int
) -> np.ndarray:
    """(3,) copies, bases and changes of the solves of a block, with so many modes and knots in the coarse and the fine ones.

    Derivatives are those of the rough model. A change costs nothing before its knot, and so counts for half of the frames on average; many
    changes are replaced by fewer columns.
    """
    often = min(usual.coarse, iterations), min(usual.fine, max(iterations - 1, 0))
    carried = sum(
        times * min(0.5 * (3 * modes * knots + start), COLUMNS * 3 * modes) for times, (modes, knots) in zip(often, (coarse, fine))
    )
    share = min(1.0, sum(often) / (usual.coarse + usual.fine))
    return frames * np.array([share * usual.copies, PACE.rough * sum(often), PACE.rough * carried])


def _modes(particles: Particles, points: int) -> SpatialBasis:
    most = max(1, min(most_modes(particles), points))
    return spatial_basis(particles.x, np.where(particles.pinned, 0.0, particles.volume), most)


def points_in(targets: PointTargets | list[TrackTargets]) -> int:
    """Number of points that are followed, in all views together."""
    return targets.visible.shape[1] if isinstance(targets, PointTargets) else sum(one.visible.shape[1] for one in targets)


def known_speed(plastic: bool) -> Speed | None:
    """The speed that was last measured on this machine; None if there is none."""
    try:
        kept = json.loads(_file().read_text(encoding="utf-8"))
        if kept["machine"] != _machine():
            return None
        speed = Speed(**kept[_kind(plastic)])
    except (OSError, ValueError, KeyError, TypeError):  # never measured, or the file is damaged
        return None
    return speed if all(isinstance(value, float) and 0.0 < value < np.inf for value in dataclasses.astuple(speed)) else None


def measure_speed(plastic: bool) -> Speed:
    """Measure the speed by a short run of the kernels, under a second once they are loaded, and store it for `known_speed` if possible."""
    speed = _measured(plastic)
    kept: dict[str, Any] = {"machine": _machine()}
    with contextlib.suppress(OSError, ValueError):
        before = json.loads(_file().read_text(encoding="utf-8"))
        kept |= before if isinstance(before, dict) and before.get("machine") == _machine() else {}
    kept[_kind(plastic)] = dataclasses.asdict(speed)
    with contextlib.suppress(OSError):  # if the folder cannot be written to, the speed is measured again next time
        _file().parent.mkdir(parents=True, exist_ok=True)
        handle, aside = tempfile.mkstemp(dir=_file().parent, prefix=FILE)
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            json.dump(kept, stream)
        systems.replace(aside, _file())
    return speed


def _file() -> Path:
    """The file of the measured speed: beside the compiled kernels if the environment names their folder, else in the engine's Python."""
    return Path(os.environ.get("TI_OFFLINE_CACHE_FILE_PATH") or sys.prefix) / FILE


def _machine() -> str:
    """A name for this machine, to distinguish it from others that share the folder."""
    return f"{platform.node()} {platform.machine()} {os.cpu_count()}"


def _kind(plastic: bool) -> str:
    return "plastic" if plastic else "elastic"


PROBED = (20, 15, 2)
"""Particles along each side of the block that is simulated for the measurement."""
SUBSTEPS, FRAMES, REPEATS = 24, 2, 3
FEW, MANY = 16, 256
"""Numbers of changes in the two measurements whose difference gives the cost of a change."""


def _measured(plastic: bool) -> Speed:
    """The median speed of a few runs, without the first one, which loads or compiles the kernels."""
    from ..mpm.batch import rollout_batch
    from ..mpm.model_for import model_for
    from ..mpm.state import State
    from ..mpm.tangent import Changes, tangents

    x = 0.01 * np.stack(np.meshgrid(*(np.arange(float(side)) for side in PROBED), indexing="ij"), axis=-1).reshape(-1, 3)
    count = len(x)
    body = Particles(x, np.full(count, 1e-6), np.zeros(count, bool), 0.01)
    stuff = dataclasses.replace(find("leaf"), youngs_modulus=2e4, law="von_mises" if plastic else "corotated", yield_stress=1e3)
    model = dataclasses.replace(model_for(body, stuff, 30.0)[0], substeps=SUBSTEPS)
    # Enough modes that no change is a mixture of others.
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
