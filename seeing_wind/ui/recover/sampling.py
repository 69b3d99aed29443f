"""Ask the engine for the field of a take at the points that the scene needs, and read its answer."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...engine.errors import TakeError
from ...engine.systems import alive
from ...engine.take import Take, stamp_of
from ..field.lattice import SampledField, fine_lattice, lattice
from ..job import takes, worker
from ..job.take_reading import field_summary, trajectory
from ..job.worker_command import command, environment

CACHES = ("blender_points.*npy", "blender_samples.*npz")
"""Files exchanged between Blender and its worker; the process ID in the name gives each Blender its own."""
ARROWS = 7
"""Number of fixed arrows along the longest side of the field's box."""
RIDING = 64
"""Largest number of arrows that move with the recovered object: more would hide it."""


@dataclass(frozen=True)
class Places:
    """Points at which the field is sampled. The worker gets the three groups as one array, in this order."""

    nodes: np.ndarray
    """(L, 3) lattice over the field's box [m]."""
    arrows: np.ndarray
    """(M, 3) coarser lattice, for the fixed arrows [m]."""
    riding: np.ndarray
    """(T, R, 3) points on the moving object [m]; R may be 0."""

    def rows(self) -> np.ndarray:
        """(T, L + M + R, 3), one row per frame, as the worker's `sample` takes them."""
        still = np.concatenate([self.nodes, self.arrows])
        return np.concatenate([np.broadcast_to(still, (len(self.riding), *still.shape)), self.riding], axis=1)

    def split(self, samples: np.ndarray) -> list[np.ndarray]:
        """Samples (T, L + M + R, ...) -> one array per group."""
        return np.split(samples, [len(self.nodes), len(self.nodes) + len(self.arrows)], axis=1)


@dataclass(frozen=True)
class Sampled:
    """The field at the points of `Places`."""

    nodes: SampledField
    arrows: np.ndarray
    """(T, M + R, 3) force density [N/m³] or wind velocity [m/s] at the arrows."""
    sure: np.ndarray
    """(T, M + R) confidence at the arrows, in 0..1."""
    away: np.ndarray
    """(T, M + R) distance of the arrows from the filmed object [m]."""


def places(take: Take) -> Places:
    """Where to sample the field of a take.

    Raises:
        TakeError: when the take has no report.
    """
    field = field_summary(take)
    x = trajectory(take, field)[: field.frames]
    return Places(fine_lattice(field.box), lattice(field.box, ARROWS), x[:, :: max(1, -(-x.shape[1] // RIDING))])


def sampling(python: str, folder: Path) -> worker.Messages:
    """A job that samples the field of a take at its `places`; `read_answer` reads the result."""
    take, home = Take(folder), _home(folder)
    _clear_caches(home)
    points, samples = (home.file(name) for name in own_caches())
    with home.writing(points.name) as aside:
        np.save(aside, places(take).rows())
    options = (str(folder), "--points", str(points), "--out", str(samples))
    return (yield from worker.run(command(python, "sample", *options), cwd=str(folder), env=environment()))


def read_answer(take: Take, where: Places, frames: int, wind: bool) -> Sampled:
    """Read the engine's answer to `sampling`; with `wind`, the arrows get the wind velocity instead of the force density.

    Raises:
        TakeError: when the answer does not fit this field or is not finite; with `wind`, also when it holds no wind.
    """
    samples, shape = _home(take.path).read_arrays(own_caches()[1]), (frames, where.rows().shape[1])
    if [np.shape(samples.get(name)) for name in ("force_density", "confidence", "distance")] != [(*shape, 3), shape, shape]:
        raise TakeError(f"The samples in {take.path} do not fit its field.", "Load the results again.")
    if not all(np.isfinite(samples[name]).all() for name in ("force_density", "confidence", "distance")):
        raise TakeError(f"The field in {take.path} is not finite everywhere.", "Run Recover again.")
    at_nodes, *at_arrows = where.split(samples["force_density"])
    sure_nodes, *sure_arrows = where.split(samples["confidence"])
    wind_at_nodes = None
    if wind:
        if np.shape(samples.get("wind_velocity")) != (*shape, 3) or not np.isfinite(samples["wind_velocity"]).all():
            raise TakeError(f"The samples in {take.path} hold no wind.", "Load the results again.")
        wind_at_nodes, *at_arrows = where.split(samples["wind_velocity"])
        _, *sure_arrows = where.split(samples["wind_confidence"])
    # for a wind that several takes share: the distance from the nearest of their objects
    away, *away_arrows = where.split(samples["wind_distance" if wind else "distance"])
    nodes = SampledField(where.nodes, at_nodes, sure_nodes, wind_at_nodes, away)
    return Sampled(nodes, *(np.concatenate(each, axis=1) for each in (at_arrows, sure_arrows, away_arrows)))


def _home(folder: Path) -> Take:
    """The folder of the files exchanged with the worker: the take's own, or a temporary one if the take is on a read-only medium or
    share. Loading writes nothing else."""
    try:
        takes.refuse_read_only(folder, "")
    except TakeError:
        return Take(takes.temporary() / f"samples-{stamp_of(str(folder))}")
    return Take(folder)


def own_caches() -> tuple[str, str]:
    """Names of this process's files of points and samples, so that two Blenders with the same take do not read each other's."""
    points, samples = (name.replace("*", f"{os.getpid()}.") for name in CACHES)
    return points, samples


def _clear_caches(home: Take) -> None:
    """Remove the files of Blender processes that have ended."""
    for path in [path for pattern in CACHES for path in home.path.glob(pattern)]:
        number = path.name.split(".")[1]
        if not (number.isdecimal() and alive(int(number))):
            with contextlib.suppress(OSError):
                path.unlink()
