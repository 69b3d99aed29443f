"""One substep in time: the second-order backward difference, solved by Newton's method.

With b = 2 dt / 3, the last two states give x* = (4 x - x_before) / 3 and v* likewise, and the new state satisfies
x' = x* + b v', M (v' - v*) = b f(x', v') (BDF2: Gear 1971; for cloth Choi and Ko 2002, ACM Trans. Graph. 21, 604). The rule is stable at
any dt and damps slow motion little: per radian of oscillation, a mode of angular frequency w loses (w dt)^3 / 4 of its amplitude, where
the implicit Euler rule loses w dt / 2.

Damping is of Kelvin-Voigt type: a stress and a bending moment in proportion to the change of the elastic ones over the substep. A rotation
of the sheet does not cause any.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...errors import SimulationError
from .contact import Contact, contact_normals
from .forces import Faces
from .linear import Factors, Matrix, Unfinished
from .model import Shell, State
from .obstacle import Obstacle

Load = Callable[[np.ndarray, np.ndarray, int], tuple[np.ndarray, np.ndarray | None]]
"""(x (V, 3) [m], v (V, 3) [m/s], frame) -> force on the vertices (V, 3) [N], and its damping (V, 3, 3) [N s/m], symmetric and positive
semidefinite, or None: at another velocity v' the force is taken as force - damping (v' - v). `wind.vertex_drag` has this form. A substep
evaluates it at the velocity extrapolated from the last two, so that drag is of second order in dt like everything else (Ascher, Ruuth and
Wetton 1995, SIAM J. Numer. Anal. 32, 797)."""

EXACT = 0.03
"""Newton's method ends with the iteration that moves no vertex by more than this fraction of the distance that gravity moves it in a
substep: the residual force is then less than the same fraction of the weight."""
LOOSE = 0.2
"""Relative tolerance of the linear solve, before the last step of conjugate gradients."""
STALE = 4
"""Iterations of conjugate gradients beyond which the next Newton iteration computes new factors."""
PATIENCE = 6
"""Iterations of conjugate gradients after which old factors are replaced at once."""
FAR = 3.0
"""After a Newton iteration that moves a vertex farther than this many times the distance that gravity does in a substep, the next one
computes new factors."""
MOST = 40
"""Newton iterations in a substep, at most."""
STRAY = 0.05
"""Fraction of the median edge by which the last iteration may still move a vertex; if it moves one farther, the substep has no solution."""
SEARCH = 12
"""Trials of the line search in a Newton iteration, at most."""
TOO_WILD = "The sheet moves too wildly to be followed"
CALMER = (
    "Check that its weight and stiffness are those of a sheet; else lower the field's strength or the sheet's speed, let it settle first "
    "(Pre-roll), or use a mesh with more even faces."
)
SLACK = 0.6
"""The line search accepts a place where the force along its direction is at most this fraction of that at its start."""


@dataclass(frozen=True)
class Effort:
    """The iterations that a substep took."""

    iterations: int
    """Newton iterations."""
    inner: int
    """Iterations of conjugate gradients, in total."""


@dataclass(frozen=True)
class _Equations:
    """The equations of one substep."""

    shell: Shell
    dt: float
    goal: np.ndarray
    """(V, 3) where the vertices would go by inertia and gravity alone: x* + b v* + b² gravity [m]."""
    push: np.ndarray
    """(V, 3) load at v = 0 [N]."""
    drag: np.ndarray | None
    """(V, 3, 3) damping of the load [N s/m]; None for none."""
    coast: np.ndarray
    """(V, 3) x* of each vertex [m]: v' = (x' - x*) / b."""
    lag: float
    """Retardation time over dt."""
    before: Faces
    """The faces at the substep's start."""
    contact: Contact

    @property
    def b(self) -> float:
        """2 dt / 3 [s]."""
        return 2.0 * self.dt / 3.0

    def force(self, x: np.ndarray) -> tuple[np.ndarray, Faces]:
        """Minus the sum (V, 3) of all forces at x [N], zero for pinned vertices, and the faces there, for `matrix`."""
        s = self.shell
        faces = s.forces.faces(x, self.lag, self.before)
        r = s.forces.at_vertices(x, s.mass / self.b**2, self.goal, self.push, faces)
        if self.drag is not None:
            r += np.einsum("vij,vj->vi", self.drag, (x - self.coast) / self.b)
        if s.spring.any():
            r += (s.mass * s.spring)[:, None] * (x - s.surface.x)
        r += self.contact.force(x)
        r[s.pinned] = 0.0
        return r, faces

    def match_momentum(self, x: np.ndarray, r: np.ndarray) -> np.ndarray:
        """The positions x (V, 3), shifted as a whole so that the momentum is exact; r (V, 3) is `force` at x, and its sum then vanishes.

        Otherwise the residual of Newton's method would push a stiff sheet by up to `EXACT` of its weight. A sheet with pins, springs or
        contact is left as it is.
        """
        s = self.shell
        if s.pinned.any() or s.spring.any() or len(self.contact.vertex):
            return x
        whole = s.mass.sum() / self.b**2 * np.eye(3)
        if self.drag is not None:
            whole = whole + self.drag.sum(axis=0) / self.b
        return x - np.linalg.solve(whole, r.sum(axis=0))

    def matrix(self, x: np.ndarray, faces: Faces, stress: np.ndarray | None = None, convex: bool = True) -> Matrix:
        """Derivative of `force`; if `convex`, without the terms that could make it indefinite.

        stress: (F, 3) [N/m]; None takes that of `faces`.
        """
        s = self.shell
        diagonal = self.contact.matrix(x)
        diagonal += (s.mass * (1.0 / self.b**2 + s.spring))[:, None, None] * np.eye(3)
        if self.drag is not None:
            diagonal += self.drag / self.b
        tangents = s.forces.tangents(faces.F, faces.stress if stress is None else stress, self.lag, convex)
        return s.system.matrix(faces.F, tangents, diagonal, 1.0 + self.lag)


