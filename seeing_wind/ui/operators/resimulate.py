"""Simulate the edit in the recovered field, and bake its motion to keyframes."""

from pathlib import Path

import bpy

from ...engine.errors import TakeError
from .. import freshness, job, results, worker_calls
from ..edit_export import export_edit
from ..engine_environment import engine_python
from ..job_operator import JobOperator
from .edit import EditOperator


class SEEING_WIND_OT_resimulate(JobOperator, bpy.types.Operator):
    """Simulate the inserted bodies in the recovered field, with the same physics"""

    bl_idname = "seeing_wind.resimulate"
    bl_label = "Re-simulate"
    bl_options = {"UNDO"}
    step = "resimulate"

    def start(self, scene):
        """Write the edit, then let the engine simulate it."""
        settings, python = scene.seeing_wind, engine_python()
        if not settings.recovered_take:
            raise TakeError("There is no recovered field.", "Run Recover first.")
        source = Path(settings.recovered_take)
        self.folder = worker_calls.edit_folder(source)
        edit = export_edit(scene, source, self.folder)
        self.digest = freshness.edit_digest(scene)
        call = worker_calls.command(python, "resimulate", str(source), "--edit", str(edit), "--take", str(self.folder))
        return job.run(call, cwd=str(self.folder), env=worker_calls.environment())

    def finish(self, scene, result):
        """The motion stays in the take until it is baked."""
        settings = scene.seeing_wind
        settings.simulated_digest, settings.simulated_take = self.digest, str(self.folder)
        return f"Simulated into {self.folder.name}"


class SEEING_WIND_OT_bake(EditOperator, bpy.types.Operator):
    """Bake the simulated motion to keyframes (absolute shape keys); the file then plays without this extension"""

    bl_idname = "seeing_wind.bake"
    bl_label = "Bake to Keyframes"
    bl_options = {"UNDO"}

    def edit(self, context):
        """All bodies of the last re-simulation."""
        scene, settings = context.scene, context.scene.seeing_wind
        bodies = [body for body in settings.bodies if body.result]
        if not settings.simulated_take or not bodies:
            raise TakeError("Nothing is simulated yet.", "Run Re-simulate first.")
        baked = [results.bake_body(scene, body, Path(settings.simulated_take)) for body in bodies]
        settings.baked_digest = settings.simulated_digest
        return f"Baked {', '.join(obj.name for obj in baked)}"


CLASSES = (SEEING_WIND_OT_resimulate, SEEING_WIND_OT_bake)
