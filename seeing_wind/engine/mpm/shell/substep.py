"""One substep in time: the second-order backward difference, solved by Newton's method.

With b = 2 dt / 3, the state of the two substeps before gives x* = (4 x - x_before) / 3 and v* likewise, and the new state satisfies
x' = x* + b v', M (v' - v*) = b f(x', v') (BDF2: Gear 1971; for cloth Choi and Ko 2002, ACM Trans. Graph. 21, 604). It is stable at any
dt, and damps slow motion little: a mode of circular frequency w loses about (w dt)^3 of its amplitude in a radian's time, where the
implicit Euler rule loses w dt / 2.

Damping is Kelvin-Voigt's: stress and bending moment that follow from the change of the elastic ones over the substep, which no rotation
of the sheet causes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...errors import SimulationError
from . import bending, membrane
from .contact import Contact, touched
from .model import Shell, State
from .obstacle import Obstacle
from .system import Matrix

Load = Callable[[np.ndarray, np.ndarray, int], tuple[np.ndarray, np.ndarray | None]]
"""(x (V, 3) [m], v (V, 3) [m/s], frame) -> force on the vertices (V, 3) [N], and its damping (V, 3, 3) [N s/m], symmetric and positive
semidefinite, or None: at another velocity the force is taken as force - damping (v' - v). `wind.vertex_drag` is of this form."""

EXACT = 0.03
"""A Newton iteration that moves no vertex by more than this part of how far gravity moves one in a substep is the last: what is left
of the equations is a force of less than that part of the weight."""
LOOSE = 0.1
"""Precision to which the linear equations are solved."""
STALE = 8
"""Iterations of conjugate gradients beyond which the next iteration of Newton's makes new factors."""
MOST = 40
"""Newton iterations of a substep."""
STRAY = 0.05
"""Part of the median edge by which the last iteration may still move a vertex; beyond, there is no solution to go on from."""
SEARCH = 12
"""Places looked at along the way of a Newton iteration."""
SLACK = 0.6
"""The force along an iteration's way may be this part of the former one at its end."""


@dataclass(frozen=True)
class Effort:
    """What a substep took."""

    iterations: int
    """Newton's."""
    inner: int
    """Conjugate gradients' in all."""


@dataclass(frozen=True)
class _Equations:
    """The equations of one substep."""

    shell: Shell
    dt: float
    goal: np.ndarray
    """(V, 3) where the mass would go by itself: x* + b v* + b² gravity [m]."""
    push: np.ndarray
    """(V, 3) load at v = 0 [N]."""
    drag: np.ndarray | None
    """(V, 3, 3) [N s/m]."""
    coast: np.ndarray
    """(V, 3) x* of each vertex [m]: v' = (x' - x*) / b."""
    lag: float
    """Retardation time over dt."""
    stress: np.ndarray
    """(F, 3) elastic stress at the substep's start [N/m]."""
    curvature: np.ndarray
    """(3, F) at its start [1/m]."""
    contact: Contact

    @property
    def b(self) -> float:
        """2 dt / 3 [s]."""
        return 2.0 * self.dt / 3.0

    def force(self, x: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Minus the sum (V, 3) of all forces at x [N], zero for pinned vertices, and F and S, for `matrix`."""
        s, m = self.shell, self.shell.membrane
        F = membrane.deformation(m, x)
        S = (1.0 + self.lag) * membrane.stress(m, membrane.strain(F)) - self.lag * self.stress
        r = s.mass[:, None] / self.b**2 * (x - self.goal) - self.push
        np.add.at(r, m.faces, membrane.gradient(m, F, S))
        r += bending.gradient(s.bending, x)
        if self.lag:
            r += self.lag * bending.pull_of(s.bending, x, self.curvature)
        if self.drag is not None:
            r += np.einsum("vij,vj->vi", self.drag, (x - self.coast) / self.b)
        r += (s.mass * s.spring)[:, None] * (x - s.surface.x) + self.contact.force(x)
        r[s.pinned] = 0.0
        return r, (F, S)

    def matrix(self, x: np.ndarray, known: tuple[np.ndarray, np.ndarray], convex: bool = True) -> Matrix:
        """Derivative of `force`; without what would make it indefinite if `convex`."""
        s, m, (F, S) = self.shell, self.shell.membrane, known
        T = (1.0 + self.lag) * membrane.stress_tangent(m, membrane.strain(F))
        diagonal = self.contact.matrix(x)
        diagonal += (s.mass * (1.0 / self.b**2 + s.spring))[:, None, None] * np.eye(3)
        if self.drag is not None:
            diagonal += self.drag / self.b
        return s.system.matrix(membrane.hessian(m, F, S, T, convex), diagonal, 1.0 + self.lag)


def advance(
    shell: Shell, state: State, *, dt: float, gravity: np.ndarray, frame: int = 0, load: Load | None = None,
    pins: np.ndarray | None = None, obstacles: tuple[Obstacle, ...] = (),
) -> tuple[State, Effort]:  # fmt: skip
    """The state a substep later.

    Args:
        dt: the substep [s], the same as that between the state's two times; gravity: (3,) [m/s²].
        load: forces besides; frame: told to it.
        pins: (P, 3) where the pinned vertices are at the end [m]; None leaves them where they are.
        obstacles: what the vertices run into.

    Raises:
        SimulationError: when Newton's method finds no solution, or a number is not finite.
    """
    equations, contact = _equations(shell, state, dt, gravity, frame, load, obstacles)
    x = state.x + dt * state.v
    x[shell.pinned] = state.x[shell.pinned] if pins is None else pins
    x, effort = _solved(equations, x)
    v = (x - equations.coast) / equations.b
    # A blow leaves no smooth past behind: along the normal of what they touch, vertices go on from their new velocity alone.
    normal = touched(contact, x)
    blow = ((v - state.v) * normal).sum(axis=1, keepdims=True) * normal
    return State(x, v, np.where(normal.any(axis=1)[:, None], x - dt * v + 0.5 * dt * (v - state.v - blow), state.x), state.v + blow), effort


def _equations(
    shell: Shell, state: State, dt: float, gravity: np.ndarray, frame: int, load: Load | None, obstacles: tuple[Obstacle, ...]
) -> tuple[_Equations, Contact]:
    b = 2.0 * dt / 3.0
    coast, velocity = (4.0 * state.x - state.x_before) / 3.0, (4.0 * state.v - state.v_before) / 3.0
    push, drag = (np.zeros_like(state.x), None) if load is None else load(state.x, state.v, frame)
    if drag is not None:
        push = push + np.einsum("vij,vj->vi", drag, state.v)
    lag = shell.sheet.retardation / dt
    S = membrane.stress(shell.membrane, membrane.strain(membrane.deformation(shell.membrane, state.x)))
    k = bending.curvatures(shell.bending, state.x)
    contact = Contact.near(obstacles, state.x, state.x + dt * state.v, shell.mass / b**2, dt, shell.sheet.thickness)
    goal = coast + b * velocity + b**2 * np.asarray(gravity)
    return _Equations(shell, dt, goal, push, drag, coast, lag, S, k, contact), contact


def _solved(equations: _Equations, x: np.ndarray) -> tuple[np.ndarray, Effort]:
    """Newton's method, each iteration as long as the force along it goes down. Factors serve on while its steps are small."""
    edge, inner = equations.shell.surface.edge_length, 0
    fall = 9.81 * equations.b**2
    r, known = equations.force(x)
    factors = None
    for iteration in range(1, MOST + 1):
        matrix = equations.matrix(x, known)
        try:
            factors = factors or matrix.factors()
            way, count = matrix.solved(-r, factors, LOOSE)
        except np.linalg.LinAlgError as error:
            raise SimulationError(f"The shell's equations cannot be solved: {error}.", "Take more substeps.", quantity="force") from error
        inner += count
        moved = float(np.abs(way).max())
        x, r, known, whole = _along(equations, x, r, way)
        if moved <= EXACT * fall:
            return x, Effort(iteration, inner)
        if moved > fall or not whole or count > STALE:
            factors = None
    if moved > STRAY * edge:
        raise SimulationError("The shell finds no equilibrium within a substep.", "Take more substeps.", quantity="position")
    return x, Effort(MOST, inner)


def _along(
    equations: _Equations, x: np.ndarray, r: np.ndarray, way: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray], bool]:
    """The place on the way from x where the force along it has nearly gone, with what `_Equations.force` gives there (line search), and
    whether it is the way's end."""
    slope, low, high, length = float((way * r).sum()), 0.0, 1.0, 1.0
    at_low, at_high = slope, np.nan
    for _ in range(SEARCH):
        new, known = equations.force(x + length * way)
        along = float((way * new).sum())
        if not np.isfinite(along):
            raise SimulationError("A force on the shell is not finite.", "Take more substeps.", quantity="force")
        if abs(along) <= SLACK * abs(slope) or (along < 0.0 and length == 1.0):
            break
        if along > 0.0:
            high, at_high = length, along
        else:
            low, at_low = length, along
        secant = low + (high - low) * at_low / (at_low - at_high)
        length = min(max(secant, low + 0.1 * (high - low)), high - 0.1 * (high - low))
    return x + length * way, new, known, length == 1.0
