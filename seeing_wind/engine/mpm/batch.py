"""Simulation of many copies of one body at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import UsageError
from ..progress import Journal, NoProgress, Progress
from .copies import Copies
from .kernels.copies_forward import CODE
from .kernels.substep import RUNNING
from .model import Model
from .state import State, Trajectory


@dataclass(frozen=True)
class BatchRollout:
    """The result of `rollout_batch`."""

    paths: list[Trajectory]
    """The B copies' trajectories; NaN from the end of the frame in which a copy failed."""
    failed_frame: np.ndarray
    """(B,) int: the frame in which a copy failed, -1 for none."""

    @property
    def failed(self) -> np.ndarray:
        """(B,) bool: whether a copy failed."""
        return self.failed_frame >= 0

    @property
    def x(self) -> np.ndarray:
        """(B, T+1, N, 3) [m]."""
        return np.stack([path.x for path in self.paths])


def rollout_batch(
    model: Model,
    start: State,
    phi: np.ndarray,
    dphi: np.ndarray,
    coefficients: np.ndarray,
    *,
    v0: np.ndarray | None = None,
    C0: np.ndarray | None = None,
    strict: bool = False,
    progress: Progress = NoProgress(),
    journal: Journal = Journal(),
) -> BatchRollout:
    """Simulate B independent copies of one body over T frames, in parallel threads.

    In frame t, copy b has the acceleration a_p = sum_j phi[p, j] coefficients[b, t, j], with the gradient (sum_j c_j dphi_j/dX) F^-1, where
    F is that at the frame's start.

    Args:
        phi: (N, P) basis at the particles' rest positions.
        dphi: (N, P, 3) its gradient with respect to rest positions [1/m].
        coefficients: (B, T, P, 3) [m/s²].
        v0: (B, N, 3) velocities [m/s] with which the copies start, instead of those of `start`.
        C0: (B, N, 3, 3) affine velocities [1/s], likewise.
        strict: raise when any copy fails, instead of marking it as failed.
        journal: keeps the frames done so far.

    Raises:
        SimulationError: with `strict`, as `rollout`.
        UsageError: for arrays that do not fit the model.
    """
    count = model.particles
    if phi.ndim != 2 or phi.shape[0] != count or dphi.shape != (*phi.shape, 3) or coefficients.shape[2:] != (phi.shape[1], 3):
        raise UsageError(
            f"The basis has shapes {phi.shape} and {dphi.shape}, its coefficients {coefficients.shape}.",
            f"Give ({count}, P), ({count}, P, 3) and (B, T, P, 3).",
        )
    if model.axes is not None:
        A = model.axes
        v0, C0 = None if v0 is None else v0 @ A, None if C0 is None else A.T @ C0 @ A
        found = rollout_batch(
            model.upright(), start.turned(A), phi, dphi, coefficients @ A, v0=v0, C0=C0, strict=strict, progress=progress, journal=journal
        )
        return BatchRollout([path.turned(A.T) for path in found.paths], found.failed_frame)
    copies = len(coefficients)
    begun = (start.x, start.v if v0 is None else v0, start.C if C0 is None else C0, start.F)
    x, v, C, F = (np.array(np.broadcast_to(one, (copies, *one.shape[-rank:])), float, order="C") for one, rank in zip(begun, (2, 2, 3, 3)))
    return _frames(Copies(model, phi, dphi, x, v, C, F), coefficients, strict, progress, journal)


def _frames(body: Copies, coefficients: np.ndarray, strict: bool, progress: Progress, journal: Journal) -> BatchRollout:
    """Advance the copies through all frames."""
    copies, frames = coefficients.shape[:2]
    now = {"x": body.x, "v": body.v, "C": body.C, "F": body.F}
    states = {name: np.full((copies, frames + 1, *array.shape[1:]), np.nan) for name, array in now.items()}
    substeps, failed_frame = np.zeros((copies, frames), np.int64), np.full(copies, -1)
    for name, array in now.items():
        states[name][:, 0] = array
    loop = journal.loop("frames", coefficients)
    done, kept = loop.resume()
    if done:
        states, substeps, failed_frame = {name: kept[name] for name in now}, kept["substeps"], kept["failed_frame"]
        for name, array in now.items():
            array[:] = states[name][:, done]
    for t in range(done, frames):
        going = np.flatnonzero(failed_frame < 0)
        if not len(going):
            break
        substeps[going, t], status = body.advance(going, coefficients[going, t], t, progress)
        broken = status[:, CODE] != RUNNING
        if strict and broken.any():
            first = int(np.flatnonzero(broken)[0])
            raise body.failure(int(going[first]), status[first], t, int(substeps[going[first], t]))
        failed_frame[going[broken]] = t
        for name, array in now.items():
            states[name][going[~broken], t + 1] = array[going[~broken]]
        loop.reached(t + 1, lambda: {**states, "substeps": substeps, "failed_frame": failed_frame})
    # The arrays are copied, so that a path that is kept does not keep the memory of all.
    paths = [Trajectory(**{name: array[b].copy() for name, array in states.items()}, substeps=substeps[b]) for b in range(copies)]
    return BatchRollout(paths, failed_frame)
