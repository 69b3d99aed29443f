"""Frames of simulation of one body."""

from __future__ import annotations

import numpy as np

from ..progress import NoProgress, Progress
from .body import Body
from .checks import check_force, checked_state
from .compiler.precision import dtype_of
from .copies import Copies, conditioned
from .kernels import substep
from .model import Model
from .state import State, Trajectory

_LARGE = 8000
"""Particles from which one body is worth all cores; below, its grid fits in one core's cache and barriers would cost more."""


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
    start, frames = checked_state(body.model, state), len(acceleration)
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
