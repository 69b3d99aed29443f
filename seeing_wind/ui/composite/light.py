"""Where the clip's light came from, as far as the shading of its object tells."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Vector

from ..clip.clip_scene import PICTURE_COLOUR

EXPLAINED = 0.3
"""Share of the brightness that must follow the surface's direction. Below it is the object's own pattern that is seen, no shading."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def sun_of(obj: bpy.types.Object | None) -> Vector | None:
    """The direction towards the light, in the world, or None where the shading does not tell.

    A matt surface's brightness is linear in the cosine between its normal and the light, so the gradient of a straight line fitted through
    the brightness over the normals points to the light (Lambert's law, with the sky as the constant).
    """
    colours = obj.data.attributes.get(PICTURE_COLOUR) if obj is not None and obj.type == "MESH" else None
    if colours is None or len(obj.data.vertices) < 12:
        return None
    count = len(obj.data.vertices)
    flat, normals = np.empty(4 * count, dtype=np.float32), np.empty(3 * count, dtype=np.float32)
    colours.data.foreach_get("color", flat)
    obj.data.vertex_normals.foreach_get("vector", normals)
    bright = flat.reshape(-1, 4)[:, :3] @ LUMINANCE
    table = np.concatenate([normals.reshape(-1, 3), np.ones((count, 1))], axis=1)
    spread = float(((bright - bright.mean()) ** 2).sum())
    # a ridge keeps directions in which the normals hardly vary from deciding
    ridge = 0.02 * count * np.diag([1.0, 1.0, 1.0, 0.0])
    found = np.linalg.solve(table.T @ table + ridge, table.T @ bright)
    rest = float(((bright - table @ found) ** 2).sum())
    way = Vector(found[:3].tolist())
    if spread <= 1e-9 or 1.0 - rest / spread < EXPLAINED or way.length < 1e-6:
        return None
    way = obj.matrix_world.to_3x3() @ way.normalized()
    # a light from below is a bright floor, not the sun
    return way.normalized() if way.z > 0.0 else None
