"""Operators on what is in the edit: where bodies are held, how heavy they are, and removal; and on whole edits."""

import sys

import bpy
from bpy.props import StringProperty

from ...engine.errors import UsageError
from ...engine.settings import BodyEdit, options_of
from ..bake.plan import leave
from ..direct_operator import DirectOperator
from ..option_properties import property_of
from .inserting import HERE

FACTOR = HERE | {"default": 2.0, "min": -sys.float_info.max, "soft_min": 0.001}
"""The range is open because Blender would silently clamp a factor that is too small; the operators refuse it instead."""
BODY = options_of(BodyEdit)


class SEEING_WIND_OT_remove_body(DirectOperator, bpy.types.Operator):
    """Take the active body off the list; its object and its motion stay, until Clear Bake takes the motion away"""

    bl_idname = "seeing_wind.remove_body"
    bl_label = "Remove"

    def act(self, context):
        """Remove the list entry; objects and keyframes are not touched."""
        settings = context.scene.seeing_wind
        index = _active(settings)
        body = settings.bodies[index]
        name = body.called
        leave(body, settings.recovered_object if body.is_recovered else body.object)
        settings.bodies.remove(index)
        settings.active_body = max(0, min(index, len(settings.bodies) - 1))
        return f"Removed {name} from the list"


class SEEING_WIND_OT_pin_vertices(DirectOperator, bpy.types.Operator):
    """Hold the vertices of a vertex group in place"""

    bl_idname = "seeing_wind.pin_vertices"
    bl_label = "Pin Vertices"

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of an inserted object; empty: the active body")
    vertex_group: StringProperty(name="Vertex Group", options={"SKIP_SAVE"}, description="Empty: the object's active group")

    def act(self, context):
        """Check that the group holds some vertices, and store its name with the body."""
        from ..scene_mesh import FIRM, pinned_vertices  # needs NumPy

        settings = context.scene.seeing_wind
        body = settings.bodies[_active(settings, self.object)]
        obj = settings.recovered_object if body.is_recovered else body.object
        if obj is None:
            raise UsageError(f"The object of {body.called} is gone.", "Take it off the list, or undo its deletion.")
        if obj.mode == "EDIT":
            obj.update_from_editmode()
        active = obj.vertex_groups.active
        group = self.vertex_group or (active.name if active else "")
        _, weights = pinned_vertices(obj, context.evaluated_depsgraph_get(), group)
        body.pin_group = group
        soft = int((weights < FIRM).sum())
        return f"{len(weights)} vertices of {body.called} are held" + (f", {soft} of them softly" if soft else "")


class ScaleOperator(DirectOperator):
    """Mix-in for the operators that set a factor of one body."""

    sets = ""
    """Name of the body's property that is set."""
    says = ""
    """Format of the reported message, with the fields `body` and `factor`."""

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of an inserted object; empty: the active body")

    def act(self, context):
        """Set the factor; it takes effect in the next re-simulation."""
        settings = context.scene.seeing_wind
        body = settings.bodies[_active(settings, self.object)]
        setting = body.bl_rna.properties[self.sets]
        if not setting.hard_min <= self.factor < setting.hard_max:  # NaN fails both comparisons
            what = f"The {setting.name.lower()} of {body.called} cannot be {self.factor:g}."
            raise UsageError(what, f"Give {setting.hard_min:.2g} or more; 1 leaves it as it is.")
        setattr(body, self.sets, self.factor)
        return self.says.format(body=body.called, factor=self.factor)


class SEEING_WIND_OT_scale_mass(ScaleOperator, bpy.types.Operator):
    """Set the mass of a body relative to its material: twice the mass accelerates half as much in the same wind"""

    bl_idname = "seeing_wind.scale_mass"
    bl_label = "Scale Mass"
    sets, says = "mass_scale", "{body} has {factor:g} times its mass"
    factor: property_of(BODY["mass_scale"], **FACTOR)


