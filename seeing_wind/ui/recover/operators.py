"""Recover the field of a clip, and put the results of a take into the scene."""

from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty

from ...engine.errors import TakeError, UsageError
from ..job import status, takes, worker
from ..job.install.choices import outline_model
from ..job.install.environment import engine_python
from ..job.operator import JobOperator
from ..job.worker_command import ROOT, command, environment
from ..property_kinds import PATH
from ..user_paths import absolute
from .properties import RecoverOptions, adopt, give_back
from .request import RecoverRequest
from .shown import said_of_view


class SEEING_WIND_OT_recover(JobOperator, RecoverOptions, bpy.types.Operator):
    """Recover the force field that moves the object in the clip, and put it into the scene"""

    bl_idname = "seeing_wind.recover"
    bl_label = "Recover"
    # No REGISTER: a change in the redo panel would start minutes of work.
    bl_options = {"UNDO"}
    step = "recover"

    mask_data: StringProperty(
        name="Mask Data", options={"SKIP_SAVE"}, description="Name of a Blender mask; with object_mode='BLENDER_MASK'"
    )
    held_mask: StringProperty(
        name="Held Mask", options={"SKIP_SAVE"}, description="Name of a Blender mask; with held_mode='BLENDER_MASK'"
    )
    proxy: StringProperty(name="Proxy", options={"SKIP_SAVE"}, description="Name of a mesh object; with scale_mode='PROXY'")

    def start(self, scene):
        """Store the options given as keyword arguments in the scene's settings, then start the job."""
        settings = scene.seeing_wind
        self.given = adopt(settings, self.properties)
        request, python = RecoverRequest.of(scene), engine_python()
        self.digest, self.folder, self.clip = request.digest(), request.take, request.clip
        takes.refuse_of_another(self.folder, self.clip)
        takes.refuse_read_only(self.folder, "Choose another Take, or save this file into a folder that can be written.")
        takes.bring_along(settings, self.folder)
        request.write_inputs()
        return self._messages(python, request)

    def _messages(self, python: str, request: RecoverRequest) -> "worker.Messages":
        from .sampling import sampling  # needs NumPy

        call = command(python, "recover", *request.arguments())
        last = yield from worker.run(call, cwd=str(ROOT), env=environment(outline_model=outline_model()))
        if last["outcome"] == "done":
            last = yield from sampling(python, request.take)
        return last

    def withdraw(self, scene):
        """Restore the settings that `start` replaced, so that options which failed do not affect the next run."""
        given, self.given = getattr(self, "given", {}), {}
        if given:
            give_back(scene.seeing_wind, given)
            self.digest = ""  # so that the failure is shown beside the restored settings

    def finish(self, scene, result):
        """Build the field object, the arrows, the camera and the recovered object."""
        from . import results  # needs NumPy

        results.build(scene, self.folder, self.clip)
        takes.show(scene.seeing_wind, self.folder, self.digest)
        status.of(scene.session_uid).warnings = _left_behind(scene.seeing_wind, self.folder) + results.notes(scene, self.folder)
        _say_what_is_not_seen(self, scene)
        return f"Recovered into {self.folder.name}. Next: play it, then insert a mesh (step 4)"


def _left_behind(settings: bpy.types.PropertyGroup, folder: Path) -> list[str]:
    """A warning when the .blend file was saved under another path during the recovery, so that the take is not in the present folder."""
    if folder.parent == takes.take_folder(settings).parent:
        return []
    if takes.is_temporary(folder):
        return ["This file was saved for the first time while it was recovered: save it again, and the results come along"]
    return [f"This file was saved in another folder while it was recovered: its results stay in {folder}"]


def _say_what_is_not_seen(operator: bpy.types.Operator, scene: bpy.types.Scene) -> None:
    """Report once, for scripts, why the field is not visible; the panel shows it as long as it holds."""
    for each in said_of_view(scene):
        operator.report({"WARNING"}, each)


