"""Frames of simulation of one body."""

from __future__ import annotations

import numpy as np

from ..progress import NoProgress, Progress
from .body import Body
from .checks import check_force, checked_state
from .compiler.precision import dtype_of
from .model import Model
from .state import State, Trajectory


def rollout(
    model: Model,
    state: State,
    acceleration: np.ndarray,
    gradient: np.ndarray | None = None,
    *,
    progress: Progress = NoProgress(),
    first_frame: int = 0,
    precision: str = "double",
) -> Trajectory:
    """Simulate T frames of one body, on as many cores as its size is worth.

    Args:
        acceleration: (T, N, 3) external acceleration f / rho [m/s²], constant over each frame; gravity comes from the model.
        gradient: (T, N, 3, 3), d a_i / d x_j [1/s²]; None is zero.
        first_frame: number of the first frame, for messages and for the pins' path.
        precision: double, or single, which is faster and accurate to 1e-3 over a frame.

    Raises:
        SimulationError: when a frame fails even with half the dt, or a value is not finite; it names frame, substep, particle and
            quantity.
        UsageError: for arrays that do not fit the model, or an unknown precision.
    """
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
    return body_rollout(Body(model, precision), state, acceleration, gradient, progress, first_frame)


def body_rollout(
    body: Body, state: State, acceleration: np.ndarray, gradient: np.ndarray | None, progress: Progress, first_frame: int
) -> Trajectory:
    """`rollout` of a given `Body`: acceleration (T, N, 3) [m/s²], gradient (T, N, 3, 3) [1/s²] or None."""
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
    """One frame of `rollout`: acceleration (N, 3) [m/s²], gradient (N, 3, 3) [1/s²] -> the state at the next frame."""
    gradients = None if gradient is None else np.asarray(gradient)[None]
    return rollout(model, state, np.asarray(acceleration)[None], gradients, first_frame=frame).state(1)
