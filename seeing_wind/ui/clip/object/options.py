"""The object's part of what the engine is asked: where it is, at what scale, through which camera."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ....engine.errors import ObjectError, UsageError
from ....engine.settings import ObserveSettings, options_of
from ...option_properties import value_of, values_of

if TYPE_CHECKING:
    from ..inputs.scene_inputs import SceneInput

OPTIONS = options_of(ObserveSettings)


def object_options(settings: bpy.types.PropertyGroup, folder: Path) -> tuple[dict[str, Any], tuple[SceneInput, ...]]:
    """Which object, at what scale, through which camera.

    Args:
        settings: of the scene.
        folder: where the files that are made from the scene will be.

    Returns:
        Values of `ObserveSettings`, and the files among them that are still to be made from the scene.

    Raises:
        ObjectError: when nothing says where the object is.
        UsageError: when a file is named that is not there.
    """
    marked = _marked(settings)  # first: while nothing is marked, nothing that needs NumPy is read
    from ..inputs.scene_inputs import scene_inputs

    inputs = scene_inputs(settings.id_data)
    made = {each.option: str(folder / each.name) for each in inputs}
    return values_of(settings, ObserveSettings) | _scale(settings, made) | _camera(settings, made) | marked | made, inputs


def _scale(settings: bpy.types.PropertyGroup, made: dict[str, str]) -> dict[str, Any]:
    """What gives the size of things. Without either the engine takes the distance of the world's origin from the camera."""
    if settings.scale_mode == "PIXELS":
        return {"pixels_per_metre": value_of(settings, OPTIONS["pixels_per_metre"])}
    if settings.scale_mode == "DISTANCE" or (settings.scale_mode == "AUTO" and "camera" not in made):
        return {"distance": value_of(settings, OPTIONS["distance"])}
    return {}


def _camera(settings: bpy.types.PropertyGroup, made: dict[str, str]) -> dict[str, Any]:
    """The camera where the scene knows none."""
    if "camera" in made:
        return {}
    name = "camera" if settings.camera_mode == "JSON" else "fov"
    value = value_of(settings, OPTIONS[name])
    if value is None:
        raise UsageError("No camera file is chosen.", "Choose one, or use a field of view.")
    return {name: value}


def _marked(settings: bpy.types.PropertyGroup) -> dict[str, Any]:
    """Where the object is, as a file or numbers of the user's say it; what the scene knows itself is among its inputs."""
    if settings.object_mode not in ("MASK", "BOX"):
        return {}
    name = settings.object_mode.lower()
    value = value_of(settings, OPTIONS[name])
    if name == "mask" and value is None:
        raise ObjectError("No mask is chosen.", "Choose a PNG of the first picture, non-zero where the object is, or draw a box.")
    if name == "box" and (value[2] <= value[0] or value[3] <= value[1]):
        raise ObjectError("No box is drawn round the object.", "Use Draw Box, or give left, top, right and bottom in pixels.")
    return {name: value}
