"""The clip's lens as a picture: where in a render without distortion each pixel of the clip is found (an ST map)."""

from __future__ import annotations

import bpy
import numpy as np

from ...engine.record_arrays import from_arrays
from ...engine.records import Camera
from ...engine.take import Take
from ..clip.inputs.lens import straightened
from .mattes import FOLDER

IMAGE = "Seeing Wind Lens"
OUTSIDE = -1.0
"""Where the render shows nothing of what the clip does."""


def lens_of(take: Take, size: tuple[int, int]) -> bpy.types.Image | None:
    """Write the ST map of a take's lens into the take, and load it; None for a lens that bends nothing, or a take without a camera.

    Red and green count from 0 to 1, from the lower left corner of the render to its upper right one.

    Args:
        size: width and height of the clip.

    Raises:
        TakeError: when the camera is damaged, or the picture cannot be written.
    """
    arrays = take.read_arrays("observation.npz") if take.file("observation.npz").is_file() else {}
    if "camera.width" not in arrays:
        return None
    camera = from_arrays(Camera, arrays, "camera.")
    if not any(camera.distortion):
        return None
    former = bpy.data.images.get(IMAGE)
    if former is not None:
        bpy.data.images.remove(former)
    image = bpy.data.images.new(IMAGE, *size, float_buffer=True, is_data=True)
    image.pixels.foreach_set(st_map(camera, size).ravel())
    with take.writing(f"{FOLDER}/lens.exr") as aside:
        image.filepath_raw, image.file_format = str(aside), "OPEN_EXR"
        image.save()
    image.filepath, image.source = str(take.file(f"{FOLDER}/lens.exr")), "FILE"
    return image


def st_map(camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """(H, W, 4) float32, its first row the lowest: red and green are the place in the render, alpha is 1."""
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1])[::-1])
    # a take may have been observed at a smaller size than its clip's
    scale = np.divide((camera.width, camera.height), size)
    found = straightened(camera, (np.stack([columns, rows], axis=-1) + 0.5) * scale - 0.5)
    places = (found + 0.5) / (camera.width, camera.height)
    filled = np.ones((*columns.shape, 4), dtype=np.float32)
    filled[..., 0], filled[..., 1] = places[..., 0], 1.0 - places[..., 1]
    filled[~np.isfinite(places).all(axis=-1), :2] = OUTSIDE
    return filled
