"""What is in a scene already: what was set up before, found by its name, which Blender numbers where another scene has the same; and
which of the user's render settings change. Without NumPy: the panel says it beforehand."""

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


def changes(scene: bpy.types.Scene, use_cycles: bool, use_standard: bool) -> list[tuple[str, str, str, str]]:
    """Which render settings `set_render` changes: whose, its name, the new value, and the change in words."""
    render, view, found = scene.render, scene.view_settings, []
    if use_cycles and render.engine != "CYCLES":
        found.append(("render", "engine", "CYCLES", f"render engine from {_engine(render.engine)} to Cycles"))
    if use_standard and view.view_transform != "Standard":
        found.append(("view_settings", "view_transform", "Standard", f"view transform from {view.view_transform} to Standard"))
    return found


def set_render(scene: bpy.types.Scene, use_cycles: bool, use_standard: bool) -> list[str]:
    """Let the film be transparent, and the engine and the colors as asked. Returns what of the latter has changed, in words."""
    scene.render.film_transparent = True
    made = changes(scene, use_cycles, use_standard)
    for owner, name, value, _ in made:
        setattr(getattr(scene, owner), name, value)
    return [words for *_, words in made]


def said_of_render(scene: bpy.types.Scene) -> list[str]:
    """What the scene's own engine and colors take away from a composite."""
    said, engine, view = [], scene.render.engine, scene.view_settings.view_transform
    if engine != "CYCLES":
        said.append(f"{_engine(engine)} catches no shadows: tick Use Cycles.")
    if view != "Standard":
        said.append(f"The view transform {view} changes the clip's colors, too: tick Standard View.")
    return said


def _engine(name: str) -> str:
    """What Blender calls an engine."""
    return {"CYCLES": "Cycles", "BLENDER_WORKBENCH": "Workbench"}.get(name, name.removeprefix("BLENDER_").removesuffix("_NEXT"))
