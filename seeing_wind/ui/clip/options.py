"""The clip's part of the worker's options: the same words that a user would type."""

from __future__ import annotations

import os

import bpy

from ...engine.errors import ClipError, UsageError
from ..user_paths import absolute
from .inputs.clips import as_pattern


def clip_options(settings: bpy.types.PropertyGroup) -> list[str]:
    """The clip and which part of it.

    Raises:
        ClipError: when there is no such file.
    """
    if not settings.clip:
        raise ClipError("No clip is chosen.", "Choose a video of something that is moved by forces.")
    path = absolute(settings.clip)
    if not os.path.isfile(path):
        raise ClipError(f"There is no file {path}.", "Choose the clip again; it may have been moved.")
    options = [as_pattern(path)]
    if settings.fps > 0.0:
        options += ["--fps", number_text(settings.fps)]
    elif options[0] != path:  # pictures carry no rate: they play at the scene's
        render = settings.id_data.render
        options += ["--fps", number_text(render.fps / render.fps_base)]
    if settings.use_frames:
        first, last = settings.frames
        if last <= first:
            raise ClipError(f"Pictures {first} to {last} are none.", "The last picture must come after the first.")
        options += ["--frames", f"{first}:{last}"]
    return options


def existing_file(path: str, what: str) -> str:
    """The absolute path of a file that the user has named. Raises UsageError when it is not there; `what` says what it should be."""
    found = absolute(path)
    if not os.path.isfile(found):
        raise UsageError(f"There is no {what} {found}.", "Choose it again; it may have been moved.")
    return found


def number_text(value: float) -> str:
    """Blender keeps single precision: seven digits say all of it, and 30.19 stays 30.19. Never an exponent's minus sign alone."""
    return f"{value:.7g}"
