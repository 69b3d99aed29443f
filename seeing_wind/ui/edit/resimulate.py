"""Simulate the edit in the recovered field, and bake its motion to keyframes."""

import bpy
from bpy.props import BoolProperty, EnumProperty, IntVectorProperty, StringProperty

from ..install import environment as engine_environment
from ..job import takes, worker_calls
from ..job import worker as job
from ..job.operator import JobOperator
from ..property_kinds import WAYS
from ..recover import freshness
from . import bodies, edit_export
from .operators import EditOperator

SAYS = {
    "SHAPE_KEYS": "shape keys", "TRANSFORM": "location and rotation", "POINT_CACHE": "point cache", "ALEMBIC": "Alembic",
}  # fmt: skip


class SEEING_WIND_OT_resimulate(JobOperator, bpy.types.Operator):
    """Simulate the inserted bodies in the recovered field, with the same physics"""

    bl_idname = "seeing_wind.resimulate"
    bl_label = "Re-simulate"
    bl_options = {"UNDO"}
    step = "resimulate"

    def start(self, scene):
        """Write the edit, then let the engine simulate it."""
        settings, python = scene.seeing_wind, engine_environment.engine_python()
        source = takes.recovered(settings)
        self.folder = takes.edit_folder(settings, source)
        edit = edit_export.export_edit(scene, source, self.folder)
        self.digest = freshness.edit_digest(scene)
        self.of_edit, self.names = settings.edit_folder, {_who(body): body.result for body in settings.bodies}
        call = worker_calls.command(python, "resimulate", str(source), "--edit", str(edit), "--take", str(self.folder))
        return job.run(call, cwd=str(self.folder), env=worker_calls.environment())

    def finish(self, scene, result):
        """The motion stays in the take until it is baked."""
        settings = scene.seeing_wind
        # another edit may be worked on by now
        for edit in (settings, *settings.edits) if settings.edit_folder == self.of_edit else settings.edits:
            if edit.edit_folder == self.of_edit:
                for body in edit.bodies:  # an undo while it ran has taken the names back
                    body.result = self.names.get(_who(body), "")
                edit.simulated_digest, edit.simulated_take = self.digest, str(self.folder)
                break
        return f"Simulated into {self.folder.name}"


def _who(body: bpy.types.PropertyGroup) -> int:
    """What a body moves, however it is called: 0 for the clip's own object, -1 for one that is gone."""
    if body.is_recovered:
        return 0
    return body.object.session_uid if body.object is not None else -1


class SEEING_WIND_OT_bake(EditOperator, bpy.types.Operator):
    """Bake the simulated motion to keyframes; the file then plays without this extension. What has not changed is left alone"""

    bl_idname = "seeing_wind.bake"
    bl_label = "Bake to Keyframes"
    bl_options = {"UNDO"}

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of an inserted object; empty: all bodies")
    way: EnumProperty(name="Keyframes", items=WAYS, options={"SKIP_SAVE"}, description="How the motion is kept")
    frames: IntVectorProperty(name="Frames", size=2, options={"SKIP_SAVE"}, description="First and last scene frame, both inclusive")
    force: BoolProperty(name="Bake All Again", options={"SKIP_SAVE"}, description="Also what has not changed since the last bake")

    def edit(self, context):
        """All bodies of the last re-simulation, or one."""
        scene, settings = context.scene, context.scene.seeing_wind
        if self.properties.is_property_set("way"):
            settings.bake_way = self.way
        if self.properties.is_property_set("frames"):
            settings.bake_use_frames, settings.bake_frames = True, self.frames
        done = bodies.bake_bodies(scene, self.object, self.force)
        new = [f"{obj.name} ({SAYS[baked.way]})" for obj, baked in done if not baked.kept]
        kept = len(done) - len(new)
        said = f"Baked {', '.join(new)}" if new else "Nothing has changed since the last bake"
        return f"{said}; {kept} unchanged" if new and kept else said


class SEEING_WIND_OT_clear_bake(EditOperator, bpy.types.Operator):
    """Take the baked motion off the objects: they stand where they were inserted, their modifiers awake. The simulation is kept"""

    bl_idname = "seeing_wind.clear_bake"
    bl_label = "Clear Bake"
    bl_options = {"UNDO"}

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of an inserted object; empty: all bodies")

    def edit(self, context):
        """All bodies of the edit, or one."""
        count = bodies.clear_bodies(context.scene, self.object)
        return f"Cleared the motion of {count} {'body' if count == 1 else 'bodies'}"


CLASSES = (SEEING_WIND_OT_resimulate, SEEING_WIND_OT_bake, SEEING_WIND_OT_clear_bake)
