"""The clip's lens distortion as an ST map: the position in an undistorted render of each pixel of the clip."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ....engine.record_arrays import from_arrays
from ....engine.records import Camera
from ....engine.take import Take
from ...clip.inputs.lens import straightened
from ..mattes import FOLDER, check_room
from ..own import drop_unused

IMAGE, WIDE_IMAGE = "Seeing Wind Lens", "Seeing Wind Wide Lens"
OUTSIDE = -1.0
"""Value in an ST map where no position in the render corresponds to the clip's pixel."""
WIDEST = 1.6
"""Largest width of a render relative to the clip's frame. A lens that needs more is a fisheye, and its corners stay empty."""


@dataclass(frozen=True)
class Lens:
    """The ST maps of a lens. Red and green run from 0 to 1, from the lower left to the upper right corner."""

    image: bpy.types.Image
    """Position of each pixel of the clip in an undistorted render as wide as the clip's frame."""
    wide: bpy.types.Image
    """The same for a render that is `wider`."""
    wider: float
    """Factor by which the render must be wider and higher to cover the distorted frame; 1 if no enlargement is needed."""


def lens_of(take: Take, size: tuple[int, int]) -> Lens | None:
    """Write the ST maps of a take's lens into the take, and load them; None for a lens without distortion, or a take without a camera.

    Args:
        size: width and height of the clip.

    Raises:
        TakeError: when the camera is damaged, or the images cannot be written.
    """
    arrays = take.read_arrays("observation.npz") if take.file("observation.npz").is_file() else {}
    if "camera.width" not in arrays:
        return None
    camera = from_arrays(Camera, arrays, "camera.")
    if not any(camera.distortion):
        return None
    check_room(take)
    places = st_map(camera, size)
    wider = overscan_of(places)
    return Lens(_saved(take, IMAGE, "lens", places), _saved(take, WIDE_IMAGE, "lens_wide", widened(places, wider)), wider)


def overscan_of(places: np.ndarray) -> float:
    """Factor, from 1 to `WIDEST`, by which a render must be wider to contain all positions in an ST map (H, W, 4)."""
    known = places[..., 0] != OUTSIDE
    return float(np.clip(2.0 * np.abs(places[known][:, :2] - 0.5).max(initial=0.5), 1.0, WIDEST))


def widened(places: np.ndarray, wider: float) -> np.ndarray:
    """The ST map (H, W, 4) for a render that is wider by a factor; `OUTSIDE` where the given map is."""
    found = places.copy()
    found[..., :2] = 0.5 + (places[..., :2] - 0.5) / wider
    found[places[..., 0] == OUTSIDE, :2] = OUTSIDE
    return found


def drop_lenses() -> None:
    """Remove the ST maps that no compositor uses any more."""
    for name in (IMAGE, WIDE_IMAGE):
        drop_unused(bpy.data.images, name)


def _saved(take: Take, name: str, file: str, places: np.ndarray) -> bpy.types.Image:
    """Save an ST map as an EXR in the take. Returns it as an image of the .blend file."""
    image = bpy.data.images.new(name, places.shape[1], places.shape[0], float_buffer=True, is_data=True)
    image.pixels.foreach_set(places.ravel())
    with take.writing(f"{FOLDER}/{file}.exr") as aside:
        image.filepath_raw, image.file_format = str(aside), "OPEN_EXR"
        image.save()
    image.filepath, image.source = str(take.file(f"{FOLDER}/{file}.exr")), "FILE"
    return image


def st_map(camera: Camera, size: tuple[int, int]) -> np.ndarray:
    """ST map (H, W, 4) float32, lowest row first: red and green are the position in the undistorted render, alpha is 1."""
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1])[::-1])
    # a take may have been observed at a lower resolution than the clip's
    scale = np.divide((camera.width, camera.height), size)
    found = straightened(camera, (np.stack([columns, rows], axis=-1) + 0.5) * scale - 0.5)
    places = (found + 0.5) / (camera.width, camera.height)
    filled = np.ones((*columns.shape, 4), dtype=np.float32)
    filled[..., 0], filled[..., 1] = places[..., 0], 1.0 - places[..., 1]
    filled[~np.isfinite(places).all(axis=-1), :2] = OUTSIDE
    return filled
