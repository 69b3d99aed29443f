"""Frames of many copies at once, which leave a known trajectory one by one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import UsageError
from ..progress import Journal, NoProgress, Progress
from ..records import Attachment
from .copies import Copies, CopiesInTurn, conditioned
from .kernels import substep
from .model import Model
from .state import State, Trajectory


@dataclass(frozen=True)
class BatchRollout:
    """What `rollout_batch` found."""

    points: np.ndarray
    """(B, T+1, N, 3), or (B, T+1, K, 3) with an attachment [m]; NaN after the frame in which a copy failed."""
    failed_frame: np.ndarray
    """(B,) int: the frame in which the copy broke, -1 for none."""

    @property
    def failed(self) -> np.ndarray:
        """(B,) bool."""
        return self.failed_frame >= 0


def rollout_batch(
    model: Model,
    nominal: State | Trajectory,
    phi: np.ndarray,
    dphi: np.ndarray,
    coefficients: np.ndarray,
    *,
    start_frame: np.ndarray | None = None,
    v0: np.ndarray | None = None,
    C0: np.ndarray | None = None,
    attachment: Attachment | None = None,
    strict: bool = False,
    progress: Progress | None = None,
    journal: Journal = Journal(),
) -> BatchRollout:
    """Simulate B independent copies of one body over T frames, in parallel threads.

    Copy b feels a_p = sum_j phi[p, j] coefficients[b, t, j] with the gradient (sum_j c_j dphi_j/dX) F^-1, F at the frame's start.

    Args:
        nominal: the state in which all copies start; with `start_frame`, a trajectory of at least max(start_frame) + 1 pictures.
        phi: (N, P) basis at the particles' rest positions.
        dphi: (N, P, 3) its gradient with respect to rest positions [1/m].
        coefficients: (B, T, P, 3) [m/s²].
        start_frame: (B,) copy b leaves the nominal trajectory at this picture; earlier pictures are the nominal ones. None is 0.
        v0: (B, N, 3) velocities [m/s] with which the copies start instead of the nominal ones.
        C0: (B, N, 3, 3) affine velocities [1/s], likewise.
        attachment: return these K points instead of the N particles.
        strict: raise when any copy fails instead of marking it.
        journal: keeps how far the frames have come.

    Raises:
        SimulationError: with `strict`, as `rollout`.
        UsageError: for arrays that do not fit the model.
        Cancelled: when the user asked to stop.
    """
    progress = progress or NoProgress()
    path = nominal if isinstance(nominal, Trajectory) else Trajectory.of([nominal])
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
            model.upright(), path.turned(A), phi, dphi, coefficients @ A, start_frame=start_frame, v0=v0, C0=C0, attachment=attachment,
            strict=strict, progress=progress, journal=journal,
        )  # fmt: skip
        return BatchRollout(found.points @ A.T, found.failed_frame)
    copies, frames = coefficients.shape[:2]
    start = np.zeros(copies, int) if start_frame is None else np.asarray(start_frame, dtype=int)
    if start.max(initial=0) > path.frames:
        raise ValueError(f"start_frame {start.max()} lies beyond the nominal trajectory of {path.frames + 1} pictures")
    x, v, C, F = (np.array(array[start], dtype=np.float64) for array in (path.x, path.v, path.C, path.F))
    v = v if v0 is None else np.array(v0, dtype=np.float64)
    C = C if C0 is None else np.array(C0, dtype=np.float64)
    body = (CopiesInTurn if conditioned(model) else Copies)(model, x, v, C, F)
    phi, dphi = np.ascontiguousarray(phi, dtype=np.float64), np.ascontiguousarray(dphi, dtype=np.float64)
    follow = (lambda x: x) if attachment is None else attachment.follow
    rest = follow(path.x[: frames + 1])
    points = np.full((copies, frames + 1, *rest.shape[1:]), np.nan)
    for b in range(copies):
        points[b, : start[b] + 1] = rest[: start[b] + 1]
    failed_frame = np.full(copies, -1)
    state = {"x": body.x, "v": body.v, "C": body.C, "F": body.F, "points": points, "failed_frame": failed_frame}
    loop = journal.loop("frames", coefficients)
    done, kept = loop.resume()
    for name, values in kept.items():
        state[name][:] = values
    for t in range(done, frames):
        going = np.flatnonzero((start <= t) & (failed_frame < 0)).astype(np.int32)
        if not len(going):
            continue
        force = np.ascontiguousarray(coefficients[:, t], dtype=np.float64)
        gravity = np.array(np.broadcast_to(model.gravity_in(t), (count, 3)))
        substep.assemble_force(phi, dphi, gravity, going, force, body.F, body.acceleration, body.gradient)
        substeps, code, status = body.advance(going, t, progress)
        broken = code != substep.RUNNING
        if strict and broken.any():
            first = int(np.flatnonzero(broken)[0])
            raise body.failure(int(going[first]), status[first], t, int(substeps[first]))
        failed_frame[going[broken]] = t
        points[going[~broken], t + 1] = follow(body.x[going[~broken]])
        loop.reached(t + 1, lambda: state)
    return BatchRollout(points, failed_frame)
