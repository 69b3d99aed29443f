"""What may load a sheet: air that moves at u, or a force of its own. Both are fields over the sheet with three components."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from scipy.sparse import csr_array, diags_array

from ....mpm.shell import Load, Shell, State
from ....mpm.shell.tangent import Corners, LoadSlopes
from ....mpm.shell.tangent.blocks import diagonal
from ..drag import AIR, DragLaw, drag_slopes, vertex_drag


class Cause(ABC):
    """How a field (V, 3) at the vertices loads them."""

    @abstractmethod
    def load(self, field: np.ndarray) -> Load:
        """For `mpm.shell.advance`."""

    @abstractmethod
    def slopes(self, field: np.ndarray, state: State, after: State) -> tuple[LoadSlopes, csr_array]:
        """Derivatives by the state at the start, and (3 V, 3 V) by the field."""

    def force(self, field: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(V, 3) [N] at places x (V, 3) [m] that move at v (V, 3) [m/s]."""
        return self.load(field)(x, v, 0)[0]


class Air(Cause):
    """The field is the wind [m/s]."""

    def __init__(self, shell: Shell, law: DragLaw = AIR) -> None:
        self._faces, self._law = shell.surface.faces, law
        self._corners = Corners(self._faces, len(shell.mass))

    def load(self, field: np.ndarray) -> Load:
        return lambda x, v, frame: vertex_drag(field, x, v, self._faces, self._law)

    def slopes(self, field: np.ndarray, state: State, after: State) -> tuple[LoadSlopes, csr_array]:
        found = drag_slopes(field, state.x, state.v, after.v, self._faces, self._law)
        by_wind = self._corners.assembled(found.wind)
        lumped = diagonal(vertex_drag(field, state.x, state.v, self._faces, self._law)[1])
        return LoadSlopes(self._corners.assembled(found.x), csr_array(lumped - by_wind)), by_wind


class Push(Cause):
    """The field is an acceleration [m/s²], whatever gives it."""

    def __init__(self, shell: Shell) -> None:
        self._mass = shell.mass
        count = 3 * len(shell.mass)
        self._none = csr_array((count, count))
        self._by_field = csr_array(diags_array(np.repeat(shell.mass, 3)))

    def load(self, field: np.ndarray) -> Load:
        force = self._mass[:, None] * field
        return lambda x, v, frame: (force, None)

    def slopes(self, field: np.ndarray, state: State, after: State) -> tuple[LoadSlopes, csr_array]:
        return LoadSlopes(self._none, self._none), self._by_field
