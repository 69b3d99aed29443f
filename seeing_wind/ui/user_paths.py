"""Paths as the user writes them, and keeping them valid when a project is moved."""

from __future__ import annotations

import os

import bpy
from bpy.app.handlers import persistent

from .job import status


def absolute(path: str, library: bpy.types.Library | None = None) -> str:
    """The absolute path for a path as the user wrote it (with `//` for the folder of the .blend file, or `~`)."""
    return os.path.abspath(os.path.expanduser(bpy.path.abspath(path, library=library)))


def noted(path: str) -> str:
    """A path as Blender's own operators store it: relative to the .blend file if that is saved, unless disabled in the preferences."""
    if not bpy.data.filepath or not bpy.context.preferences.filepaths.use_relative_paths:
        return path
    try:
        return str(bpy.path.relpath(absolute(path)))
    except ValueError:  # another drive on Windows
        return path


def relate(settings: bpy.types.PropertyGroup, folder: str) -> None:
    """Write the paths that a user chooses relative to the folder of the .blend file, as Blender does with its own.

    Paths that were relative to another folder still refer to the same files afterwards.
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
    """When a file is saved, Blender makes its own paths relative, but not this extension's, which are plain text to it."""
    if not path or not bpy.context.preferences.filepaths.use_relative_paths:
        return
    for scene in bpy.data.scenes:
        if scene.library is None:
            relate(scene.seeing_wind, os.path.dirname(os.path.abspath(path)))


@persistent
def _after_save(*_: object) -> None:
    """Refresh all scenes: until the file had its new name, relative paths could not be resolved, so messages about them are outdated."""
    for scene in bpy.data.scenes:
        status.refresh(scene)


HANDLERS = (("save_pre", _before_save), ("save_post", _after_save))


def register() -> None:
    """Attach the handlers, once."""
    unregister()
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    """Detach the handlers."""
    for name, handler in HANDLERS:
        if handler in getattr(bpy.app.handlers, name):
            getattr(bpy.app.handlers, name).remove(handler)