class SEEING_WIND_OT_build_scene(JobOperator, bpy.types.Operator):
    """Put the results of a take into the scene: field object, arrows, camera with the clip behind it, the recovered object"""

    bl_idname = "seeing_wind.build_scene"
    bl_label = "Load Results"
    bl_options = {"UNDO"}
    step = "recover"

    take: StringProperty(
        name="Take", subtype="DIR_PATH", options=PATH, description="Folder of the results; empty: that of the settings"
    )
    clip: StringProperty(name="Clip", subtype="FILE_PATH", options=PATH, description="The video, if it has been moved since")

    def start(self, scene):
        """Ask the engine for the field at the points that the scene needs."""
        settings = scene.seeing_wind
        if self.take:
            self.folder = Path(absolute(self.take))
        else:
            if not (settings.recovered_take or settings.take or settings.clip):
                raise TakeError(takes.NO_FIELD, "Run Recover first, or choose the folder of a take.")
            self.folder = takes.shown(settings) if settings.recovered_take else takes.take_folder(settings)
        if not self.folder.is_dir():
            raise TakeError(*takes.gone(self.folder))
        if not (self.folder / "field.safetensors").is_file():
            raise TakeError(f"{self.folder} holds no recovered field.", "Run Recover first, or choose another folder.")
        from .sampling import sampling  # needs NumPy

        return sampling(engine_python(), self.folder)

    def finish(self, scene, result):
        """Build the results as Recover does; record the settings' digest as the take's only if the settings were filled from it."""
        from . import results  # needs NumPy

        filled = results.build(scene, self.folder, absolute(self.clip) if self.clip else "")
        settings = scene.seeing_wind
        if not takes.is_shown(settings, self.folder):
            takes.show(settings, self.folder, results.digest_of_loaded(scene, filled))
        status.of(scene.session_uid).warnings = results.notes(scene, self.folder)
        _say_what_is_not_seen(self, scene)
        return f"Loaded {self.folder.name}"


class SEEING_WIND_OT_join(JobOperator, bpy.types.Operator):
    """Find one wind for several objects of the clip, each recovered into a take of its own, and leave it in all of their takes"""

    bl_idname = "seeing_wind.join"
    bl_label = "One Wind for All"
    bl_options = {"UNDO"}
    step = "recover"

    take: StringProperty(
        name="Other Take", subtype="DIR_PATH", options=PATH | {"SKIP_SAVE"},
        description="Results of another object of the clip; empty: those of all recovered winds in the scene",
    )  # fmt: skip

    def start(self, scene):
        """Start with the scene's own take first, since its wind is the one that the scene then shows."""
        settings = scene.seeing_wind
        if not settings.recovered_take:
            raise UsageError(takes.NO_FIELD, "Run Recover first, or load the results of a take.")
        self.folder = takes.shown(settings)
        named = [self.take] if self.take else [obj["seeing_wind_take"] for obj in scene.objects if obj.get("seeing_wind_take")]
        self.folders = list(dict.fromkeys(each.resolve() for each in (self.folder, *(Path(absolute(name)) for name in named))))
        if len(self.folders) < 2:
            raise UsageError("The scene shows the wind of one object only.", "Recover another object of the clip, or choose its take.")
        return self._messages(engine_python())

    def _messages(self, python: str) -> "worker.Messages":
        from .sampling import sampling  # needs NumPy

        call = command(python, "join", *map(str, self.folders))
        last = yield from worker.run(call, cwd=str(ROOT), env=environment())
        if last["outcome"] == "done":
            last = yield from sampling(python, self.folder)
        return last

    def finish(self, scene, result):
        """Show the joint wind, whose field covers all of the objects."""
        from . import results  # needs NumPy

        results.build(scene, self.folder)
        field, now = scene.seeing_wind.field_object, status.of(scene.session_uid)
        now.warnings = results.notes(scene, self.folder)
        others = [obj.name for obj in scene.objects if obj.get("seeing_wind_take") and obj != field]
        if others:
            now.warnings.insert(0, f"{field.name} is the wind of all objects: delete {', '.join(others)}, or solvers feel it twice")
        return f"One wind for {', '.join(each.stem for each in self.folders)}"


class SEEING_WIND_OT_open_report(bpy.types.Operator):
    """Open the recovery's report, its video or its folder"""

    bl_idname = "seeing_wind.open_report"
    bl_label = "Open Report"

    which: EnumProperty(name="Which", description="What to open", items=[
        ("report.png", "Report", "Force strength, residuals and confidence over time"),
        ("overlay.mp4", "Overlay", "The clip with the recovered forces drawn on it"),
        (".", "Folder", "The folder of the take"),
    ])  # fmt: skip

    @classmethod
    def poll(cls, context):
        """Only after a recovery."""
        return bool(context.scene.seeing_wind.recovered_take)

    def execute(self, context):
        """Open it in the system's own viewer; without a window, only report its path."""
        path = takes.shown(context.scene.seeing_wind) / self.which
        if not path.exists():
            self.report({"ERROR"}, f"There is no {path}. Run Recover again.")
            return {"CANCELLED"}
        self.report({"INFO"}, str(path))
        return {"FINISHED"} if bpy.app.background else bpy.ops.wm.path_open(filepath=str(path))


CLASSES = (SEEING_WIND_OT_recover, SEEING_WIND_OT_build_scene, SEEING_WIND_OT_join, SEEING_WIND_OT_open_report)
