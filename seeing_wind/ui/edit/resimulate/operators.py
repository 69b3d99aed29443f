"""Simulate the edit in the recovered field."""

import bpy

from ...job import status, takes, worker
from ...job.install.environment import engine_python
from ...job.operator import JobOperator
from ...job.worker_command import command, environment
from .request import EditRequest


class SEEING_WIND_OT_resimulate(JobOperator, bpy.types.Operator):
    """Simulate the inserted bodies in the recovered field, with the same physics"""

    bl_idname = "seeing_wind.resimulate"
    bl_label = "Re-simulate"
    bl_options = {"UNDO"}
    step = "resimulate"

    def start(self, scene):
        """Write the edit, then let the engine simulate it."""
        from .edit_export import export_edit  # needs NumPy
        from .lone_wind import adopt, lone_wind

        settings, python = scene.seeing_wind, engine_python()
        alone = lone_wind(scene)
        if alone is not None:
            adopt(scene, alone)
        source = takes.recovered(settings)
        self.folder = takes.edit_folder(settings, source)
        takes.refuse_in_use(self.folder)
        request = EditRequest.of(scene)
        for body, asked in zip(settings.bodies, request.bodies, strict=True):
            body.result = asked.result
        edit, self.remarks = export_edit(request, scene, source, self.folder)
        self.digest = request.digest()
        self.simulated = [(body.object.session_uid, body.called) for body in request.bodies if body.object is not None]
        self.of_edit, self.names = settings.edit_folder, {_who(body): body.result for body in settings.bodies}
        call = command(python, "resimulate", str(source), "--edit", str(edit), "--take", str(self.folder))
        return worker.run(call, cwd=str(self.folder), env=environment())

    def finish(self, scene, result):
        """The motion stays in the take until it is baked."""
        settings = scene.seeing_wind
        here = {obj.session_uid for obj in scene.objects}
        gone = [name for uid, name in self.simulated if uid not in here]
        said = [f"{name} was deleted while it was simulated: take it off the list, or undo its deletion" for name in gone]
        status.of(scene.session_uid).warnings.extend(said + self.remarks)
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


CLASSES = (SEEING_WIND_OT_resimulate,)
