"""What an object says of the bake that it carries. Without NumPy: the status of a scene asks for it at every change."""

from __future__ import annotations

import json
from typing import Any

import bpy

MARK = "seeing_wind_bake"
"""Custom property of an object that carries a bake: JSON of how it was made, and of what to restore."""

SHAPE_KEYS, POINT_CACHE, TRANSFORM, ALEMBIC, AUTO = "SHAPE_KEYS", "POINT_CACHE", "TRANSFORM", "ALEMBIC", "AUTO"


def mark_of(obj: bpy.types.Object) -> dict[str, Any] | None:
    """How the bake that an object carries was made; None for no bake."""
    text = obj.get(MARK)
    if text is None:
        return None
    if text.startswith("{"):
        return json.loads(text)
    # before 0.2: the names of the sleeping modifiers, one per line
    return {"way": SHAPE_KEYS, "stamp": "", "slept": [[name, True, True] for name in text.splitlines()]}
