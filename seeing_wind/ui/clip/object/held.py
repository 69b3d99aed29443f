"""Mark the held place: as the preview proposes, or by weight paint on a mesh."""

from __future__ import annotations

import os

import bpy
from bpy.props import StringProperty

from ....engine.errors import UsageError
from ...direct_operator import DirectOperator
from ...job import takes


class SEEING_WIND_OT_use_held(DirectOperator, bpy.types.Operator):
    """Hold the object at the proposed place, without another look at the clip"""

    bl_idname = "seeing_wind.use_held"
    bl_label = "Use as Held Place"

    def act(self, context):
        """Use the proposed image as the setting."""
        settings = context.scene.seeing_wind
        if not settings.proposed_pin or not os.path.isfile(settings.proposed_pin):
            raise UsageError("No held place is proposed.", "Run Preview first.")
        settings.held_mode, settings.pin = "FILE", settings.proposed_pin
        return "The object is held at the proposed place"


class SEEING_WIND_OT_hold_painted(DirectOperator, bpy.types.Operator):
    """Hold the object where a mesh is painted: the active vertex group of the recovered object, or of a mesh that stands in its place"""

    bl_idname = "seeing_wind.hold_painted"
    bl_label = "Hold Where Painted"

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of the painted mesh; empty: the active object")
    vertex_group: StringProperty(name="Vertex Group", options={"SKIP_SAVE"}, description="Empty: the object's active group")

    def act(self, context):
        """Write the painted part as an image into the take. Later painting has no effect until this is called again."""
        scene = context.scene
        obj = scene.objects.get(self.object) if self.object else context.view_layer.objects.active
        if obj is None or obj.type != "MESH":
            said = f"There is no mesh {self.object!r} in this scene." if self.object else "No mesh is selected."
            raise UsageError(said, "Paint the held part of the recovered object in Weight Paint mode, and select it.")
        if not scene.seeing_wind.clip:
            raise UsageError("No clip is chosen.", "Choose one first.")
        from ..inputs.held import write_painted  # needs NumPy

        active = obj.vertex_groups.active
        group = self.vertex_group or (active.name if active else "")
        settings = scene.seeing_wind
        path = write_painted(scene, obj, group, takes.take_folder(settings))
        settings.held_mode, settings.pin = "FILE", str(path)
        return f"The object is held where {obj.name} is painted with {group}"


CLASSES = (SEEING_WIND_OT_use_held, SEEING_WIND_OT_hold_painted)
