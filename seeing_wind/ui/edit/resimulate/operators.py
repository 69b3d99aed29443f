"""Simulate the edit in the recovered field, in full or as a preview."""

import bpy

from ....engine.errors import SeeingWindError, UsageError
from ...field.library.copies import mend
from ...job import status, takes, worker
from ...job.install.environment import engine_python
from ...job.operator import JobOperator
from ...job.worker_command import command, environment
from ...scene_units import refuse_other_units
from . import preview
from .request import EditRequest


class Simulation(JobOperator):
    """Mix-in for both operators: the engine simulates the edit, and the motion is kept in a take of its own until it is baked."""

    take, digest_kept, stamp_kept = "", "", ""
    """Names of the edit's properties that store the result's folder, the digest of its settings, and the engine's stamp."""
    coarse = False
    """Whether the simulation is a preview."""

    def start(self, scene):
        """Write the edit, then let the engine simulate it."""
        from .edit_export import export_edit  # needs NumPy
        from .lone_wind import adopt, lone_wind

        settings, python = scene.seeing_wind, engine_python()
        mend(scene)
        alone = lone_wind(scene)
        field = alone or settings.field_object
        if field is not None and scene in field.users_scene:
            refuse_other_units(field, scene)
        moved = adopt(scene, alone) if alone is not None else []
        source = takes.recovered(settings)
        self.alone, self.as_shown = None if alone is None else alone.session_uid, _as_shown(settings)
        request = EditRequest.of(scene)
        digest = self.digest_of(scene, request.digest())
        self.folder = takes.edit_folder(settings, source, preview=self.coarse)
        takes.refuse_in_use(self.folder)
        takes.refuse_read_only(
            self.folder, f"Save this file into a folder that can be written, put a copy of {source.name} beside it and try again."
        )
        for body, asked in zip(settings.bodies, request.bodies, strict=True):
            body.result = asked.result
        edit, remarks = export_edit(request, scene, source, self.folder, preview=self.coarse)
        self.remarks = moved + remarks
        self.digest = digest
        self.simulated = [(body.object.session_uid, body.called) for body in request.bodies if body.object is not None]
        self.of_edit, self.names = settings.edit_folder, {_who(body): body.result for body in settings.bodies}
        call = command(python, "resimulate", str(source), "--edit", str(edit), "--take", str(self.folder))
        return worker.run(call, cwd=str(self.folder), env=environment())

    def digest_of(self, scene, edit):
        """Digest of the settings that are simulated; `edit` is the digest of the edit. May raise SeeingWindError."""
        return edit

    def finish(self, scene, result):
        """Note the result with its edit. It is baked at once if the objects show a preview, or if it is a preview itself."""
        settings = scene.seeing_wind
        here = {obj.session_uid: obj for obj in scene.objects}
        if self.alone in here and self.as_shown != _as_shown(settings):  # an undo during the simulation has reverted the adoption
            from .lone_wind import adopt  # needs NumPy

            adopt(scene, here[self.alone])
        gone = [name for uid, name in self.simulated if uid not in here]
        said = [f"{name} was deleted while it was simulated: take it off the list, or undo its deletion" for name in gone]
        status.of(scene.session_uid).warnings.extend(said + self.remarks)
        edit = self.owner(scene)
        worked_on = edit == settings
        if worked_on and not self.coarse:
            status.of(scene.session_uid).overtaken = ""
        if edit is not None:
            for body in edit.bodies:  # an undo during the simulation has reverted the names
                body.result = self.names.get(_who(body), "")
            setattr(edit, self.digest_kept, self.digest)
            setattr(edit, self.take, str(self.folder))
            setattr(edit, self.stamp_kept, takes.stamp_of(self.folder, "resimulate"))
        baked = self._bake(scene) if worked_on else False
        return f"{'Previewed' if self.coarse else 'Simulated'} into {self.folder.name}{', and baked' if baked else ''}"

    def owner(self, scene):
        """The edit that was simulated, which need not be the active one any more; None if it was removed."""
        settings = scene.seeing_wind
        if settings.edit_folder == self.of_edit:
            return settings
        return next((edit for edit in settings.edits if edit.edit_folder == self.of_edit), None)

    def _bake(self, scene) -> bool:
        """Bake the new motion; a full result only where bodies show a preview. An error becomes a warning. Returns whether it baked any."""
        from ...bake.bodies import bake_bodies  # needs NumPy

        bodies = scene.seeing_wind.bodies
        names = [body.name for body in bodies] if self.coarse else preview.shown_as_preview(scene)
        try:
            for name in [""] if len(names) == len(bodies) else names:
                bake_bodies(scene, name, preview=self.coarse)
        except SeeingWindError as error:
            status.of(scene.session_uid).warnings.append(f"It is not baked: {error.message} {error.hint}")
            return False
        return bool(names)


class SEEING_WIND_OT_resimulate(Simulation, bpy.types.Operator):
    """Simulate the inserted bodies in the recovered field, with the same physics"""

    bl_idname = "seeing_wind.resimulate"
    bl_label = "Re-simulate"
    bl_options = {"UNDO"}
    step, take, digest_kept, stamp_kept = "resimulate", "simulated_take", "simulated_digest", "simulated_stamp"


class SEEING_WIND_OT_preview_edit(Simulation, bpy.types.Operator):
    """Simulate the inserted bodies quickly: coarser, and up to the last frame shown. It is baked until Re-simulate replaces it"""

    bl_idname = "seeing_wind.preview_edit"
    bl_label = "Preview"
    bl_options = {"UNDO"}
    step, take, digest_kept, stamp_kept = status.EDIT_PREVIEW, "coarse_take", "coarse_digest", "coarse_stamp"
    coarse = True

    def digest_of(self, scene, edit):
        """The preview's own digest. Raises UsageError if the full result exists already."""
        settings = scene.seeing_wind
        if edit and settings.simulated_digest == edit and takes.simulated(settings).is_dir():
            raise UsageError("The full result of this edit is there already.", "Press Bake to Keyframes to see it.")
        return preview.digest_of_preview(scene, edit)


def _as_shown(settings: bpy.types.PropertyGroup) -> tuple[str, str, int]:
    """Which field the scene shows, and its first frame."""
    return settings.recovered_take, settings.recovered_stamp, settings.frame_start


def _who(body: bpy.types.PropertyGroup) -> int:
    """Session id of the object that a body moves, which survives renaming: 0 for the clip's own object, -1 if the object is gone."""
    if body.is_recovered:
        return 0
    return body.object.session_uid if body.object is not None else -1


CLASSES = (SEEING_WIND_OT_resimulate, SEEING_WIND_OT_preview_edit)
