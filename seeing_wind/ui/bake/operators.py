"""Bake the motion of the last re-simulation to keyframes, and take it off again."""

import bpy
from bpy.props import BoolProperty, EnumProperty, IntVectorProperty, StringProperty

from ..direct_operator import DirectOperator
from ..property_kinds import WAYS
from ..scene_units import refuse_other_units

SAYS = {
    "SHAPE_KEYS": "shape keys", "TRANSFORM": "location and rotation", "POINT_CACHE": "point cache", "ALEMBIC": "Alembic",
    "USD": "USD",
}  # fmt: skip


class SEEING_WIND_OT_bake(DirectOperator, bpy.types.Operator):
    """Bake the simulated motion to keyframes; the file then plays without this extension. What has not changed is left alone"""

    bl_idname = "seeing_wind.bake"
    bl_label = "Bake to Keyframes"
    bl_options = {"UNDO"}

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of an inserted object; empty: all bodies")
    way: EnumProperty(name="Keyframes", items=WAYS, options={"SKIP_SAVE"}, description="How the motion is kept")
    frames: IntVectorProperty(name="Frames", size=2, options={"SKIP_SAVE"}, description="First and last scene frame, both inclusive")
    force: BoolProperty(name="Bake All Again", options={"SKIP_SAVE"}, description="Also what has not changed since the last bake")

    def act(self, context):
        """Bake all bodies of the last re-simulation, or one."""
        from .bodies import bake_bodies  # needs NumPy

        scene, settings = context.scene, context.scene.seeing_wind
        if settings.field_object is not None:
            refuse_other_units(settings.field_object, scene)
        before = settings.bake_way, settings.bake_use_frames, tuple(settings.bake_frames)
        if self.properties.is_property_set("way"):
            settings.bake_way = self.way
        if self.properties.is_property_set("frames"):
            settings.bake_use_frames, settings.bake_frames = True, self.frames
        try:
            done = bake_bodies(scene, self.object, self.force)
        except Exception:
            settings.bake_way, settings.bake_use_frames, settings.bake_frames = before
            raise
        new = [f"{obj.name} ({SAYS[baked.way]})" for obj, baked in done if not baked.kept]
        kept = len(done) - len(new)
        said = f"Baked {', '.join(new)}" if new else "Nothing has changed since the last bake"
        return f"{said}; {kept} unchanged" if new and kept else said


class SEEING_WIND_OT_clear_bake(DirectOperator, bpy.types.Operator):
    """Take the baked motion off the objects: they stand where they were inserted, their modifiers awake. The simulation is kept"""

    bl_idname = "seeing_wind.clear_bake"
    bl_label = "Clear Bake"
    bl_options = {"UNDO"}

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of an inserted object; empty: all bodies")

    def act(self, context):
        """Clear all bodies of the edit, or one."""
        from .bodies import clear_bodies  # needs NumPy

        count = clear_bodies(context.scene, self.object)
        if not count:
            return "Nothing is baked"
        return f"Cleared the motion of {count} {'body' if count == 1 else 'bodies'}"


CLASSES = (SEEING_WIND_OT_bake, SEEING_WIND_OT_clear_bake)
