"""The engine is asked for the field of a take at the places that the scene needs."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...engine.systems import alive
from ...engine.take import Take
from ..field.lattice import fine_lattice, lattice
from ..job import worker
from ..job.take_reading import field_summary, trajectory
from ..job.worker_command import command, environment

CACHES = ("blender_points.*npy", "blender_samples.*npz")
"""Names of the files between a Blender and its worker: each Blender has its own, with its process's number in the name."""
ARROWS = 7
"""Arrows that stand along the longest side of the field's box."""
RIDING = 64
"""Arrows that ride on the recovered object, at most: more of them hide it."""


@dataclass(frozen=True)
class Places:
    """Where the field is asked for. The three groups go to the worker as one array, in this order."""

    nodes: np.ndarray
    """(L, 3) a lattice over the field's box [m]."""
    arrows: np.ndarray
    """(M, 3) a coarser one, on which arrows stand [m]."""
    riding: np.ndarray
    """(T, R, 3) on the moving object [m]; R may be 0."""

    def rows(self) -> np.ndarray:
        """(T, L + M + R, 3), one row per frame, as the worker's `sample` takes them."""
        still = np.concatenate([self.nodes, self.arrows])
        return np.concatenate([np.broadcast_to(still, (len(self.riding), *still.shape)), self.riding], axis=1)

    def split(self, samples: np.ndarray) -> list[np.ndarray]:
        """Samples (T, L + M + R, ...) -> one array per group."""
        return np.split(samples, [len(self.nodes), len(self.nodes) + len(self.arrows)], axis=1)


def places(take: Take) -> Places:
    """Where to sample the field of a take.

    Raises:
        TakeError: when the take has no report.
    """
    field = field_summary(take)
    x = trajectory(take, field)[: field.frames]
    return Places(fine_lattice(field.box), lattice(field.box, ARROWS), x[:, :: max(1, -(-x.shape[1] // RIDING))])


def sampling(python: str, folder: Path) -> worker.Messages:
    """Ask the engine for the field of a take at the places that the scene needs, as a job; `build` reads its answer."""
    take = Take(folder)
    _clear_caches(take)
    points, samples = (take.file(name) for name in own_caches())
    with take.writing(points.name) as aside:
        np.save(aside, places(take).rows())
    options = (str(folder), "--points", str(points), "--out", str(samples))
    return (yield from worker.run(command(python, "sample", *options), cwd=str(folder), env=environment()))


def own_caches() -> tuple[str, str]:
    """Points asked for and samples answered: two Blenders that show one take do not read each other's."""
    points, samples = (name.replace("*", f"{os.getpid()}.") for name in CACHES)
    return points, samples


def _clear_caches(take: Take) -> None:
    """Remove those that Blenders have left which are closed by now."""
    for path in [path for pattern in CACHES for path in take.path.glob(pattern)]:
        number = path.name.split(".")[1]
        if not (number.isdecimal() and alive(int(number))):
            with contextlib.suppress(OSError):
                path.unlink()
