"""The settings of the composite that stay with the scene.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

import bpy
from bpy.props import FloatProperty, PointerProperty, StringProperty

from ..property_kinds import PATH


class CompositeSettings:
    """The light of the place where the clip was filmed."""

    hdri: StringProperty(
        name="HDRI", subtype="FILE_PATH", options=PATH,
        description="A panorama (.hdr or .exr) of where the clip was filmed, which lights the edit; empty: the sun and sky of the clip",
    )  # fmt: skip
    hdri_turn: FloatProperty(
        name="Turn (degrees)", subtype="ANGLE", options={"SKIP_SAVE"},
        description="How far the panorama is turned round the vertical, so that its sun stands where the clip's does",
    )  # fmt: skip
    hdri_strength: FloatProperty(
        name="HDRI Strength", default=1.0, min=0.0, soft_max=10.0, options={"SKIP_SAVE"},
        description="Factor on the panorama's light, so that the edit is as bright as the clip",
    )  # fmt: skip
    former_world: PointerProperty(type=bpy.types.World, options={"HIDDEN"})
