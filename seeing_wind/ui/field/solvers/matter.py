"""The input of a calibration, and the weights with which an object feels a field object."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ....engine.conventions import in_figures
from ....engine.errors import UsageError
from ..display import frames_per_second, stride_of

WEIGHT_LIMIT = 200.0
"""Largest effector weight that Blender allows."""
FRAME_GRAVITY = 1.0e-3
"""Acceleration of hair and cloth per frame², relative to the scene's gravity, whatever the frame rate."""
SHIRTING = 0.12
"""Areal density of cotton [kg/m²]."""


@dataclass(frozen=True)
class Matter:
    """The field and the material for which a solver is calibrated."""

    field: bpy.types.Object
    density: float
    """Of the matter [kg/m³]."""
    clip_fps: float
    """Scene frames per second of the clip."""
    scene_fps: float
    areal_density: float
    """Of cloth in a wind [kg/m²]."""

    def weigh(self, weights: bpy.types.EffectorWeights, weight: float, mend: str) -> None:
        """Set the weight of texture force fields.

        Raises:
            UsageError: when Blender does not allow the weight.
        """
        if not 0.0 < weight <= WEIGHT_LIMIT:
            raise UsageError(f"The field's weight would have to be {in_figures(weight)}, Blender takes up to {WEIGHT_LIMIT:g}.", mend)
        weights.all, weights.texture = 1.0, weight

    def fall(self, weights: bpy.types.EffectorWeights, speed: float = 1.0) -> None:
        """Set gravity for a solver that applies it per frame², so that bodies fall as fast as in the clip; a weight of zero is kept."""
        if weights.gravity:
            weights.gravity = min(1.0 / (FRAME_GRAVITY * (self.clip_fps * speed) ** 2), WEIGHT_LIMIT)


def matter(
    scene: bpy.types.Scene, field: bpy.types.Object | None, density: float | None, areal_density: float = SHIRTING
) -> Matter:
    """Gather what a calibration needs.

    Args:
        density: [kg/m³]; None takes that of the recovered material.
        areal_density: [kg/m²].

    Raises:
        UsageError: when `field` is no field object or the density is not above zero.
    """
    if field is None or "seeing_wind_density" not in field:
        name = field.name if field is not None else "This"
        raise UsageError(f"{name} is no recovered force field.", "Choose the object that Recover made.")
    density = field["seeing_wind_density"] if density is None else density
    if not density > 0.0:
        raise UsageError(f"The density {density:g} must be above zero.", "Give kg/m³, or 0 in the panel for the recovered material.")
    if not areal_density > 0.0:
        raise UsageError(f"The areal density {areal_density:g} must be above zero.", "Cotton has 0.12 kg/m², which is 120 g/m².")
    return Matter(field, density, field["seeing_wind_fps"] * stride_of(field), frames_per_second(scene), areal_density)
