"""Frames of the composite, and something to be seen in them."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np


def render(path: Path, denoised: bool = False) -> np.ndarray:
    """(H, W, 3) in 0..255, row 0 at the top, of the current frame. Denoising takes longer than all else of so small a frame."""
    import cv2

    bpy.context.scene.cycles.use_denoising = denoised
    assert bpy.ops.seeing_wind.render_composite(filepath=str(path), still=True) == {"FINISHED"}
    return cv2.imread(str(path))[:, :, ::-1].astype(int)


def red_cube(scene) -> None:
    """A glowing cube in the lower left of the frame."""
    bpy.ops.mesh.primitive_cube_add(size=0.2, location=(-0.5, 0.0, -0.3))
    material = bpy.data.materials.new("Red")
    material.use_nodes = True
    surface = material.node_tree.nodes["Principled BSDF"].inputs
    surface["Base Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    surface["Emission Color"].default_value, surface["Emission Strength"].default_value = (1.0, 0.0, 0.0, 1.0), 1.0
    bpy.context.object.data.materials.append(material)
