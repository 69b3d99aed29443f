"""What may load a sheet: air that moves at u, or a force without a drag law. Both are fields over the sheet with three components."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ....mpm.shell import Load, Shell
from ..drag import area_normals, face_damping, face_force_derivative, vertex_drag


class Cause(ABC):
    """A law by which a field (..., V, 3) at the vertices loads them."""

    @abstractmethod
    def load(self, field: np.ndarray) -> Load:
        """The load of a field (V, 3) for `mpm.shell.advance`."""

    @abstractmethod
    def generalised_forces(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray) -> np.ndarray:
        """Generalised forces (..., Q, 3) of the field in the virtual displacements `tests` (V, Q), for vertices at x [m] moving at v [m/s],
        both (..., V, 3)."""

    @abstractmethod
    def slopes(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray, shapes: np.ndarray) -> np.ndarray:
        """Derivatives (..., Q, 3, P, 3) of the generalised forces by the coefficients of the field's modes `shapes` (V, P)."""

    def force(self, field: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Forces (V, 3) [N] on vertices at x (V, 3) [m] moving at v (V, 3) [m/s]."""
        return self.load(field)(x, v, 0)[0]


class Air(Cause):
    """The field is the wind [m/s]."""

    def __init__(self, shell: Shell) -> None:
        self._faces = shell.surface.faces

    def load(self, field: np.ndarray) -> Load:
        return lambda x, v, frame: vertex_drag(field, x, v, self._faces)

    def generalised_forces(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray) -> np.ndarray:
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
        """Wind relative to the faces (..., F, 3) [m/s], and the faces' unit normals times areas (..., F, 3) [m²]."""
        return (field - v)[..., self._faces, :].mean(axis=-2), area_normals(x, self._faces)


class Push(Cause):
    """The field is an acceleration [m/s²], whatever its cause."""

    def __init__(self, shell: Shell) -> None:
        self._mass = shell.mass

    def load(self, field: np.ndarray) -> Load:
        force = self._mass[:, None] * field
        return lambda x, v, frame: (force, None)

    def generalised_forces(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray) -> np.ndarray:
        return np.broadcast_to((self._mass[:, None] * tests).T @ field, (*x.shape[:-2], tests.shape[1], 3))

    def slopes(self, field: np.ndarray, x: np.ndarray, v: np.ndarray, tests: np.ndarray, shapes: np.ndarray) -> np.ndarray:
        by_mode = tests.T @ (self._mass[:, None] * shapes)
        whole = np.einsum("qp,ij->qipj", by_mode, np.eye(3))
        return np.broadcast_to(whole, (*x.shape[:-2], *whole.shape))
