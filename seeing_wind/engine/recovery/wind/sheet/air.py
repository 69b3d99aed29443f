"""What may load a sheet: air that moves at u, or a force of its own. Both are fields over the sheet with three components."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ....mpm.shell import Load, Shell
from ..drag import area_normals, face_damping, face_force_derivative, vertex_drag


class Cause(ABC):
    """How a field (V, 3) at the vertices loads them."""

    @abstractmethod
    def load(self, field: np.ndarray) -> Load:
        """For `mpm.shell.advance`."""

    @abstractmethod
    def tested(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray) -> np.ndarray:
        """Its forces in virtual displacements (V, Q), (..., Q, 3), on vertices at x [m] that move at v [m/s], (..., V, 3) as the field."""

    @abstractmethod
    def slopes(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray, shapes: np.ndarray) -> np.ndarray:
        """Their derivative (..., Q, 3, P, 3) by the coefficients of the field's modes (V, P)."""

    def force(self, field: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(V, 3) [N] at places x (V, 3) [m] that move at v (V, 3) [m/s]."""
        return self.load(field)(x, v, 0)[0]


class Air(Cause):
    """The field is the wind [m/s]."""

    def __init__(self, shell: Shell) -> None:
        self._faces = shell.surface.faces

    def load(self, field: np.ndarray) -> Load:
        return lambda x, v, frame: vertex_drag(field, x, v, self._faces)

    def tested(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray) -> np.ndarray:
        w, normals = self._passing(field, x, v)
        force = (face_damping(w, normals) @ w[..., None])[..., 0]
        return tests[self._faces].mean(axis=1).T @ force

    def slopes(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray, shapes: np.ndarray) -> np.ndarray:
        slope = face_force_derivative(*self._passing(field, x, v))
        here = shapes[self._faces].mean(axis=1)
        spread = slope[..., None, :, :] * here[:, :, None, None]  # (..., F, P, 3, 3)
        flat = tests[self._faces].mean(axis=1).T @ spread.reshape(*slope.shape[:-2], -1)
        return flat.reshape(*flat.shape[:-1], here.shape[1], 3, 3).swapaxes(-3, -2)

    def _passing(self, field: np.ndarray, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Air that passes the faces (..., F, 3) [m/s], and their normals times areas [m²]."""
        return (field - v)[..., self._faces, :].mean(axis=-2), area_normals(x, self._faces)


class Push(Cause):
    """The field is an acceleration [m/s²], whatever gives it."""

    def __init__(self, shell: Shell) -> None:
        self._mass = shell.mass

    def load(self, field: np.ndarray) -> Load:
        force = self._mass[:, None] * field
        return lambda x, v, frame: (force, None)

    def tested(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray) -> np.ndarray:
        return np.broadcast_to((self._mass[:, None] * tests).T @ field, (*x.shape[:-2], tests.shape[1], 3))

    def slopes(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray, shapes: np.ndarray) -> np.ndarray:
        by_mode = tests.T @ (self._mass[:, None] * shapes)
        whole = np.einsum("qp,ij->qipj", by_mode, np.eye(3))
        return np.broadcast_to(whole, (*x.shape[:-2], *whole.shape))
