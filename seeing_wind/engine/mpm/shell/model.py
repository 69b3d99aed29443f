"""A shell (what stays the same while it moves), and its state (what changes)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...materials import Sheet
from .bending import Bending, bending
from .forces import Forces
from .linear import System
from .membrane import Membrane, membrane
from .surface import Surface, surface_of


@dataclass(frozen=True)
class Shell:
    """A sheet of some shape at rest, held at some vertices. `shell_of` makes it."""

    surface: Surface
    sheet: Sheet
    mass: np.ndarray
    """(V,) a third of the mass of the faces around each vertex [kg]."""
    membrane: Membrane
    bending: Bending
    pinned: np.ndarray
    """(V,) bool: whether a vertex's motion is given."""
    spring: np.ndarray
    """(V,) squared angular frequency of the spring that pulls a vertex towards its place at rest [1/s²]; 0 for none."""
    forces: Forces
    system: System


@dataclass(frozen=True)
class State:
    """A shell at one time and one substep before, which the second-order rule in time needs."""

    x: np.ndarray
    """(V, 3) [m]."""
    v: np.ndarray
    """(V, 3) [m/s]."""
    x_before: np.ndarray
    """(V, 3) a substep ago [m]."""
    v_before: np.ndarray
    """(V, 3) a substep ago [m/s]."""


def shell_of(
    vertices: np.ndarray, faces: np.ndarray, sheet: Sheet, *, pinned: np.ndarray | None = None, spring: np.ndarray | None = None
) -> Shell:
    """A sheet whose shape at rest is a mesh.

    Args:
        vertices: (V, 3) [m]; faces: (F, 3).
        pinned: (V,) bool; None for no pinned vertices. spring: (V,) as in `Shell`; None for none.

    Raises:
        UsageError: for a mesh that cannot be a sheet, see `surface_of`.
    """
    surface = surface_of(vertices, faces)
    mass = np.bincount(surface.faces.ravel(), np.repeat(surface.area, 3) / 3.0) * sheet.areal_density
    plate = sheet.bending_stiffness / (1.0 - sheet.poisson_ratio**2)
    m = membrane(surface, sheet.tensile_stiffness, sheet.poisson_ratio, plate)
    count = len(mass)
    held = np.zeros(count, dtype=bool) if pinned is None else np.asarray(pinned, dtype=bool)
    b = bending(surface, m, plate, held)
    springs = np.zeros(count) if spring is None else np.asarray(spring, dtype=np.float64)
    return Shell(surface, sheet, mass, m, b, held, springs, Forces(m, b, count), System(surface, m.slope, b, plate, held))


def with_past(x: np.ndarray, v: np.ndarray, acceleration: np.ndarray, dt: float) -> State:
    """The state at x [m] moving at v [m/s] if `acceleration` [m/s²], all (V, 3), was constant during the last substep dt [s]."""
    return State(x, v, x - dt * v + 0.5 * dt**2 * acceleration, v - dt * acceleration)


def at_rest(shell: Shell, velocity: np.ndarray | None = None, acceleration: np.ndarray | None = None, *, dt: float = 0.0) -> State:
    """The state of the shell in its shape at rest, moving at velocity (V, 3) [m/s] if `acceleration` (V, 3) [m/s²] was constant during the
    last substep dt [s]. Pinned vertices do not move; None is zero."""
    x = shell.surface.x
    v = np.zeros_like(x) if velocity is None else np.where(shell.pinned[:, None], 0.0, velocity)
    a = np.zeros_like(x) if acceleration is None else np.where(shell.pinned[:, None], 0.0, acceleration)
    return with_past(x, v, a, dt)
