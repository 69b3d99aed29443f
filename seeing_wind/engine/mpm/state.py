"""What changes during a simulation: the state of its particles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class State:
    """Particles at one instant."""

    x: np.ndarray
    """(N, 3) positions [m]."""
    v: np.ndarray
    """(N, 3) velocities [m/s]."""
    C: np.ndarray
    """(N, 3, 3) affine velocities, C[i, j] = d v_i / d x_j [1/s]."""
    F: np.ndarray
    """(N, 3, 3) deformation gradients."""

    @staticmethod
    def at_rest(x: np.ndarray, v: np.ndarray | None = None, spin: np.ndarray | None = None) -> State:
        """Undeformed particles at x (N, 3) [m] with velocity v (3,) or (N, 3) [m/s], turning with `spin` (3,) [rad/s] about their mean."""
        x = np.array(x, dtype=np.float64)
        velocity = np.zeros_like(x) + (0.0 if v is None else np.asarray(v, dtype=np.float64))
        C = np.zeros((len(x), 3, 3))
        if spin is not None:
            wx, wy, wz = (float(s) for s in spin)
            C[:] = [[0.0, -wz, wy], [wz, 0.0, -wx], [-wy, wx, 0.0]]
            velocity = velocity + (x - x.mean(axis=0)) @ C[0].T
        return State(x, velocity, C, np.tile(np.eye(3), (len(x), 1, 1)))


    def turned(self, axes: np.ndarray) -> State:
        """The same state in coordinates along `axes` (3, 3), three orthonormal columns; the rest shape keeps its coordinates."""
        return State(self.x @ axes, self.v @ axes, axes.T @ self.C @ axes, axes.T @ self.F)


@dataclass(frozen=True)
class Trajectory:
    """States at T + 1 frames."""

    x: np.ndarray
    """(T+1, N, 3) [m]."""
    v: np.ndarray
    """(T+1, N, 3) [m/s]."""
    C: np.ndarray
    """(T+1, N, 3, 3) [1/s]."""
    F: np.ndarray
    """(T+1, N, 3, 3)."""
    substeps: np.ndarray
    """(T,) substeps that each frame took: the model's, or twice that where they were too long."""

    @staticmethod
    def of(states: Sequence[State], substeps: int = 0) -> Trajectory:
        """The trajectory through these states, with so many substeps in each frame."""
        x, v, C, F = (np.stack([getattr(one, name) for one in states]) for name in ("x", "v", "C", "F"))
        return Trajectory(x, v, C, F, np.full(len(states) - 1, substeps))

    def turned(self, axes: np.ndarray) -> Trajectory:
        """As `State.turned`."""
        return Trajectory(self.x @ axes, self.v @ axes, axes.T @ self.C @ axes, axes.T @ self.F, self.substeps)

    @property
    def frames(self) -> int:
        """T."""
        return len(self.x) - 1

    def state(self, frame: int) -> State:
        """The state at frame `frame`."""
        return State(self.x[frame], self.v[frame], self.C[frame], self.F[frame])
