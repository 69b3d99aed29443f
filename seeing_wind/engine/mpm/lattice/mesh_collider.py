"""Closed meshes as colliders, still or moving; and the kinds of contact of any collider."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace

import numpy as np

from ...conventions import FARTHEST
from ...errors import UsageError
from .closed_mesh import is_closed, signed_volume, triangle_areas, weld
from .conditions import SEPARATE, SLIP, STICKY

KINDS = {"sticky": STICKY, "slip": SLIP, "separate": SEPARATE}
"""Kinds of contact."""


@dataclass(frozen=True, eq=False)
class MeshCollider:
    """A closed mesh; matter stays outside. Compared by identity, so that the samples of a mesh that stands still can be cached."""

    vertices: np.ndarray
    """(V, 3) [m]."""
    faces: np.ndarray
    """(M, 3) int triangles, consistently wound; vertices at the same place count as one."""
    kind: str = "separate"
    """As in `colliders.Plane`."""
    friction: float = 0.0
    """As in `colliders.Plane`."""
    path: np.ndarray | None = None
    """(T+1, V, 3) [m] where the vertices are at every frame, in straight lines between; None for a mesh that stands still."""
    corners: np.ndarray = field(init=False, repr=False)
    """(M, 3, 3) corners of the triangles that have an area [m]."""
    velocity: np.ndarray | None = field(init=False, repr=False, default=None)
    """(V, 3) of the vertices [m/s], for a mesh returned by `posed`; else None."""

    def __post_init__(self) -> None:
        """UsageError: see `check_kind`; also for a mesh that is open, empty, flat, not finite, or refers to missing vertices, and for a
        path that has another number of vertices, is not finite, or leads too far."""
        check_kind("mesh collider", self.kind, self.friction)
        vertices, faces = np.asarray(self.vertices), np.asarray(self.faces)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
            message = f"A collider's mesh has vertices of shape {vertices.shape} and faces of shape {faces.shape}."
            raise UsageError(message, "Give (V, 3) positions and (M, 3) triangles, at least four of them.")
        if vertices.dtype.kind not in "fiu" or not np.isfinite(vertices).all():
            raise UsageError("A vertex of a collider's mesh is not finite.", "Check the mesh and the object's transform.")
        if faces.dtype.kind not in "iu" or faces.min() < 0 or faces.max() >= len(vertices):
            raise UsageError(
                f"A face of a collider's mesh refers to a vertex that does not exist; there are {len(vertices)}.", "Export the mesh again."
            )
        path = None if self.path is None else _checked_path(self.path, len(vertices))
        vertices = vertices.astype(np.float64) if path is None else path[0]
        solid = weld(vertices, faces)
        solid = solid[(solid != np.roll(solid, 1, axis=1)).all(axis=1)]
        if not len(solid) or not is_closed(solid):
            raise UsageError(
                "A collider's mesh is open, or its faces do not all face the same way.",
                "Close its holes and recalculate its normals (Mesh > Normals > Recalculate Outside), or use a plane (in the panel: Floor).",
            )
        size = float(np.ptp(vertices, axis=0).max())
        if not abs(signed_volume(vertices, faces)) > 1e-9 * size**3:
            raise UsageError("A collider's mesh encloses no volume.", "Give it a thickness, or use a plane (in the panel: Floor).")
        object.__setattr__(self, "path", path)
        object.__setattr__(self, "faces", faces.astype(np.int64))
        self._place(vertices)

    def _place(self, vertices: np.ndarray) -> None:
        """Put the vertices at (V, 3) [m]."""
        size = float(np.ptp(vertices, axis=0).max())
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "corners", vertices[self.faces[triangle_areas(vertices, self.faces)[0] > 1e-14 * size**2]])

    def posed(self, time: float, frame_dt: float) -> MeshCollider:
        """The mesh at a time [frames], with its velocity; a frame lasts `frame_dt` [s]. After the end of its path it stands still."""
        if self.path is None:
            return self
        frame = min(max(int(time), 0), len(self.path) - 2)
        share = min(max(time - frame, 0.0), 1.0)
        one = copy.copy(self)  # the mesh has been checked already
        one._place((1.0 - share) * self.path[frame] + share * self.path[frame + 1])
        away = self.path[frame + 1] - self.path[frame]
        object.__setattr__(one, "velocity", away / frame_dt if time <= len(self.path) - 1 else np.zeros_like(away))
        object.__setattr__(one, "path", None)
        return one

    def delayed(self, frames: int) -> MeshCollider:
        """The same collider, but it begins to move so many frames later."""
        if self.path is None or not frames:
            return self
        return replace(self, path=np.concatenate([np.repeat(self.path[:1], frames, axis=0), self.path]))

    def farthest(self, frame: int) -> float:
        """The farthest that a vertex moves in a frame [m]; 0 after the end of the path."""
        if self.path is None or frame + 1 >= len(self.path):
            return 0.0
        return float(np.linalg.norm(self.path[frame + 1] - self.path[frame], axis=1).max())


def _checked_path(path: np.ndarray, count: int) -> np.ndarray:
    path = np.asarray(path)
    if path.ndim != 3 or path.shape[1:] != (count, 3) or len(path) < 2 or path.dtype.kind != "f":
        raise UsageError(
            f"The path of a collider's mesh is {path.dtype} of shape {path.shape}.", f"It must be (T+1, {count}, 3), in metres."
        )
    if not np.isfinite(path).all() or np.abs(path).max() > FARTHEST:
        raise UsageError("The path of a collider's mesh is not finite, or leads too far.", "Check the animation, and the unit: metres.")
    return path.astype(np.float64)


def check_kind(what: str, kind: str, friction: float) -> None:
    """Raises UsageError for an unknown kind, or a friction that is negative or not finite; `what` names the collider."""
    if kind not in KINDS:
        raise UsageError(f"The {what} is {kind!r}.", f"Choose one of {', '.join(KINDS)}.")
    if not (np.isfinite(friction) and friction >= 0.0):
        raise UsageError(f"The friction of the {what} is {friction}.", "Give a finite number that is not negative; 0 is none.")