class SEEING_WIND_OT_scale_stiffness(ScaleOperator, bpy.types.Operator):
    """Set the stiffness of a body relative to its material's Young's modulus"""

    bl_idname = "seeing_wind.scale_stiffness"
    bl_label = "Scale Stiffness"
    sets, says = "stiffness_scale", "{body} is {factor:g} times as stiff as its material"
    factor: property_of(BODY["youngs_modulus_scale"], **FACTOR)


class SEEING_WIND_OT_free_recovered(DirectOperator, bpy.types.Operator):
    """Let go of the clip's object where it was held in the clip: everywhere, or at the vertices of a group"""

    bl_idname = "seeing_wind.free_recovered"
    bl_label = "Let Go"

    vertex_group: StringProperty(name="Vertex Group", options={"SKIP_SAVE"}, description="Of the recovered object; empty: everywhere")

    def act(self, context):
        """Store what is released for the next re-simulation, and insert the recovered object if it is not in the list yet."""
        settings = context.scene.seeing_wind
        if settings.recovered_object is None:
            raise UsageError("There is no recovered object.", "Run Recover first.")
        if self.vertex_group:
            from ..scene_mesh import pinned_vertices  # needs NumPy

            pinned_vertices(settings.recovered_object, context.evaluated_depsgraph_get(), self.vertex_group)
        body = next((body for body in settings.bodies if body.is_recovered), None)
        if body is None:
            body = settings.bodies.add()
            body.name, body.is_recovered = "Recovered Object", True
        body.free_mode, body.free_group = ("GROUP" if self.vertex_group else "ALL"), self.vertex_group
        return f"{self.vertex_group or 'The whole object'} is let go"


class SEEING_WIND_OT_remove_collider(DirectOperator, bpy.types.Operator):
    """Take the active collider off the list; its object stays"""

    bl_idname = "seeing_wind.remove_collider"
    bl_label = "Remove Collider"

    def act(self, context):
        """Remove the list entry; the object is not touched."""
        settings = context.scene.seeing_wind
        index = settings.active_collider
        if index >= len(settings.colliders):
            raise UsageError("There is no collider.", "Add one first.")
        name = settings.colliders[index].called
        settings.colliders.remove(index)
        settings.active_collider = max(0, min(index, len(settings.colliders) - 1))
        return f"Bodies no longer collide with {name}"


class SEEING_WIND_OT_duplicate_edit(DirectOperator, bpy.types.Operator):
    """Copy this edit with its objects and place it beside the original, to compare the two"""

    bl_idname = "seeing_wind.duplicate_edit"
    bl_label = "Duplicate Edit"

    def act(self, context):
        """Duplicate the edit and make the copy, which is not simulated yet, the active one."""
        from .edits import duplicate  # needs NumPy

        return f"Working on {duplicate(context.scene)}"


class SEEING_WIND_OT_remove_edit(DirectOperator, bpy.types.Operator):
    """Forget this edit, with the copies that were made for it, and work on the one beside it; your own objects and keyframes stay"""

    bl_idname = "seeing_wind.remove_edit"
    bl_label = "Remove Edit"

    def act(self, context):
        """Remove the edit; the user's own objects are not touched."""
        from .edits import remove  # needs NumPy

        return f"Removed {remove(context.scene.seeing_wind)}"


def _active(settings: bpy.types.PropertyGroup, name: str = "") -> int:
    """Index of the body called `name`, or else of the active body. Raises UsageError when there is none."""
    if name:
        for index, body in enumerate(settings.bodies):
            if name == body.name or (body.object is not None and body.object.name == name):
                return index
        raise UsageError(f"{name!r} is not inserted.", "Insert it first.")
    if settings.active_body < len(settings.bodies):
        return settings.active_body
    raise UsageError("No mesh is inserted.", "Insert one first.")


CLASSES = (
    SEEING_WIND_OT_remove_body, SEEING_WIND_OT_pin_vertices, SEEING_WIND_OT_scale_mass, SEEING_WIND_OT_scale_stiffness,
    SEEING_WIND_OT_free_recovered, SEEING_WIND_OT_remove_collider, SEEING_WIND_OT_duplicate_edit, SEEING_WIND_OT_remove_edit,
)  # fmt: skip
