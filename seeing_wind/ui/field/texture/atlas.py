"""The lattice of all frames as one image, packed into the file: float pixels without a color space.

A tile of the image is one layer of the lattice, with x to the right and y upwards. Layers of growing z stand side by side, frames one
above the other. Blender's texture force field has the value 0.5 minus the color, so the colors, between 0 and 1, are 0.5 minus the field
over twice its largest component. Alpha holds their sum, which the nodes need to rotate the field (see `tree`).
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..lattice import SampledField

OFFSET, SUM = 0.5, 3.5
"""Alpha is (red + green + blue + OFFSET) / SUM: between 0 and 1."""


@dataclass(frozen=True)
class Atlas:
    """An image of the lattice, and its layout."""

    image: bpy.types.Image
    counts: tuple[int, int, int]
    """Nodes of the lattice along x, y, z."""
    frames: int
    strength: float
    """Strength that the force field must have, so that solvers feel the values of the lattice."""

    @property
    def pixel(self) -> tuple[float, float]:
        """Width and height of a pixel in Blender's image coordinates, in which the whole image is 2 wide and 2 high."""
        width, height = self.image.size
        return 2.0 / width, 2.0 / height


def make_atlas(name: str, sampled: SampledField) -> Atlas:
    """Make and pack the image of a field's `force`."""
    strength = 2.0 * float(np.abs(sampled.force).max()) or 1.0
    counts, frames = sampled.counts, len(sampled.force)
    pixels = _pixels(sampled.force / strength, counts)
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True, is_data=True)
    image.pixels.foreach_set(pixels.ravel())
    image.pack()
    return Atlas(image, counts, frames, strength)


def _pixels(force: np.ndarray, counts: tuple[int, int, int]) -> np.ndarray:
    """Pixels (T * ny + 1, nz * nx + 1, 4) of a force (T, L, 3) between -0.5 and 0.5.

    Blender samples the last row and column of an image wrongly, so an extra row and column are added that are never read.
    """
    (nx, ny, nz), frames = counts, len(force)
    colors = (0.5 - force).reshape(frames, nx, ny, nz, 3).transpose(0, 2, 3, 1, 4).reshape(frames * ny, nz * nx, 3)
    pixels = np.ones((frames * ny + 1, nz * nx + 1, 4), dtype=np.float32)
    pixels[:-1, :-1, :3] = colors
    pixels[:-1, :-1, 3] = (colors.sum(axis=-1) + OFFSET) / SUM
    return pixels
