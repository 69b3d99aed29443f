"""The derivative of one substep, exact but for contact, whose planes and friction are held.

Where r(x') = 0 are the equations of `substep`, A = dr/dx' and L(x, v, v') is the load with its damping at the end,

    A dx' = M/b² d(x* + b v*) + D/b dx* + (dL/dx - dr/dx) dx + dL/dv dv + dL,      dv' = (dx' - dx*) / b

with x and v at the substep's start, x* and v* from the two states before, and the last dL what changes besides. One set of factors of A
serves for all directions of change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import SuperLU, splu

from ....errors import SimulationError
from ..contact import touched
from ..model import Shell, State
from ..obstacle import Obstacle
from ..substep import Load, equations_of
from .blocks import diagonal
from .faces import FaceSlopes


@dataclass(frozen=True)
class Change:
    """Derivatives of a state in R directions, (V, 3, R) each."""

    x: np.ndarray
    v: np.ndarray
    x_before: np.ndarray
    v_before: np.ndarray

    @staticmethod
    def none(vertices: int, directions: int) -> Change:
        """No change."""
        return Change(*(np.zeros((vertices, 3, directions)) for _ in range(4)))


@dataclass(frozen=True)
class LoadSlopes:
    """Derivatives of force + damping (v - v') of a `Load`, with v' the velocity at the substep's end, which is held."""

    x: csr_array
    """(3 V, 3 V) by the positions at the start [N/m]."""
    v: csr_array
    """(3 V, 3 V) by the velocities at the start [N s/m]."""


@dataclass(frozen=True)
class Tangent:
    """One substep, linearised. `tangent_of` makes it."""

    dt: float
    mass: np.ndarray
    """(V,) [kg]."""
    free: np.ndarray
    """(3 V,) bool."""
    factors: SuperLU
    """Of A on the free coordinates."""
    damping: csr_array | None
    """(3 V, 3 V) [N s/m]."""
    by_start: csr_array
    """(3 V, 3 V) derivative of the forces by the positions at the start [N/m]."""
    by_velocity: csr_array | None
    """(3 V, 3 V) [N s/m]."""
    normal: np.ndarray
    """(V, 3) of what a vertex touches at the end, zero for none."""

    def carried(self, change: Change, load: np.ndarray | None = None) -> Change:
        """The change at the substep's end.

        Args:
            change: at its start, zero at pinned vertices; load: (V, 3, R) [N] what changes of the load besides, None for nothing.
        """
        dt, b, shape = self.dt, 2.0 * self.dt / 3.0, change.x.shape
        coast = (4.0 * change.x - change.x_before) / 3.0
        right = (self.mass / b**2)[:, None, None] * (coast + b * (4.0 * change.v - change.v_before) / 3.0)
        right = right.reshape(-1, shape[2]) + self.by_start @ change.x.reshape(-1, shape[2])
        if self.damping is not None:
            right += self.damping @ (coast.reshape(-1, shape[2]) / b)
        if self.by_velocity is not None:
            right += self.by_velocity @ change.v.reshape(-1, shape[2])
        if load is not None:
            right += load.reshape(-1, shape[2])
        x = np.zeros_like(right)
        x[self.free] = self.factors.solve(right[self.free])
        x = x.reshape(shape)
        v = (x - coast) / b
        x_before, v_before = change.x, change.v
        if self.normal.any():
            n, on = self.normal[:, :, None], self.normal.any(axis=1)[:, None, None]
            blow = ((v - change.v) * n).sum(axis=1, keepdims=True) * n
            x_before = np.where(on, x - dt * v + 0.5 * dt * (v - change.v - blow), change.x)
            v_before = change.v + blow
        return Change(x, v, x_before, v_before)


def tangent_of(
    shell: Shell, slopes: FaceSlopes, state: State, after: State, *, dt: float, gravity: np.ndarray, frame: int = 0,
    load: Load | None = None, load_slopes: LoadSlopes | None = None, obstacles: tuple[Obstacle, ...] = (),
) -> Tangent:  # fmt: skip
    """The derivative of the substep that led from `state` to `after`.

    Args:
        slopes: of the shell; the other arguments are those of `advance`.
        load_slopes: of the load; None for one that does not depend on the shell.

    Raises:
        SimulationError: where the equations are singular.
    """
    equations, contact = equations_of(shell, state, dt, gravity, frame, load, obstacles)
    b, lag, x = equations.b, equations.lag, after.x
    faces = equations.force(x)[1]
    diagonals = contact.matrix(x) + (shell.mass * (1.0 / b**2 + shell.spring))[:, None, None] * np.eye(3)
    damping = None
    if equations.drag is not None:
        diagonals = diagonals + equations.drag / b
        damping = diagonal(equations.drag)
    matrix = slopes.at_end(x, faces, lag, equations.before) + diagonal(diagonals)
    by_start = csr_array((3 * len(x), 3 * len(x)))
    if lag:
        by_start = by_start - slopes.at_start(x, faces, lag, state.x, equations.before)
    if load_slopes is not None:
        by_start = by_start + load_slopes.x
    by_velocity = None if load_slopes is None else load_slopes.v
    free = np.repeat(~shell.pinned, 3)
    return Tangent(dt, shell.mass, free, factors_of(matrix, free), damping, by_start, by_velocity, touched(contact, x))


def factors_of(matrix: csr_array, free: np.ndarray) -> SuperLU:
    """Factors of the rows and columns of `free` (n,) bool.

    Raises:
        SimulationError: for a singular matrix.
    """
    kept = matrix[free][:, free].tocsc()
    try:
        return splu(kept, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError as error:
        raise SimulationError("The shell's motion has no derivative: its equations are singular.", "Take more substeps.") from error
