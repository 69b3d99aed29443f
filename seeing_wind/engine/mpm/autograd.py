"""The only interface between torch and the solver: T frames of simulation as one differentiable function."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from ..errors import UsageError
from ..progress import NoProgress, Progress
from .body import Body
from .body.frame_run import FrameRun
from .body.packing import launched_in
from .body.substeps import sparse_stride
from .checks import check_force, check_numbers, checked_state
from .kernels.pack import unpack_forces
from .lattice.boundary import HELD
from .model import Model
from .state import State

HISTORY = 2_000_000_000
"""Bytes of substep states kept between the forward and the backward sweep. Further frames are simulated again in the backward sweep."""


class RolloutFunction(torch.autograd.Function):
    """States at T + 1 frames from the first state, the force and the material; use `simulate`.

    Between the two sweeps, single precision keeps every substep's state (96 B per particle, and at most 4 B for the nodes) up to `HISTORY`;
    double precision, or single once that is used up, keeps every n-th of a frame's n² substeps, and the backward sweep simulates the n
    between them again. Of frames that no longer fit into `HISTORY`, only the start is kept.
    """

    @staticmethod
    def forward(  # type: ignore[override]
        ctx: Any, model: Model, precision: str, progress: Progress, first_frame: int, x0: torch.Tensor, v0: torch.Tensor, C0: torch.Tensor,
        F0: torch.Tensor, acceleration: torch.Tensor, gradient: torch.Tensor, mass: torch.Tensor, mu: torch.Tensor, lam: torch.Tensor,
        yield_stress: torch.Tensor, viscosity: torch.Tensor,
    ) -> tuple[torch.Tensor, ...]:  # fmt: skip
        """x (T+1, N, 3) [m], v [m/s], C [1/s] and F of every frame, from those of the first, acceleration (T, N, 3) [m/s²] and its
        gradient (T, N, 3, 3) [1/s²]; mass to viscosity (N,) as in `Model`.

        Raises:
            MaterialError, UsageError: see `checks`. SimulationError: when the simulation fails.
        """
        model = replace(
            model, mass=_array(mass), mu=_array(mu), lam=_array(lam), yield_stress=_array(yield_stress), viscosity=_array(viscosity)
        )
        check_numbers(model.mass, model.mu, model.lam, model.yield_stress, model.viscosity)
        force, gradients = _array(acceleration), _array(gradient)
        check_force(model.particles, force, gradients, first_frame)
        force = force + np.stack([np.atleast_2d(model.gravity_in(first_frame + t)) for t in range(len(force))])
        ctx.body, ctx.progress = Body(model, precision), progress
        states, ctx.runs = [checked_state(model, State(*(_array(tensor) for tensor in (x0, v0, C0, F0))))], []
        left = HISTORY
        for t in range(len(force)):

            def stride(substeps: int, left: int = left) -> int:
                room = left > substeps * states[0].x.shape[0] * 24 * ctx.body.real.itemsize
                return 1 if precision == "single" and room else sparse_stride(substeps)

            after, run = ctx.body.frame(states[-1], force[t], gradients[t], first_frame + t, progress, stride)
            left -= run.bytes
            if left < 0:
                run.kept, run.grids = {0: run.kept[0]}, {}
            states.append(after)
            ctx.runs.append(run)
        return tuple(torch.from_numpy(np.stack([getattr(state, name) for state in states])) for name in "xvCF")

    @staticmethod
    def backward(ctx: Any, *bars: torch.Tensor) -> tuple[Any, ...]:  # type: ignore[override]
        """Derivatives of a loss by the inputs, from those by x, v, C, F of every frame: the adjoint, frame by frame backwards."""
        body: Body = ctx.body
        runs: list[FrameRun] = ctx.runs
        count, frames = body.model.particles, len(runs)
        by_frame = [State(*parts) for parts in zip(*(_array(bar) for bar in bars))]
        bar, origin = by_frame[-1], np.zeros(3)
        wanted = any(ctx.needs_input_grad[-5:])
        by_acceleration, by_gradient, material_bar = np.zeros((frames, count, 3)), np.zeros((frames, count, 3, 3)), np.zeros((count, 8))
        for t in reversed(range(frames)):
            run = runs[t]
            packed = body.packing.packed(run.order, bar, origin)
            by_force, by_material = body.pull_back(run, packed, wanted, ctx.progress)
            launched_in(body.real, unpack_forces)(run.order, by_force, by_acceleration[t], by_gradient[t])
            if wanted:
                material_bar[run.order] += by_material.reshape(-1, 8)
            bar = body.packing.unpack(run, packed, origin, bar)
            for total, part in zip((bar.x, bar.v, bar.C, bar.F), (by_frame[t].x, by_frame[t].v, by_frame[t].C, by_frame[t].F)):
                total += part
        held = body.model.role == HELD
        if held.any():  # these start at rest whatever their v0 and C0
            bar = State(bar.x, bar.v.copy(), bar.C.copy(), bar.F)
            bar.v[held], bar.C[held] = 0.0, 0.0
        mass, _, mu, lam, yield_stress, viscosity = material_bar.T[:6]
        found = (bar.x, bar.v, bar.C, bar.F, by_acceleration, by_gradient, mass, mu, lam, yield_stress, viscosity)
        return None, None, None, None, *(torch.from_numpy(np.ascontiguousarray(array)) for array in found)


def simulate(
    model: Model,
    x0: torch.Tensor,
    v0: torch.Tensor,
    acceleration: torch.Tensor,
    gradient: torch.Tensor | None = None,
    *,
    C0: torch.Tensor | None = None,
    F0: torch.Tensor | None = None,
    youngs_modulus: torch.Tensor | None = None,
    poisson_ratio: torch.Tensor | None = None,
    density: torch.Tensor | None = None,
    yield_stress: torch.Tensor | None = None,
    viscosity: torch.Tensor | None = None,
    precision: str = "double",
    first_frame: int = 0,
    progress: Progress = NoProgress(),
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """`rollout` for torch, for every law, differentiable with respect to every tensor given.

    Args:
        x0, v0: (N, 3) float64 at the first frame [m], [m/s].
        acceleration: (T, N, 3) float64 external acceleration [m/s²], constant over each frame, without gravity.
        gradient: (T, N, 3, 3) float64, d a_i / d x_j [1/s²]; None is zero.
        C0, F0: (N, 3, 3) float64 affine velocities [1/s] and deformation gradients; None is zero and the identity.
        youngs_modulus, poisson_ratio, density, yield_stress, viscosity: [Pa], [-], [kg/m³], [Pa], [Pa s], one number or (N,); None is
            the model's. The number of substeps stays the model's: a much stiffer body needs another model.
        precision: double or single; tensors are float64 either way.
        first_frame: number of the first frame, for messages and for the pins' path.

    Returns:
        x, v (T+1, N, 3) and C, F (T+1, N, 3, 3).

    Raises:
        SimulationError, UsageError, Cancelled: as `rollout`, in the forward sweep; Cancelled also in the backward sweep.
        MaterialError: for particles without mass or stiffness.
    """
    count, frames = model.particles, len(acceleration)
    materials = {"youngs_modulus": youngs_modulus, "poisson_ratio": poisson_ratio, "density": density}
    for name, tensor in (materials | {"yield_stress": yield_stress, "viscosity": viscosity}).items():
        if tensor is not None and tensor.shape not in ((), (1,), (count,)):
            raise UsageError(f"{name} has shape {tuple(tensor.shape)}.", f"Give one number, or one for each of the {count} particles.")
    C0 = torch.zeros(count, 3, 3, dtype=torch.float64) if C0 is None else C0
    F0 = torch.eye(3, dtype=torch.float64).repeat(count, 1, 1) if F0 is None else F0
    gradient = torch.zeros(frames, count, 3, 3, dtype=torch.float64) if gradient is None else gradient
    mu, lam = torch.from_numpy(model.mu), torch.from_numpy(model.lam)
    E = mu * (3.0 * lam + 2.0 * mu) / (lam + mu) if youngs_modulus is None else youngs_modulus
    nu = lam / (2.0 * (lam + mu)) if poisson_ratio is None else poisson_ratio
    if youngs_modulus is not None or poisson_ratio is not None:
        mu, lam = E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    mass = torch.from_numpy(model.mass) if density is None else density * torch.from_numpy(model.volume)
    yield_stress = torch.from_numpy(model.yield_stress) if yield_stress is None else yield_stress
    viscosity = torch.from_numpy(model.viscosity) if viscosity is None else viscosity
    if model.axes is not None:
        A = torch.from_numpy(model.axes)
        x0, v0, acceleration = x0.double() @ A, v0.double() @ A, acceleration.double() @ A
        C0, F0, gradient = A.T @ C0.double() @ A, A.T @ F0.double(), A.T @ gradient.double() @ A
    material = (tensor.expand(count) for tensor in (mass, mu, lam, yield_stress, viscosity))
    states = RolloutFunction.apply(
        model.upright(), precision, progress, first_frame, x0, v0, C0, F0, acceleration, gradient, *material
    )
    if model.axes is None:
        return states
    x, v, C, F = states
    return x @ A.T, v @ A.T, A @ C @ A.T, A @ F


def _array(tensor: torch.Tensor) -> np.ndarray:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=np.float64)
