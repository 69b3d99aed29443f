"""The settings of the field object.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

from bpy.props import IntProperty


class FieldSettings:
    """How finely the field object follows the recovered field."""

    field_resolution: IntProperty(
        name="Field Nodes", default=7, min=2, max=12, description="Wind sources along each side of the field object"
    )
