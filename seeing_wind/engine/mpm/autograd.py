"""The one seam between torch and the solver: T frames of simulation as one differentiable function."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from ..errors import MaterialError
from ..progress import NoProgress, Progress
from . import adjoint, substep
from .boundary import HELD
from .constitutive import ELASTIC_LAWS
from .model import Model
from .rollout import failure, rollout
from .state import State, Trajectory

_CALL = 25
"""Substeps per backward call: the process can be interrupted between two calls."""


class RolloutFunction(torch.autograd.Function):
    """States at T + 1 pictures from the first state and the force; use `simulate`.

    Kept between the two sweeps: the states at pictures (192 B per particle and frame). The backward sweep runs each frame again,
    keeps its substeps (192 B per particle and substep), and walks back through them.
    """

    @staticmethod
    def forward(  # type: ignore[override]
        ctx: Any, model: Model, progress: Progress, x0: torch.Tensor, v0: torch.Tensor, C0: torch.Tensor, F0: torch.Tensor,
        acceleration: torch.Tensor, gradient: torch.Tensor,
    ) -> tuple[torch.Tensor, ...]:  # fmt: skip
        state = State(*(_array(tensor) for tensor in (x0, v0, C0, F0)))
        ctx.model, ctx.progress = model, progress
        ctx.acceleration, ctx.gradient = _array(acceleration), _array(gradient)
        ctx.path = rollout(model, state, ctx.acceleration, ctx.gradient, progress=progress)
        return tuple(torch.from_numpy(array) for array in (ctx.path.x, ctx.path.v, ctx.path.C, ctx.path.F))

    @staticmethod
    def backward(ctx: Any, *bars: torch.Tensor) -> tuple[Any, ...]:  # type: ignore[override]
        """Derivatives of a loss by the inputs from those by x, v, C, F of every picture: the adjoint, swept backwards frame by frame."""
        path: Trajectory = ctx.path
        x_bars, v_bars, C_bars, F_bars = (_array(bar) for bar in bars)
        bar = [array[-1:].copy() for array in (x_bars, v_bars, C_bars, F_bars)]
        acceleration_bar, gradient_bar = np.zeros_like(ctx.acceleration), np.zeros_like(ctx.gradient)
        for t in reversed(range(path.frames)):
            acceleration_bar[t], gradient_bar[t] = _frame_adjoint(
                ctx.model, path.state(t), t, int(path.substeps[t]), ctx.acceleration[t], ctx.gradient[t], bar, ctx.progress
            )
            for total, bars_at in zip(bar, (x_bars, v_bars, C_bars, F_bars)):
                total += bars_at[t : t + 1]
        held = ctx.model.role == HELD  # these start at rest whatever they are given
        bar[1][0, held], bar[2][0, held] = 0.0, 0.0
        state_bars = (torch.from_numpy(total[0]) for total in bar)
        return None, None, *state_bars, torch.from_numpy(acceleration_bar), torch.from_numpy(gradient_bar)


def simulate(
    model: Model,
    x0: torch.Tensor,
    v0: torch.Tensor,
    acceleration: torch.Tensor,
    gradient: torch.Tensor | None = None,
    *,
    C0: torch.Tensor | None = None,
    F0: torch.Tensor | None = None,
    progress: Progress | None = None,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """`rollout` for torch, differentiable in every tensor given.

    Args:
        x0, v0: (N, 3) float64 at the first picture [m], [m/s].
        acceleration: (T, N, 3) float64 external acceleration [m/s²], held over each frame, without gravity.
        gradient: (T, N, 3, 3) float64, d a_i / d x_j [1/s²]; None is zero.
        C0, F0: (N, 3, 3) float64 affine velocities [1/s] and deformation gradients; None is zero and the identity.

    Returns:
        x, v (T+1, N, 3) and C, F (T+1, N, 3, 3).

    Raises:
        MaterialError: for a plastic law, which has no adjoint.
        SimulationError, Cancelled: as `rollout`, in the forward sweep; Cancelled also in the backward sweep.
    """
    if model.plastic:
        raise MaterialError("The solver has no gradients for plastic laws.", f"Choose one of {', '.join(ELASTIC_LAWS)}.")
    count, frames = len(x0), len(acceleration)
    C0 = torch.zeros(count, 3, 3, dtype=torch.float64) if C0 is None else C0
    F0 = torch.eye(3, dtype=torch.float64).repeat(count, 1, 1) if F0 is None else F0
    gradient = torch.zeros(frames, count, 3, 3, dtype=torch.float64) if gradient is None else gradient
    return RolloutFunction.apply(model, progress or NoProgress(), x0, v0, C0, F0, acceleration, gradient)


def _frame_adjoint(
    model: Model,
    start: State,
    frame: int,
    substeps: int,
    acceleration: np.ndarray,
    gradient: np.ndarray,
    bar: list[np.ndarray],
    progress: Progress,
) -> tuple[np.ndarray, np.ndarray]:
    """Turns `bar` (x, v, C, F, each (1, N, ...)) from the frame's end to its start; returns those of the force, (N, 3) and (N, 3, 3)."""
    fixed = (
        model.mass, model.volume, model.mu, model.lam, model.law, model.role,
        model.clamp_lo, model.clamp, model.offset, model.dx, model.frame_dt / substeps,
    )  # fmt: skip
    force = (acceleration + model.gravity)[None], np.array(gradient[None])
    history = [np.concatenate([array[None], np.empty((substeps, *array.shape))]) for array in (start.x, start.v, start.C, start.F)]
    status, nodes = np.zeros((1, 4), np.int32), 0
    while status[0, 2] < substeps:
        progress.check()
        grid = np.empty((1, nodes, 4))
        adjoint.record_substeps(*fixed, *force, *history, grid, status)
        if status[0, 0] not in (substep.RUNNING, substep.GRID_FULL):
            raise failure(status[0], frame, substeps)  # the forward sweep went through; only a changed model can fail here
        nodes = int(1.3 * status[0, 3])
    acceleration_bar, gradient_bar = np.zeros_like(force[0]), np.zeros_like(force[1])
    grid_bar = np.empty_like(grid)
    for last in range(substeps, 0, -_CALL):
        progress.check()
        adjoint.run_substeps_adjoint(
            *fixed, max(0, last - _CALL), last, *force, *history, *bar, acceleration_bar, gradient_bar, grid, grid_bar
        )
    return acceleration_bar[0], gradient_bar[0]


def _array(tensor: torch.Tensor) -> np.ndarray:
    return np.array(tensor.detach().cpu().numpy(), dtype=np.float64)
