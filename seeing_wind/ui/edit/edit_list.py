"""What surrounds the bodies of an edit: colliders, and further edits to compare with."""

import bpy
from bpy.props import EnumProperty, FloatProperty, StringProperty

from ...engine.errors import UsageError
from ..property_kinds import KINDS
from ..recover import results
from . import edits
from .operators import EditOperator


class SEEING_WIND_OT_insert_collider(EditOperator, bpy.types.Operator):
    """Let the bodies collide with the selected meshes, which they do not move"""

    bl_idname = "seeing_wind.insert_collider"
    bl_label = "Add Collider"

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of a mesh object; empty: all selected ones")
    kind: EnumProperty(name="Contact", items=KINDS, options={"SKIP_SAVE"}, description="What happens at its surface")
    friction: FloatProperty(
        name="Friction", default=0.3, min=0.0, soft_max=1.0, options={"SKIP_SAVE"}, description="Coulomb's coefficient: 0 is ice, 1 rubber"
    )

    def edit(self, context):
        """One collider per mesh; what is a body of this edit cannot be one."""
        settings = context.scene.seeing_wind
        found = [context.scene.objects.get(self.object)] if self.object else list(context.selected_objects)
        taken = {each.object for each in (*settings.colliders, *settings.bodies)}
        meshes = [obj for obj in found if obj is not None and obj.type == "MESH"]
        new = [obj for obj in meshes if obj not in taken and not results.shows_field(obj, settings)]
        if not new:
            raise UsageError("There is no mesh to collide with.", "Select meshes that are neither bodies nor colliders of this edit.")
        for obj in new:
            collider = settings.colliders.add()
            collider.name, collider.object, collider.kind, collider.friction = obj.name, obj, self.kind, self.friction
        settings.active_collider = len(settings.colliders) - 1
        return f"Bodies collide with {', '.join(obj.name for obj in new)}"


class SEEING_WIND_OT_remove_collider(EditOperator, bpy.types.Operator):
    """Take the active collider off the list; its object stays"""

    bl_idname = "seeing_wind.remove_collider"
    bl_label = "Remove Collider"

    def edit(self, context):
        """Its object is not touched."""
        settings = context.scene.seeing_wind
        index = settings.active_collider
        if index >= len(settings.colliders):
            raise UsageError("There is no collider.", "Add one first.")
        name = settings.colliders[index].name
        settings.colliders.remove(index)
        settings.active_collider = max(0, min(index, len(settings.colliders) - 1))
        return f"Bodies no longer collide with {name}"


class SEEING_WIND_OT_duplicate_edit(EditOperator, bpy.types.Operator):
    """Copy this edit with its objects and place it beside the original, to compare the two"""

    bl_idname = "seeing_wind.duplicate_edit"
    bl_label = "Duplicate Edit"

    def edit(self, context):
        """The copy is worked on from now on; it is not simulated yet."""
        return f"Working on {edits.duplicate(context.scene)}"


class SEEING_WIND_OT_remove_edit(EditOperator, bpy.types.Operator):
    """Forget this edit and work on the one beside it; objects and keyframes stay"""

    bl_idname = "seeing_wind.remove_edit"
    bl_label = "Remove Edit"

    def edit(self, context):
        """Objects and keyframes are not touched."""
        return f"Removed {edits.remove(context.scene.seeing_wind)}"


CLASSES = (SEEING_WIND_OT_insert_collider, SEEING_WIND_OT_remove_collider, SEEING_WIND_OT_duplicate_edit, SEEING_WIND_OT_remove_edit)