def advance(
    shell: Shell, state: State, *, dt: float, gravity: np.ndarray, frame: int = 0, load: Load | None = None,
    pins: np.ndarray | None = None, obstacles: tuple[Obstacle, ...] = (),
) -> tuple[State, Effort]:  # fmt: skip
    """The state a substep later.

    Args:
        dt: the substep [s], which must also be the time between the two times of `state`; gravity: (3,) [m/s²].
        load: further forces; frame: passed on to it.
        pins: (P, 3) where the pinned vertices are at the end [m]; None leaves them where they are.
        obstacles: what the vertices may run into.

    Raises:
        SimulationError: when Newton's method finds no solution, or a number is not finite.
    """
    equations, contact = equations_of(shell, state, dt, gravity, frame, load, obstacles)
    x = state.x + dt * state.v
    x[shell.pinned] = state.x[shell.pinned] if pins is None else pins
    x, effort = _newton(equations, x)
    v = (x - equations.coast) / equations.b
    # After an impact the past is not smooth: along the normal of the contact, vertices go on from their new velocity alone.
    normal = contact_normals(contact, x)
    blow = ((v - state.v) * normal).sum(axis=1, keepdims=True) * normal
    return State(x, v, np.where(normal.any(axis=1)[:, None], x - dt * v + 0.5 * dt * (v - state.v - blow), state.x), state.v + blow), effort


