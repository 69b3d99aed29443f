"""The forward model of the solve: unknowns in, trajectories and their derivatives out.

The unknowns theta (n,) are the field's coefficients (knots, modes, 3) [m/s²] followed by the initial velocities (V,) [m/s].
A column of the Jacobian is one more simulation, from the picture in which its hat begins: nothing earlier can feel it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SimulationError
from ..mpm.model import Model
from ..mpm.rollout import advance, rollout_batch
from ..mpm.state import State, Trajectory
from ..progress import Progress
from .basis import SpatialBasis
from .objective import Objective

OFFSET = 1e-4
"""Step of the finite differences, relative to the size that the prior expects. In double precision the quotient is good to 1e-5."""
COLUMNS_AT_ONCE = 96
"""Simulations whose positions are held in memory together."""


@dataclass(frozen=True)
class Forward:
    """A body, the functions its field is written with, and how it may start."""

    model: Model
    x: np.ndarray
    """(N, 3) rest positions [m]."""
    basis: SpatialBasis
    hats: np.ndarray
    """(T, knots)."""
    knot_spacing: float
    """Frames between knots at most."""
    velocity: np.ndarray
    """(V, N, 3) initial motions of unit size."""
    velocity_gradient: np.ndarray
    """(V, N, 3, 3)."""
    progress: Progress

    @property
    def shape(self) -> tuple[int, int, int]:
        """(knots, modes, 3) of the coefficients."""
        return self.hats.shape[1], self.basis.phi.shape[1], 3

    @property
    def size(self) -> int:
        """Number of coefficients; the initial velocities follow them in theta."""
        return int(np.prod(self.shape))

    def pack(self, per_frame: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """theta (n,) nearest to coefficients per frame (T, fewer or as many modes, 3) and initial velocities (V,)."""
        knots = np.zeros(self.shape)
        modes = per_frame.shape[1]
        knots[:, :modes] = np.tensordot(np.linalg.pinv(self.hats), per_frame, 1)
        return np.concatenate([knots.ravel(), velocity])

    def start(self, velocity: np.ndarray) -> State:
        """The state in picture 0 with initial velocities (V,)."""
        rest = State.at_rest(self.x)
        return State(rest.x, np.tensordot(velocity, self.velocity, 1), np.tensordot(velocity, self.velocity_gradient, 1), rest.F)

    def per_frame(self, theta: np.ndarray) -> np.ndarray:
        """theta (n,) or (B, n) -> coefficients per frame (..., T, modes, 3)."""
        knots = theta[..., : self.size].reshape(*theta.shape[:-1], *self.shape)
        return np.einsum("tk,...kpi->...tpi", self.hats, knots)

    def acceleration(self, theta: np.ndarray) -> np.ndarray:
        """(T, N, 3) [m/s²] on the particles."""
        return np.einsum("np,tpi->tni", self.basis.phi, self.per_frame(theta))

    def advance(self, state: State, coefficients: np.ndarray, frame: int) -> State:
        """One frame under coefficients (modes, 3)."""
        gradient = np.einsum("pi,npj->nij", coefficients, self.basis.gradient) @ np.linalg.inv(state.F)
        return advance(self.model, state, self.basis.phi @ coefficients, gradient, frame=frame)

    def trajectory(self, theta: np.ndarray) -> Trajectory:
        """The simulation under theta (n,). Raises SimulationError when it breaks down."""
        coefficients, state = self.per_frame(theta), self.start(theta[self.size :])
        states, substeps = [state], []
        for t in range(len(coefficients)):
            state = self.advance(state, coefficients[t], t)
            states.append(state)
            substeps.append(self.model.substeps)
            self.progress.check()
        return Trajectory(*(np.stack([getattr(s, name) for s in states]) for name in ("x", "v", "C", "F")), np.array(substeps))

    def positions(self, theta: np.ndarray) -> np.ndarray:
        """Candidates (B, n) -> (B, T+1, N, 3), NaN after a breakdown."""
        velocity = theta[:, self.size :]
        return self._batch(State.at_rest(self.x), self.per_frame(theta), velocity)

    def window(self, state: State | None, unknowns: np.ndarray, frames: int) -> np.ndarray:
        """Constant coefficients over a few frames: (B, modes 3 [+ V]) -> (B, frames+1, N, 3). State None starts at rest with velocities."""
        modes = self.shape[1]
        constant = unknowns[:, : 3 * modes].reshape(-1, 1, modes, 3)
        coefficients = np.repeat(constant, frames, axis=1)
        if state is None:
            return self._batch(State.at_rest(self.x), coefficients, unknowns[:, 3 * modes :])
        return self._batch(state, coefficients, None)

    def _batch(self, state: State | Trajectory, coefficients: np.ndarray, velocity: np.ndarray | None, start: np.ndarray | None = None) -> np.ndarray:
        v0 = C0 = None
        if velocity is not None:
            v0, C0 = np.tensordot(velocity, self.velocity, 1), np.tensordot(velocity, self.velocity_gradient, 1)
        phi, gradient = self.basis.phi, self.basis.gradient
        return rollout_batch(
            self.model, state, phi, gradient, coefficients, start_frame=start, v0=v0, C0=C0, progress=self.progress
        ).points

    def jacobian(self, theta: np.ndarray, nominal: Trajectory, objective: Objective, scale: np.ndarray) -> np.ndarray:
        """d (raw residuals) / d theta, (n, T+1, channels), by one simulation per unknown.

        Args:
            theta: (n,) the point.
            nominal: the simulation there.
            objective: whose residuals.
            scale: (n,) expected sizes of the unknowns.

        Raises:
            SimulationError: when a perturbed simulation breaks down, though the nominal one did not.
        """
        # A hat is felt from the frame after the knot before its own.
        first = np.concatenate([np.repeat(np.argmax(self.hats > 0.0, axis=0), 3 * self.shape[1]), np.zeros(len(theta) - self.size, int)])
        base = objective.residual(nominal.x[None])[0]
        columns = np.zeros((len(theta), *base.shape), np.float32)
        base_velocity = theta[self.size :]
        for begin in range(0, len(theta), COLUMNS_AT_ONCE):
            some = np.arange(begin, min(begin + COLUMNS_AT_ONCE, len(theta)))
            offset = OFFSET * scale[some]
            moved = np.repeat(theta[None], len(some), axis=0)
            moved[np.arange(len(some)), some] += offset
            velocity = moved[:, self.size :] if (some >= self.size).any() else None
            positions = self._columns(nominal, moved, velocity, first[some], base_velocity)
            if not np.isfinite(positions).all():
                raise SimulationError("A slightly different force breaks the simulation down.", "Choose a stiffer or heavier material.")
            columns[some] = (objective.residual(positions) - base) / offset[:, None, None]
            self.progress.check()
        return columns

    def _columns(self, nominal: Trajectory, moved: np.ndarray, velocity: np.ndarray | None, first: np.ndarray, base: np.ndarray) -> np.ndarray:
        if velocity is None:
            return self._batch(nominal, self.per_frame(moved), None, first)
        changed = (velocity != base).any(axis=1)
        out = np.empty((len(moved), *nominal.x.shape))
        if (~changed).any():
            out[~changed] = self._batch(nominal, self.per_frame(moved[~changed]), None, first[~changed])
        out[changed] = self._batch(nominal, self.per_frame(moved[changed]), velocity[changed], first[changed])
        return out
