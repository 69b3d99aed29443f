"""Bodies that stay rigid: the rigid motion nearest to a simulation, as location and rotation keyframes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from .animation import curves_of, make_linear, remove_curves

PATHS = ("location", "rotation_quaternion")
_TURNS = ("rotation_euler", "rotation_quaternion", "rotation_axis_angle")


@dataclass(frozen=True)
class RigidFit:
    """The rigid motion nearest to a motion of vertices."""

    rotation: np.ndarray
    """(T+1, 3, 3), from frame 0."""
    translation: np.ndarray
    """(T+1, 3) [m]: x_t = rotation_t x_0 + translation_t."""
    residual: float
    """Largest distance of a vertex from that motion, over all frames [m]."""
    size: float
    """Diagonal of the box round frame 0 [m]."""


def rigid_fit(vertices: np.ndarray) -> RigidFit:
    """Least-squares fit of a rotation and translation of frame 0 to each frame of vertices (T+1, V, 3) [m].

    Kabsch's method: W. Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Cryst. A32 (1976).
    """
    centre = vertices.mean(axis=1)
    rest = vertices[0] - centre[0]
    rotation, residual = np.empty((len(vertices), 3, 3)), 0.0
    for clip_frame, moved in enumerate(vertices - centre[:, None]):
        u, _, vt = np.linalg.svd(rest.T @ moved)
        sign = np.sign(np.linalg.det(u) * np.linalg.det(vt))
        rotation[clip_frame] = vt.T @ np.diag([1.0, 1.0, sign or 1.0]) @ u.T
        off = moved - rest @ rotation[clip_frame].T
        residual = max(residual, float(np.sqrt((off * off).sum(axis=1).max())))
    translation = centre - np.einsum("tij,j->ti", rotation, centre[0])
    return RigidFit(rotation, translation, residual, float(np.linalg.norm(np.ptp(vertices[0], axis=0))))


def fit_for(obj: bpy.types.Object, vertices: np.ndarray, reshaped: bool, mark: dict[str, Any], unit: float) -> RigidFit | None:
    """The rigid motion for an object's location and rotation keyframes; None where these cannot carry the motion: the object is
    `reshaped`, and its mesh has another vertex count or shape keys of its own.

    Args:
        vertices: (T+1, V, 3) [m]; unless `reshaped`, the object at frame 0 has this shape.
        reshaped: its modifiers deform it over time and will be switched off, so the fit starts from the plain mesh.
        mark: record of its present bake.
        unit: metres per unit of the scene.
    """
    if not reshaped:
        return rigid_fit(vertices)
    if len(obj.data.vertices) != vertices.shape[1] or (obj.data.shape_keys is not None and mark.get("way") != "SHAPE_KEYS"):
        return None
    own = np.empty((vertices.shape[1], 3), dtype=np.float32)
    obj.data.vertices.foreach_get("co", own.reshape(-1))
    world = np.array(mark["former"]["world"] if "former" in mark else obj.matrix_world)
    rest = unit * (own @ world[:3, :3].T + world[:3, 3])
    fit = rigid_fit(np.concatenate([rest[None], vertices]))
    return RigidFit(fit.rotation[1:], fit.translation[1:], fit.residual, fit.size)


def obstacle(obj: bpy.types.Object, mark: dict[str, Any]) -> str:
    """Why an object cannot be moved by location and rotation keyframes; "" when it can."""
    if obj.library is not None:
        return "it is linked from another file"
    if obj.constraints:
        return "it has constraints"
    if obj.rigid_body is not None:
        return "Blender's rigid body solver moves it"
    if any(obj.delta_location) or any(obj.delta_rotation_euler) or tuple(obj.delta_scale) != (1.0, 1.0, 1.0):
        return "it has a delta transform"
    ours = PATHS if mark.get("way") == "TRANSFORM" else ()
    moving = {curve.data_path for curve in curves_of(obj)} & {"location", "scale", "delta_location", "delta_scale", *_TURNS}
    if not moving <= set(ours):
        return "it is animated already"
    data = obj.animation_data
    if data is not None and (len(data.nla_tracks) or len(data.drivers)):
        return "it is animated already"
    parent = obj.parent
    while parent is not None:
        if parent.animation_data is not None or parent.constraints or parent.rigid_body is not None:
            return f"its parent {parent.name} moves"
        parent = parent.parent
    return ""


def bake(obj: bpy.types.Object, fit: RigidFit, clip_frames: np.ndarray, frames: np.ndarray, unit: float) -> dict[str, Any]:
    """Key location and rotation (quaternion) at each frame. Returns what `clear` needs to restore the object.

    Args:
        obj: in its pose at frame 0.
        fit: the motion.
        clip_frames: indices of the frames to key.
        frames: the scene frames at which to key them.
        unit: metres per unit of the scene.
    """
    bpy.context.view_layer.update()
    former = {
        "mode": obj.rotation_mode,
        "location": list(obj.location),
        "turns": {name: list(getattr(obj, name)) for name in _TURNS},
        "world": [list(row) for row in obj.matrix_world],
    }
    basis, previous = obj.matrix_basis.copy(), None
    frame_of_parent = obj.matrix_world @ basis.inverted_safe()
    unscaled = Matrix.Diagonal((*obj.scale, 1.0)).inverted_safe()
    obj.rotation_mode = "QUATERNION"
    for clip_frame, frame in zip(clip_frames, frames):
        motion = Matrix(fit.rotation[clip_frame].tolist()).to_4x4()
        motion.translation = fit.translation[clip_frame] / unit
        placed = frame_of_parent.inverted_safe() @ motion @ frame_of_parent @ basis
        # not decompose(), which turns one mirrored axis into a point reflection
        location, rotation = placed.translation.copy(), (placed @ unscaled).to_quaternion()
        if previous is not None:
            # q and -q are the same rotation; the nearer one avoids a long turn between frames
            rotation.make_compatible(previous)
        obj.location, obj.rotation_quaternion, previous = location, rotation, rotation
        for path in PATHS:
            obj.keyframe_insert(path, frame=float(frame))
    make_linear(obj, PATHS)
    return former


def clear(obj: bpy.types.Object, former: dict[str, Any]) -> None:
    """Remove the keys and put the object back where it stood."""
    remove_curves(obj, PATHS)
    # changing the rotation mode converts the rotation, so the former values are restored last
    obj.rotation_mode, obj.location = former["mode"], former["location"]
    for name, turn in former["turns"].items():
        setattr(obj, name, turn)
    bpy.context.view_layer.update()


def is_intact(obj: bpy.types.Object) -> bool:
    """Whether location and rotation are still keyed."""
    return set(PATHS) <= {curve.data_path for curve in curves_of(obj)}
