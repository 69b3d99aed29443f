"""The clip's part of the request to the engine."""

from __future__ import annotations

import os
from typing import Any

import bpy

from ...engine.errors import ClipError, UsageError
from ..option_properties import existing_file, single
from ..user_paths import absolute
from .inputs.clip_files import as_pattern

View = tuple[str, str, str]
"""Paths of a further view's clip, camera and mask."""


def clip_options(settings: bpy.types.PropertyGroup, values: dict[str, Any]) -> tuple[str, dict[str, Any], tuple[View, ...]]:
    """The clip's path or pattern, its rate and range as values of `ObserveSettings`, and the further views.

    Args:
        settings: of the scene.
        values: of the scene's options, by `values_of`.

    Raises:
        ClipError: when no clip is chosen, its file does not exist, or the range of frames is empty.
        UsageError: when a file of a further view is missing.
    """
    if not settings.clip:
        raise ClipError("No clip is chosen.", "Choose a video of something that is moved by forces.")
    path = absolute(settings.clip)
    if not os.path.isfile(path):
        raise ClipError(f"There is no file {path}.", "Choose the clip again; it may have been moved.")
    clip, fps, frames = as_pattern(path), values["fps"], values["frames"]
    if fps is None and clip != path:  # images have no frame rate: they play at the scene's
        render = settings.id_data.render
        fps = single(render.fps / render.fps_base)
    if frames is not None and frames[1] <= frames[0]:
        first, last = frames
        raise ClipError(f"The range of frames {first} to {last} is empty.", "The last frame must come after the first.")
    return clip, {"fps": fps, "frames": frames}, tuple(_view(view, number) for number, view in enumerate(settings.views, start=2))


def _view(view: bpy.types.PropertyGroup, number: int) -> View:
    if not (view.clip and view.camera and view.mask):
        raise UsageError(f"View {number} lacks its clip, camera or mask.", "Choose all three, or remove the view.")
    return existing_file(view.clip, "clip"), existing_file(view.camera, "camera file"), existing_file(view.mask, "mask")
