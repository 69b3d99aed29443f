"""The object's part of the worker's options: where it is, at what scale, through which camera."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ....engine.errors import ObjectError, UsageError
from ..options import existing_file, number_text

if TYPE_CHECKING:
    from ..inputs.scene_inputs import SceneInput


def object_options(settings: bpy.types.PropertyGroup, folder: Path) -> tuple[list[str], tuple[SceneInput, ...]]:
    """Which object, at what scale, through which camera.

    Args:
        settings: of the scene.
        folder: where the files that are made from the scene will be.

    Returns:
        The worker's options, and the files among them that are still to be made from the scene.

    Raises:
        ObjectError: when nothing says where the object is.
        UsageError: when a file is named that is not there.
    """
    marked = _marked(settings)  # first: while nothing is marked, nothing that needs NumPy is read
    from ..inputs.scene_inputs import scene_inputs

    inputs = scene_inputs(settings.id_data)
    options = [word for each in inputs for word in (each.option, str(folder / each.name))] + marked
    if settings.pin:
        options += ["--pin", existing_file(settings.pin, "picture of the held places")]
    if settings.scale_mode == "PIXELS":
        options += ["--pixels-per-metre", number_text(settings.pixels_per_metre)]
    elif settings.scale_mode == "DISTANCE" or (settings.scale_mode == "AUTO" and "--camera" not in options):
        # without either the engine takes the distance of the world's origin from the camera
        options += ["--distance", number_text(settings.distance)]
    if "--camera" not in options:
        options += _camera(settings)
    return options, inputs


def _camera(settings: bpy.types.PropertyGroup) -> list[str]:
    """The camera where the scene knows none."""
    if settings.camera_mode != "JSON":
        return ["--fov", number_text(settings.fov)]
    if not settings.camera:
        raise UsageError("No camera file is chosen.", "Choose one, or use a field of view.")
    return ["--camera", existing_file(settings.camera, "camera file")]


def _marked(settings: bpy.types.PropertyGroup) -> list[str]:
    """Where the object is, as a file or numbers of the user's say it; what the scene knows itself is among its inputs."""
    if settings.object_mode == "MASK":
        if not settings.mask:
            raise ObjectError("No mask is chosen.", "Choose a PNG of the first picture, non-zero where the object is, or draw a box.")
        return ["--mask", existing_file(settings.mask, "mask")]
    if settings.object_mode == "BOX":
        x0, y0, x1, y1 = settings.box
        if x1 <= x0 or y1 <= y0:
            raise ObjectError("No box is drawn round the object.", "Use Draw Box, or give left, top, right and bottom in pixels.")
        return ["--box", *(number_text(value) for value in (x0, y0, x1, y1))]
    return []
