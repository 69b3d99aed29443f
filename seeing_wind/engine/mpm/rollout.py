"""Frames of simulation: one copy of the body, or many at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SimulationError, UsageError
from ..progress import Journal, NoProgress, Progress
from ..records import Attachment
from .body import Body
from .checks import check_force, check_state
from .compiler import device
from .compiler.precision import dtype_of
from .failure import diagnosis, failure
from .kernels import substep
from .lattice.boundary import HELD
from .model import MOST_NODES, Model
from .state import State, Trajectory

_WORK_PER_CALL = 2_000_000
"""Particle-substeps between two safe points: a quarter of a second on one core, a second on a crowded one."""
_GRID_NODES_AT_ONCE = 8_000_000
"""Nodes of all private grids together: 256 MB."""
_LARGE = 8000
"""Particles from which one body is worth all cores; below, its grid fits in one core's cache and barriers would cost more."""


class Copies:
    """States of B copies of one body, advanced in place frame by frame."""

    def __init__(self, model: Model, x: np.ndarray, v: np.ndarray, C: np.ndarray, F: np.ndarray) -> None:
        """x, v (B, N, 3); C, F (B, N, 3, 3). The arrays are changed: now and by `advance`. Held particles start at rest."""
        assert model.axes is None, "give Model.upright"
        device.start(model.device)
        check_state(model.particles, model.offset, model.dx, x, v, C, F)
        v[:, model.role == HELD] = 0.0
        C[:, model.role == HELD] = 0.0
        self.model = model
        self.x, self.v, self.C, self.F = x, v, C, F
        self.acceleration = np.zeros_like(x)
        self.gradient = np.zeros_like(F)
        self.capacity = 0

    def advance(self, copies: np.ndarray, frame: int, progress: Progress) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frame number `frame` of the copies listed (A,) under `acceleration` (gravity included) and `gradient`.

        Copies that fail start the frame once more with half the dt.

        Returns:
            substeps (A,) that the frame took, code (A,) of `substep` (RUNNING is success), status (A, 4) for `failure`.
        """
        before = [array[copies] for array in (self.x, self.v, self.C, self.F)]
        substeps = np.full(len(copies), self.model.substeps)
        status = self._run(copies, self.model.substeps, progress)
        failed = np.flatnonzero(status[:, 0] != substep.RUNNING)
        if len(failed):
            for array, start in zip((self.x, self.v, self.C, self.F), before):
                array[copies[failed]] = start[failed]
            substeps[failed] *= 2
            status[failed] = self._run(copies[failed], 2 * self.model.substeps, progress)
        return substeps, status[:, 0], status

    def failure(self, copy: int, status: np.ndarray, frame: int, substeps: int) -> SimulationError:
        """The error for a copy that `advance` could not bring through a frame, from its status (4,) and what the frame left of it."""
        dt_over_dx = self.model.frame_dt / substeps / self.model.dx
        found = diagnosis(int(status[0]), dt_over_dx, self.x[copy], self.v[copy], self.F[copy])
        return failure((*found, int(status[2])), frame, substeps)

    def _run(self, copies: np.ndarray, substeps: int, progress: Progress) -> np.ndarray:
        """All substeps of a frame in calls short enough to be cancelled between; returns status (A, 4)."""
        status = np.zeros((len(self.x), 4), np.int32)
        todo = np.asarray(copies, dtype=np.int32)
        stride = max(1, min(substeps, _WORK_PER_CALL // self.model.particles))
        while len(todo):
            rows = max(1, min(len(todo), _WORK_PER_CALL // (self.model.particles * stride), _GRID_NODES_AT_ONCE // max(self.capacity, 1)))
            for first in range(0, len(todo), rows):
                some = np.ascontiguousarray(todo[first : first + rows])
                progress.check()
                self._launch(some, substeps, min(substeps, int(status[some, 2].min()) + stride), status)
            full = todo[status[todo, 0] == substep.GRID_FULL]
            burst = status[full, 3] > MOST_NODES
            status[full[burst], 0] = substep.BURST
            full = full[~burst]
            if len(full):
                self._grow(status[full])
                status[full, 0] = substep.RUNNING
            todo = todo[(status[todo, 0] == substep.RUNNING) & (status[todo, 2] < substeps)]
        return status[copies]

    def _grow(self, status: np.ndarray) -> None:
        wanted = int(status[:, 3].max())
        # A third more than asked, so that a body that turns does not ask again at every substep.
        self.capacity = wanted + wanted // 3

    def _launch(self, copies: np.ndarray, substeps: int, until: int, status: np.ndarray) -> None:
        m = self.model
        if not self.capacity:
            extent = np.ceil(np.ptp(self.x, axis=1).max(axis=0) / m.dx) + 4
            self.capacity = int(min(np.prod(extent) * 1.5, MOST_NODES))
        grid = np.empty((len(copies), self.capacity, 4))
        substep.run_substeps(
            m.plastic, m.mass, m.volume, m.mu, m.lam, m.yield_stress, m.viscosity, m.law, m.role,
            m.clamp_lo, m.clamp, m.offset, m.dx, m.frame_dt / substeps,
            copies, until, self.acceleration, self.gradient, self.x, self.v, self.C, self.F, grid, status,
        )  # fmt: skip


class CopiesInTurn(Copies):
    """The same for models with colliders or moving pins: one copy after the other, each on as many cores as it is worth."""

    def failure(self, copy: int, status: np.ndarray, frame: int, substeps: int) -> SimulationError:
        """As `Copies.failure`; here a copy that failed is left as it was."""
        return failure(status, frame, substeps)

    def advance(self, copies: np.ndarray, frame: int, progress: Progress) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `Copies.advance`."""
        body = Body(self.model)
        substeps, status = np.zeros(len(copies), int), np.zeros((len(copies), 4), np.int32)
        for row, b in enumerate(copies):
            state = State(self.x[b], self.v[b], self.C[b], self.F[b])
            after, run, status[row, :3] = body.attempt(state, self.acceleration[b], self.gradient[b], frame, progress)
            substeps[row] = run.substeps
            if after is not None:
                self.x[b], self.v[b], self.C[b], self.F[b] = after.x, after.v, after.C, after.F
        return substeps, status[:, 0], status


