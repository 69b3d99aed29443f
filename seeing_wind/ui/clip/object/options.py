"""The object's part of the request to the engine: its outline, its scale, and the camera."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ....engine.errors import ObjectError, UsageError
from ....engine.settings import ObserveSettings, options_of
from ...option_properties import check_files, part_of, single

if TYPE_CHECKING:
    from ..inputs.scene_inputs import SceneInput


def object_options(
    settings: bpy.types.PropertyGroup, values: dict[str, Any], folder: Path
) -> tuple[dict[str, Any], tuple[SceneInput, ...]]:
    """The options that define the object, its scale and the camera.

    Args:
        settings: of the scene.
        values: of the scene's options, by `values_of`.
        folder: for the files made from the scene.

    Returns:
        Values of `ObserveSettings`, and those of its files that are still to be made from the scene.

    Raises:
        ObjectError: when the object is not marked.
        UsageError: when a file does not exist, no camera file is chosen, or the distance is not allowed.
    """
    named = _marked(settings.object_mode, values)  # first, so that NumPy is not imported while nothing is marked
    from ..inputs.scene_inputs import scene_inputs

    inputs = scene_inputs(settings.id_data)
    made = {each.option: str(folder / each.name) for each in inputs}
    if settings.scale_mode == "PIXELS":
        named.append("pixels_per_metre")
    elif settings.scale_mode == "DISTANCE" or (settings.scale_mode == "AUTO" and "camera" not in made):
        options_of(ObserveSettings)["distance"].check(values["distance"], "Distance")
        named.append("distance")  # without either, the engine takes the distance from the camera to the world's origin
    if "camera" not in made:
        named.append("camera" if settings.camera_mode == "JSON" else "fov")
        if values[named[-1]] is None:
            raise UsageError("No camera file is chosen.", "Choose one, or use a field of view.")
    if settings.held_mode != "FILE":
        values = values | {"pin": None}
    if settings.outline_data is not None:
        values = values | {"outline": None}  # its file is made from the scene
    elif values["outline"] is None:
        values = values | {"outline_frame": 0}
    points = [number for one in settings.corrections for number in (float(one.clip_frame), *map(single, one.place), float(not one.beside))]
    given = part_of(values, ObserveSettings, **{name: values[name] for name in named}) | {"correct": tuple(points) or None}
    check_files(given, ObserveSettings)
    return given | made, inputs


def _marked(mode: str, values: dict[str, Any]) -> list[str]:
    """The option, if any, by which the user marks the object; marks that are datablocks of the scene are in `scene_inputs`."""
    if mode == "MASK":
        if values["mask"] is None:
            raise ObjectError("No mask is chosen.", "Choose a PNG of the first frame, non-zero where the object is, or draw a box.")
        return ["mask"]
    if mode == "BOX":
        x0, y0, x1, y1 = values["box"]
        if x1 <= x0 or y1 <= y0:
            empty = f"The box round the object, {x0:g} {y0:g} {x1:g} {y1:g}, holds nothing."
            said = empty if any(values["box"]) else "No box is drawn round the object."
            raise ObjectError(said, "Use Draw Box, or give left, top, right and bottom in pixels.")
        return ["box"]
    return []
