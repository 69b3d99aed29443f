"""Paths as the user writes them, and how they stay right when a project is moved."""

from __future__ import annotations

import os

import bpy
from bpy.app.handlers import persistent

from .job import status


def absolute(path: str, library: bpy.types.Library | None = None) -> str:
    """A path as the user wrote it (`//` beside the .blend, `~`) as an absolute one."""
    return os.path.abspath(os.path.expanduser(bpy.path.abspath(path, library=library)))


def noted(path: str) -> str:
    """A path as Blender's own operators note it: beside a .blend that has been saved, relative to it, unless the preferences say no."""
    if not bpy.data.filepath or not bpy.context.preferences.filepaths.use_relative_paths:
        return path
    try:
        return str(bpy.path.relpath(absolute(path)))
    except ValueError:  # another drive on Windows
        return path


def relate(settings: bpy.types.PropertyGroup, folder: str) -> None:
    """Write the paths that a user chooses relative to the folder of the .blend file, as Blender does with its own.

    Paths that were relative to another folder before lead to the same files afterwards.
    """
    for prop in settings.bl_rna.properties:
        if prop.type != "STRING" or prop.subtype not in ("FILE_PATH", "DIR_PATH"):
            continue
        value = getattr(settings, prop.identifier)
        if not value or value.startswith("~"):
            continue
        try:
            related = bpy.path.relpath(absolute(value), start=folder)
        except ValueError:  # another drive on Windows
            continue
        if related != value:
            setattr(settings, prop.identifier, related)


@persistent
def _before_save(path: str = "", *_: object) -> None:
    """Blender makes its own paths relative when a file is saved; ours are text to it."""
    if not path or not bpy.context.preferences.filepaths.use_relative_paths:
        return
    for scene in bpy.data.scenes:
        if scene.library is None:
            relate(scene.seeing_wind, os.path.dirname(os.path.abspath(path)))


@persistent
def _after_save(*_: object) -> None:
    """Until the file has its new name, relative paths lead nowhere: what was said of them meanwhile is said anew."""
    for scene in bpy.data.scenes:
        status.refresh(scene)


HANDLERS = (("save_pre", _before_save), ("save_post", _after_save))


def register() -> None:
    """Attach the handlers, once."""
    unregister()
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Detach them."""
    for name, handler in HANDLERS:
        if handler in getattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).remove(handler)
