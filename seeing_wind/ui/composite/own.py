"""What was set up in a scene before, found again by its name, which Blender numbers where another scene of the file has the same."""

from __future__ import annotations

import re

import bpy


def is_called(datablock: bpy.types.ID, name: str) -> bool:
    """Whether a datablock has a name, numbered or not."""
    return re.sub(r"\.\d{3,}$", "", datablock.name) == name


def own_object(scene: bpy.types.Scene, name: str) -> bpy.types.Object | None:
    """The scene's object of that name."""
    return scene.objects.get(name) or next((obj for obj in scene.objects if is_called(obj, name)), None)


def drop_unused(blocks: bpy.types.bpy_prop_collection, name: str) -> None:
    """Remove those of that name that no scene shows any more."""
    for each in [each for each in blocks if is_called(each, name) and each.users == 0]:
        blocks.remove(each)