def equations_of(
    shell: Shell, state: State, dt: float, gravity: np.ndarray, frame: int, load: Load | None, obstacles: tuple[Obstacle, ...]
) -> tuple[_Equations, Contact]:
    """The equations for the positions at the end of a substep of dt [s] in frame `frame`, and their contact."""
    b = 2.0 * dt / 3.0
    coast, velocity = (4.0 * state.x - state.x_before) / 3.0, (4.0 * state.v - state.v_before) / 3.0
    ahead = 2.0 * state.v - state.v_before
    push, drag = (np.zeros_like(state.x), None) if load is None else load(state.x + dt * state.v, ahead, frame)
    if drag is not None:
        push = push + np.einsum("vij,vj->vi", drag, ahead)
    lag = shell.sheet.retardation / dt
    contact = Contact.near(obstacles, state.x, state.x + dt * state.v, shell.mass / b**2, dt, shell.sheet.thickness)
    goal = coast + b * velocity + b**2 * np.asarray(gravity)
    return _Equations(shell, dt, goal, push, drag, coast, lag, shell.forces.faces(state.x), contact), contact


def _newton(equations: _Equations, x: np.ndarray) -> tuple[np.ndarray, Effort]:
    """Newton's method from x (V, 3), with a line search. Factors are reused while its steps are small.

    It starts where the vertices would go straight on; there a sheet that turns is stretched by far more than its load stretches it. This
    tension is gone after the first iteration and would only make the sheet too stiff across it, so the first iteration uses the tension of
    the substep's start.
    """
    edge, inner = equations.shell.surface.edge_length, 0
    fall = 9.81 * equations.b**2
    r, known = equations.force(x)
    factors: Factors | None = None
    stress: np.ndarray | None = equations.before.stress
    for iteration in range(1, MOST + 1):
        matrix = equations.matrix(x, known, stress)
        try:
            way, count, factors = _way(matrix, -r, factors)
        except np.linalg.LinAlgError as error:
            unsolved = f"{TOO_WILD}: the equations of a substep cannot be solved ({error})."
            raise SimulationError(unsolved, CALMER, quantity="force") from error
        inner += count
        moved = float(np.abs(way).max())
        x, r, known, whole = _along(equations, x, r, way)
        if moved <= EXACT * fall:
            return equations.match_momentum(x, r), Effort(iteration, inner)
        if moved > FAR * fall or not whole or count > STALE:
            factors = None
        stress = None
    if moved > STRAY * edge:
        raise SimulationError(f"{TOO_WILD}: no equilibrium of its forces is found within a substep.", CALMER, quantity="position")
    return equations.match_momentum(x, r), Effort(MOST, inner)


def _way(matrix: Matrix, right: np.ndarray, old: Factors | None) -> tuple[np.ndarray, int, Factors]:
    """The solution (V, 3) of matrix x = right, the iterations it took, and the factors it ended with: new ones where `old` do not suffice.

    Raises:
        numpy.linalg.LinAlgError: when there is no solution.
    """
    begun, tried = np.zeros_like(right), 0
    if old is not None:
        try:
            return *matrix.solve(right, old, LOOSE, PATIENCE), old
        except Unfinished as reached:
            begun, tried = reached.x, PATIENCE
    factors = matrix.factors()
    rest, count = matrix.solve(right - matrix.times(begun) if tried else right, factors, LOOSE)
    return begun + rest, tried + count, factors


def _along(equations: _Equations, x: np.ndarray, r: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray, Faces, bool]:
    """Line search from x along `way`, both (V, 3), for the place where the force along `way` nearly vanishes; r (V, 3) is `force` at x.

    Returns the place, what `_Equations.force` gives there, and whether the place is the end of `way`.
    """
    slope, low, high, length = float((way * r).sum()), 0.0, 1.0, 1.0
    at_low, at_high = slope, np.nan
    for _ in range(SEARCH):
        new, known = equations.force(x + length * way)
        along = float((way * new).sum())
        if not np.isfinite(along):
            raise SimulationError(f"{TOO_WILD}: a force on it is not finite.", CALMER, quantity="force")
        if abs(along) <= SLACK * abs(slope) or (along < 0.0 and length == 1.0):
            break
        if along > 0.0:
            high, at_high = length, along
        else:
            low, at_low = length, along
        secant = low + (high - low) * at_low / (at_low - at_high)
        length = min(max(secant, low + 0.1 * (high - low)), high - 0.1 * (high - low))
    return x + length * way, new, known, length == 1.0
