"""The forward model of the solve: from unknowns to trajectories and their derivatives.

The unknowns theta (n,) are the field's coefficients (knots, modes, 3) [m/s²] followed by the initial velocities (V,) [m/s]. The modes
describe the force density, which is smooth over the body, in units of the density of the body's material; a part with a density of its own
is accelerated by that in proportion to its `lightness`.
The Jacobian is computed by tangents that are carried along one simulation (`mpm.tangent`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from ...errors import SimulationError
from ...mpm.batch import BatchRollout, rollout_batch
from ...mpm.model import Model
from ...mpm.rollout import advance
from ...mpm.state import State, Trajectory
from ...mpm.tangent import Changes, tangents
from ...progress import Journal, Progress
from ..prior.basis import Knots, SpatialBasis
from ..targets.objective import Objective

OFFSET = 1e-4
"""Step of the finite differences of the residuals by positions [cells]."""
RECENT = 4
"""Number of recent simulations that are kept: they are needed again, at the start of the next solve and for the path."""


@dataclass(frozen=True)
class Forward:
    """A body, the functions in which its field is written, and its possible initial motions."""

    model: Model
    rough: Model
    """The same body with fewer substeps, accurate enough for derivatives and for looking ahead."""
    x: np.ndarray
    """(N, 3) rest positions [m]."""
    basis: SpatialBasis
    knots: Knots
    velocity: np.ndarray
    """(V, N, 3) velocities of the initial motions of unit size."""
    velocity_gradient: np.ndarray
    """(V, N, 3, 3) gradients of these velocities."""
    progress: Progress
    steady: np.ndarray
    """(3,) constant part of the force where the air is not still [m/s²]; the coefficients are relative to it."""
    begin: State | None = None
    """The body at the first frame, if it is known; there are then no initial motions (V = 0)."""
    journal: Journal = Journal()
    """Keeps the results of simulations."""
    lightness: np.ndarray | None = None
    """(N,) density of the body's material in units of a particle's own; None is one everywhere."""
    _recent: dict[bytes, Trajectory] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Recent simulations of this body by their theta; a copy made by `replace` starts empty."""

    @cached_property
    def phi(self) -> np.ndarray:
        """(N, P) acceleration of the particles by the force of each mode."""
        return self.basis.phi if self.lightness is None else self.lightness[:, None] * self.basis.phi

    @cached_property
    def gradient(self) -> np.ndarray:
        """(N, P, 3) gradient of `phi` within a part [1/m]."""
        return self.basis.gradient if self.lightness is None else self.lightness[:, None, None] * self.basis.gradient

    @property
    def hats(self) -> np.ndarray:
        """(T, knots) values of the knots' hat functions."""
        return self.knots.hats

    @property
    def shape(self) -> tuple[int, int, int]:
        """(knots, modes, 3) of the coefficients."""
        return self.hats.shape[1], self.basis.phi.shape[1], 3

    @property
    def size(self) -> int:
        """Number of coefficients; the initial velocities follow them in theta."""
        return int(np.prod(self.shape))

    def pack(self, per_frame: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """The unknowns theta (n,) nearest to coefficients per frame (T, modes or fewer, 3) and initial velocities (V,)."""
        knots = np.zeros(self.shape)
        modes = per_frame.shape[1]
        knots[:, :modes] = np.tensordot(np.linalg.pinv(self.hats), per_frame - self._steadily()[:, :modes], 1)
        return np.concatenate([knots.ravel(), velocity])

    def start(self, velocity: np.ndarray) -> State:
        """The state in the first frame, given initial velocities (V,)."""
        if self.begin is not None:
            return self.begin
        rest = State.at_rest(self.x)
        return State(rest.x, *self._initial(velocity), rest.F)

    def per_frame(self, theta: np.ndarray) -> np.ndarray:
        """Coefficients of the whole force per frame (..., T, modes, 3) for theta (n,) or (B, n)."""
        return self._on_top(theta) + self._steadily()

    def _on_top(self, theta: np.ndarray) -> np.ndarray:
        """`per_frame` without the constant part: linear in theta."""
        knots = theta[..., : self.size].reshape(*theta.shape[:-1], *self.shape)
        return np.einsum("tk,...kpi->...tpi", self.hats, knots)

    def _steadily(self) -> np.ndarray:
        """Coefficients (T, modes, 3) of the constant part; the first mode is 1 all over the body."""
        alone = np.zeros((len(self.hats), *self.shape[1:]))
        alone[:, 0] = self.hats.sum(axis=1)[:, None] * self.steady
        return alone

    def acceleration(self, theta: np.ndarray) -> np.ndarray:
        """Acceleration by the force (T, N, 3) [m/s²] on the particles."""
        return np.einsum("np,tpi->tni", self.phi, self.per_frame(theta))

    def advance(self, state: State, coefficients: np.ndarray, frame: int) -> State:
        """Advance by one frame under the coefficients (modes, 3)."""
        gradient = np.einsum("pi,npj->nij", coefficients, self.gradient) @ np.linalg.inv(state.F)
        return advance(self.model, state, self.phi @ coefficients, gradient, frame=frame)

    def trajectory(self, theta: np.ndarray) -> Trajectory:
        """The simulation under theta (n,). Raises SimulationError when it breaks down."""

        def simulated() -> Trajectory:
            path = self._paths(theta[None])[0]
            if not np.isfinite(path.x).all():
                self._simulate(theta[None], strict=True)  # breaks down again, and raises the error
            return path

        return self.journal.once("motion", Trajectory, simulated, theta)

    def positions(self, theta: np.ndarray) -> np.ndarray:
        """Positions (B, T+1, N, 3) [m] for candidates (B, n), NaN after a breakdown."""
        return np.stack([path.x for path in self._paths(theta)])

    def _paths(self, theta: np.ndarray) -> list[Trajectory]:
        """Simulations of candidates (B, n), from the recent ones where possible; NaN after a breakdown."""
        keys = [one.tobytes() for one in theta]
        known = {key: self._recent[key] for key in keys if key in self._recent}
        new = [b for b, key in enumerate(keys) if key not in known]
        if new:
            known |= zip([keys[b] for b in new], self._simulate(theta[new]))
        for key, path in known.items():
            self._recent.pop(key, None)
            self._recent[key] = path
        for oldest in list(self._recent)[: -RECENT]:
            del self._recent[oldest]
        return [known[key] for key in keys]

    def _simulate(self, theta: np.ndarray, strict: bool = False) -> list[Trajectory]:
        """Simulate candidates (B, n); each result is the same to the last bit, whatever the others in the batch.

        `strict`: raises SimulationError at a breakdown.
        """
        starts = [self.start(one[self.size :]) for one in theta]
        coefficients = np.stack([self.per_frame(one) for one in theta])
        v0, C0 = (np.stack([getattr(start, name) for start in starts]) for name in ("v", "C"))
        return self._batch(self.model, starts[0], coefficients, v0, C0, strict).paths

    def look_ahead(self, state: State | None, unknowns: np.ndarray, first: int, frames: int) -> np.ndarray:
        """Positions (B, frames+1, N, 3) [m] over a few frames from `first` on, under coefficients that are constant in time.

        The `unknowns` (B, n) are the coefficients (3 modes), followed by initial velocities (V,) if `state` is None; the body then starts
        from its rest shape.
        """
        modes, rough = self.shape[1], self.rough.from_frame(first)
        constant = unknowns[:, : 3 * modes].reshape(-1, 1, modes, 3)
        coefficients = np.repeat(constant, frames, axis=1)
        v0 = C0 = None
        if state is None:
            state, (v0, C0) = State.at_rest(self.x), self._initial(unknowns[:, 3 * modes :])
        return self._batch(rough, state, coefficients, v0, C0).x

    def look_ahead_changes(
        self, state: State | None, unknown: np.ndarray, offset: np.ndarray, first: int, frames: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Positions (frames+1, N, 3) of `look_ahead` under `unknown` (n,), and (n, frames+1, N, 3), to first order, with each entry changed
        by its `offset` (n,)."""
        modes = self.shape[1]
        unit = np.eye(len(unknown))
        constant = np.repeat(unit[:, : 3 * modes].reshape(-1, 1, modes, 3), frames, axis=1)
        coefficients = np.repeat(unknown[: 3 * modes].reshape(1, modes, 3), frames, axis=0)
        v0 = C0 = None
        if state is None:
            state = self.start(unknown[3 * modes :])
            v0, C0 = self._initial(unit[:, 3 * modes :])
        changes, rough = Changes(constant, v0, C0), self.rough.from_frame(first)
        x, change = tangents(rough, state, self.phi, self.gradient, coefficients, changes, self.progress, self.journal)
        return x, x + offset[:, None, None, None] * change

    def _initial(self, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Particle velocities (..., N, 3) [m/s] and affine velocities (..., N, 3, 3) [1/s] from initial velocities (..., V)."""
        return np.tensordot(velocity, self.velocity, 1), np.tensordot(velocity, self.velocity_gradient, 1)

    def _batch(
        self, model: Model, start: State, coefficients: np.ndarray, v0: np.ndarray | None, C0: np.ndarray | None, strict: bool = False
    ) -> BatchRollout:
        return rollout_batch(
            model, start, self.phi, self.gradient, coefficients, v0=v0, C0=C0, strict=strict, progress=self.progress,
            journal=self.journal,
        )  # fmt: skip

    def jacobian(self, theta: np.ndarray, active: np.ndarray, objective: Objective, scale: np.ndarray) -> np.ndarray:
        """Derivatives (k, T+1, channels) of the raw residuals by the k active unknowns, by the rough model, or the fine one if that fails.

        Args:
            active: (n,) bool, the unknowns by which to differentiate.
            scale: (n,) expected sizes of the unknowns.

        Raises:
            SimulationError: when a simulation breaks down.
        """
        try:
            return self._columns(theta, active, objective, scale)
        except SimulationError:
            if self.rough.substeps >= self.model.substeps:
                raise
            return replace(self, rough=self.model).jacobian(theta, active, objective, scale)

    def _columns(self, theta: np.ndarray, active: np.ndarray, objective: Objective, scale: np.ndarray) -> np.ndarray:
        """`jacobian` with the rough model."""
        which = np.flatnonzero(active)
        assert which.size, "no unknown is active"
        size = scale[which]
        return self.journal.array("columns", partial(self._carried, theta, which, size, objective), theta, which, size)

    def _carried(self, theta: np.ndarray, which: np.ndarray, size: np.ndarray, objective: Objective) -> np.ndarray:
        """`jacobian` for the unknowns `which`, from tangents for changes of their expected `size`, carried along one simulation."""
        unit = np.zeros((len(which), len(theta)))
        unit[np.arange(len(which)), which] = size
        v0 = C0 = None
        if (which >= self.size).any():
            v0, C0 = self._initial(unit[:, self.size :])

        def residuals(frame: int, x: np.ndarray, moved: np.ndarray) -> np.ndarray:
            farthest = np.abs(moved).max(axis=(1, 2), initial=np.finfo(np.float32).tiny)
            step = OFFSET * self.model.dx / farthest
            every = np.concatenate([x[None], x + step[:, None, None] * moved])
            found = objective.residual(every[:, None], frame)[:, 0]
            return (found[1:] - found[0]) / step[:, None]

        _, rows = tangents(
            self.rough, self.start(theta[self.size :]), self.phi, self.gradient, self.per_frame(theta),
            Changes(self._on_top(unit), v0, C0), self.progress, self.journal, residuals,
        )  # fmt: skip
        rows /= size[:, None, None]
        return rows