def conditioned(model: Model) -> bool:
    """Whether more holds at the nodes than pins that stand still: `Body` knows of it, `Copies` does not."""
    return model.pin_path is not None or model.collider_grid.active or model.grid_force.active


def rollout(
    model: Model,
    state: State,
    acceleration: np.ndarray,
    gradient: np.ndarray | None = None,
    *,
    progress: Progress | None = None,
    first_frame: int = 0,
    precision: str = "double",
) -> Trajectory:
    """Simulate T frames: a large body on all cores, a small one on one.

    Args:
        state: at the first picture.
        acceleration: (T, N, 3) of the external force, f / rho [m/s²], held over each frame; gravity comes from the model.
        gradient: (T, N, 3, 3), d a_i / d x_j [1/s²]; None is zero.
        first_frame: number of the first frame, for messages and for the pins' path.
        precision: double, or single, which is faster and within 1e-3 over a frame; a small body is simulated in double all the same.

    Raises:
        SimulationError: when a frame breaks even with half the dt, or a value is not finite; it names frame, substep, particle and
            quantity.
        UsageError: for arrays that do not fit the model, and an unknown precision or device.
        Cancelled: when the user asked to stop.
    """
    progress = progress or NoProgress()
    dtype_of(precision)
    acceleration, gradient = np.asarray(acceleration), None if gradient is None else np.asarray(gradient)
    check_force(model.particles, acceleration, gradient, first_frame)
    if model.axes is not None:
        A = model.axes
        slope = None if gradient is None else A.T @ gradient @ A
        path = rollout(
            model.upright(), state.turned(A), acceleration @ A, slope, progress=progress, first_frame=first_frame, precision=precision
        )
        return path.turned(A.T)
    if model.particles >= _LARGE or conditioned(model):
        return body_rollout(Body(model, precision), state, acceleration, gradient, progress, first_frame)
    one = Copies(model, *(np.array(array, dtype=np.float64)[None] for array in (state.x, state.v, state.C, state.F)))
    history = [[array[0].copy()] for array in (one.x, one.v, one.C, one.F)]
    taken, only = [], np.zeros(1, np.int32)
    for t in range(len(acceleration)):
        one.acceleration[0] = acceleration[t] + model.gravity_in(first_frame + t)
        if gradient is not None:
            one.gradient[0] = gradient[t]
        substeps, code, status = one.advance(only, first_frame + t, progress)
        if code[0] != substep.RUNNING:
            raise one.failure(0, status[0], first_frame + t, int(substeps[0]))
        taken.append(int(substeps[0]))
        for rows, array in zip(history, (one.x, one.v, one.C, one.F)):
            rows.append(array[0].copy())
    x, v, C, F = (np.stack(rows) for rows in history)
    return Trajectory(x, v, C, F, np.array(taken, dtype=np.int64))


def body_rollout(
    body: Body, state: State, acceleration: np.ndarray, gradient: np.ndarray | None, progress: Progress, first_frame: int
) -> Trajectory:
    """`rollout` of one large or conditioned body on all cores: acceleration (T, N, 3) [m/s²], gradient (T, N, 3, 3) [1/s²]."""
    start, frames = body.checked(state), len(acceleration)
    x, v, C, F = (np.empty((frames + 1, *array.shape)) for array in (start.x, start.v, start.C, start.F))
    path = Trajectory(x, v, C, F, np.zeros(frames, np.int64))
    path.x[0], path.v[0], path.C[0], path.F[0] = start.x, start.v, start.C, start.F
    for t in range(frames):
        force = acceleration[t] + body.model.gravity_in(first_frame + t)
        slope = None if gradient is None else gradient[t]
        _, run = body.frame(path.state(t), force, slope, first_frame + t, progress, into=path.state(t + 1))
        path.substeps[t] = run.substeps
    return path


def advance(model: Model, state: State, acceleration: np.ndarray, gradient: np.ndarray | None = None, *, frame: int = 0) -> State:
    """One frame of `rollout`: acceleration (N, 3) [m/s²], gradient (N, 3, 3) [1/s²] -> the state at the next picture."""
    gradients = None if gradient is None else np.asarray(gradient)[None]
    return rollout(model, state, np.asarray(acceleration)[None], gradients, first_frame=frame).state(1)


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
