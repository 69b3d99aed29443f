"""The field object in the rest of Blender: its calibration for native solvers, its export to other programs."""

import os
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from ...engine.errors import SeeingWindError, UsageError
from ..direct_operator import DirectOperator
from ..job import console, takes, worker
from ..job.install.environment import engine_python
from ..job.panel_words import in_panel_words
from ..job.worker_command import command, environment
from ..property_kinds import PATH
from ..scene_units import refuse_other_units
from ..user_paths import absolute
from .display import field_at_hand, frames_per_second, is_field, is_wind, openvdb_available, out_of_time, said_of_fit, said_of_pace
from .library.copies import mend

ONE_FILE = [
    ("FGA", "FGA", "Vector field of Unreal Engine, one file per frame"),
    ("PLY", "PLY", "Points with force and confidence, one file per frame"),
    ("NPZ", "NPZ", "NumPy arrays of the whole field"),
]
FORMATS = [
    ("VDB", "OpenVDB", "Volumes with the grids force, velocity (of a wind) and confidence, one file per frame, written by Blender"),
    *ONE_FILE,
]
DEFAULT = "VDB" if openvdb_available() else "NPZ"
"""A format that this build of Blender can write as it is."""


def chosen_field(context: bpy.types.Context, name: str) -> bpy.types.Object:
    """The field to act on: the named one, else a selected one, else the scene's own, else the only one in the scene.

    Raises:
        UsageError: when there is none, or there are several and none is chosen.
    """
    if name:
        found = context.scene.objects.get(name)
        if not is_field(found):
            raise UsageError(f"{name} is no recovered force field of this scene.", "Name the object that Recover made.")
        return found
    if field_at_hand(context) is not None:
        return field_at_hand(context)
    fields = [obj for obj in context.scene.objects if is_field(obj)]
    if len(fields) > 1:
        names = ", ".join(obj.name for obj in fields[:4])
        raise UsageError(f"There are several recovered fields: {names}.", "Select the one that is meant, too.")
    if not fields:
        raise UsageError("There is no recovered field.", "Run Recover first, load the results of a take, or append a field.")
    return fields[0]


def matter_of(given: Any) -> dict[str, Any]:
    """Keyword arguments of `calibrate_object` from calibration options: those of the operator, or stored ones."""
    return {
        "density": given.density or None, "alone": given.alone, "set_mass": given.set_mass, "areal_density": given.areal_density or 0.12,
    }  # fmt: skip


class SEEING_WIND_OT_apply_to_field(DirectOperator, bpy.types.Operator):
    """Rebuild the force field that Blender's solvers feel, with the settings above"""

    bl_idname = "seeing_wind.apply_to_field"
    bl_label = "Apply to Field"

    field: StringProperty(name="Field", options={"SKIP_SAVE"}, description="Name of the field; empty: the selected or the scene's own")

    def act(self, context):
        """Make the texture anew; needs neither the take nor the engine."""
        from .field_object import make_again  # needs NumPy
        from .solvers.apart import keep_apart

        field, settings = chosen_field(context, self.field), context.scene.seeing_wind
        mend(context.scene)
        make_again(field, settings.field_reach, settings.field_kind)
        keep_apart(context.scene)
        return f"{field.name}: {said_of_fit(field)}"


class SEEING_WIND_OT_turn_override(DirectOperator, bpy.types.Operator):
    """Let Blender's solvers feel a turned override of a linked wind in its new direction: it gets a texture in this file"""

    bl_idname = "seeing_wind.turn_override"
    bl_label = "Turn the Wind Too"

    field: StringProperty(name="Field", options={"SKIP_SAVE"}, description="Name of the field; empty: the selected or the scene's own")

    def act(self, context):
        """Give the override its own texture; its values stay in the library."""
        from .field_object import turn_override  # needs NumPy

        field = chosen_field(context, self.field)
        turn_override(field)
        return f"{field.name} blows as it is turned"


class SEEING_WIND_OT_calibrate(DirectOperator, bpy.types.Operator):
    """Let the chosen object's particles, hair, cloth, rigid body or physics nodes accelerate in the recovered wind as real matter does"""

    bl_idname = "seeing_wind.calibrate"
    bl_label = "Calibrate for Object"

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of the object; empty: the active one")
    field: StringProperty(name="Field", options={"SKIP_SAVE"}, description="Name of the field; empty: the selected or the scene's own")
    every: BoolProperty(
        name="All Objects", options={"SKIP_SAVE"}, description="Calibrate every object of the scene that has a solver which feels wind"
    )
    density: FloatProperty(
        name="Density (kg/m³)", default=0.0, min=0.0, soft_max=20000.0, step=1000, precision=1, options={"SKIP_SAVE"},
        description="Of the object's matter in kilograms per cubic metre; 0: as the recovered object",
    )  # fmt: skip
    areal_density: FloatProperty(
        name="Areal Density (kg/m²)", default=0.12, min=1e-4, soft_max=2.0, step=1, precision=3, options={"SKIP_SAVE"},
        description="Of cloth in a wind, in kilograms per square metre: cotton 0.12, silk 0.05, denim 0.4",
    )  # fmt: skip
    alone: BoolProperty(
        name="Only This Wind", options={"SKIP_SAVE"}, description="Feel no force fields but this one and what you put into its collection"
    )
    set_mass: BoolProperty(
        name="Set Mass", options={"SKIP_SAVE"},
        description="Rigid bodies: Blender has one weight for all of them. Change this body's mass to suit it, instead of the weight",
    )  # fmt: skip

    def act(self, context):
        """Calibrate every solver of the object; the message says what a solver cannot do."""
        from .solvers.apart import keep_apart

        mend(context.scene)
        field = chosen_field(context, self.field)
        said = self._all(context.scene, field) if self.every else self._chosen(context, field)
        keep_apart(context.scene)  # objects calibrated earlier may not have been separated from a field of the other kind yet
        return said

    def _chosen(self, context, field):
        obj = context.scene.objects.get(self.object) if self.object else context.active_object
        if obj is None:
            raise UsageError(f"There is no object {self.object!r}." if self.object else "No object is active.", "Select one.")
        if obj == field:
            raise UsageError(f"{obj.name} is the wind itself.", "Make the object active that is to feel it, and select the field too.")
        return self._one(context.scene, obj, field)

    def _one(self, scene, obj, field):
        from .solvers.calibration import calibrate_object  # needs NumPy

        said = calibrate_object(scene, obj, field, **matter_of(self))
        kept = scene.seeing_wind.calibrations
        number = next((number for number, each in enumerate(kept) if each.object == obj), None)
        kept.add() if number is None else kept.move(number, len(kept) - 1)
        entry = kept[-1]  # kept last: the common weight of all rigid bodies is that of the last entry
        entry.object, entry.field, entry.fps = obj, field, frames_per_second(scene)
        entry.said, entry.wind, entry.areal_density = "; ".join(said), is_wind(field), self.areal_density
        entry.density, entry.alone, entry.set_mass = self.density, self.alone, self.set_mass
        return entry.said

    def _all(self, scene, field):
        """Calibrate each object on its own, so that one failure does not prevent the others."""
        from .solvers.apart import said_of_others
        from .solvers.calibration import has_solver  # needs NumPy

        able, done, failed = [obj for obj in scene.objects if obj != field and has_solver(obj)], [], []
        if not able:
            raise UsageError("Nothing in this scene feels wind.", "Add a particle system, cloth, a rigid body or physics nodes first.")
        for obj in able:
            try:
                self._one(scene, obj, field)
                done.append(obj.name)
            except UsageError as error:
                failed.append(f"{obj.name}: {error.message}")
        if not done:
            raise UsageError("; ".join(failed), "Calibrate them one by one.")
        others = dict.fromkeys(line for obj in able for line in said_of_others(scene, obj, field, self.alone))
        return "; ".join([f"Calibrated {', '.join(done)} for {field.name}", *failed, *others])


class SEEING_WIND_OT_calibrate_again(DirectOperator, bpy.types.Operator):
    """Calibrate again every object that was calibrated for another frame rate or kind of field: solvers count the wind per frame"""

    bl_idname = "seeing_wind.calibrate_again"
    bl_label = "Calibrate Again"

    def act(self, context):
        """Calibrate outdated objects again with their stored options."""
        from .solvers.calibration import calibrate_object  # needs NumPy

        scene, done = context.scene, []
        if not scene.seeing_wind.calibrations:
            raise UsageError("No object of this scene has been calibrated.", "Select one and run Calibrate for Object.")
        for entry in out_of_time(scene):
            entry.said = "; ".join(calibrate_object(scene, entry.object, entry.field, **matter_of(entry)))
            entry.wind, entry.fps = is_wind(entry.field), frames_per_second(scene)
            done.append(entry.object.name)
        rate = f"{frames_per_second(scene):.4g} frames per second"
        return f"Calibrated {', '.join(done)} for {rate}" if done else "Every calibration fits the frame rate"


class SEEING_WIND_OT_conform(DirectOperator, bpy.types.Operator):
    """Play field, object, clip and bakes at the clip's own speed, whatever the frame rate; or one clip frame per scene frame"""

    bl_idname = "seeing_wind.conform"
    bl_label = "Conform to Frame Rate"

    field: StringProperty(name="Field", options={"SKIP_SAVE"}, description="Name of the field; empty: the selected or the scene's own")
    real_time: BoolProperty(
        name="Real Time", default=True, options={"SKIP_SAVE"},
        description="A second of the clip is a second of the scene; otherwise one clip frame is one scene frame",
    )  # fmt: skip

    def act(self, context):
        """Retime the field, and renew the calibrations made for it."""
        from .conform import conform, said_of_own_camera  # need NumPy
        from .solvers.calibration import calibrate_object

        scene, field = context.scene, chosen_field(context, self.field)
        stride = conform(scene, field, self.real_time)
        entries = [each for each in scene.seeing_wind.calibrations if each.field == field and each.object is not None]
        for entry in entries:
            entry.said = "; ".join(calibrate_object(scene, entry.object, field, **matter_of(entry)))
            entry.wind, entry.fps = is_wind(field), frames_per_second(scene)
        lasts = f"{stride:.4g}"
        said = [f"{field.name}: a clip frame lasts {lasts} scene frame{'' if lasts == '1' else 's'}"]
        if field == scene.seeing_wind.field_object and scene.seeing_wind.camera_object is not None:
            said += [said_of_pace(stride), said_of_own_camera(scene)]
        return "; ".join(each for each in said if each)


class SEEING_WIND_OT_export_field(DirectOperator, bpy.types.Operator):
    """Write the recovered field for other programs"""

    bl_idname = "seeing_wind.export_field"
    bl_label = "Export Field"
    bl_options = {"REGISTER"}

    field: StringProperty(name="Field", options={"SKIP_SAVE"}, description="Name of the field; empty: the selected or the scene's own")
    format: EnumProperty(name="Format", items=FORMATS, default=DEFAULT, options={"SKIP_SAVE"}, description="Which kind of file")
    filepath: StringProperty(
        name="To", subtype="FILE_PATH", options=PATH,
        description="Folder of the files (NPZ: the file); empty: a folder beside the take",
    )  # fmt: skip

    def act(self, context):
        """Write VDB files in Blender; the engine writes all other formats."""
        from .vdb import faded, frames_of, name_beside, said_of_clip_frames, said_of_frames, write_vdb  # need NumPy

        scene, field = context.scene, chosen_field(context, self.field)
        mend(scene)
        refuse_other_units(field, scene)
        frames = frames_of(scene, field, loops=self.format == "VDB")
        if self.format != "VDB" and field == scene.seeing_wind.field_object and takes.shows_lone(scene.seeing_wind):
            from ..edit.resimulate.lone_wind import adopt  # needs NumPy

            adopt(scene, field)  # adopt again: the scene may have become longer since
            frames = range(scene.seeing_wind.frame_start + 1, scene.frame_end + 1)
        take, name = self._take(scene, field), self.format.lower()
        target = Path(absolute(self.filepath)) if self.filepath else name_beside(take)
        if self.format == "VDB":
            files = write_vdb(scene, field, target)
            return f"Wrote {len(files)} files into {target}, for {said_of_frames(scene, frames)}"
        if self.format == "NPZ" and target.name:  # the engine appends this suffix, too
            target = target.with_name(f"{target.name.removesuffix('.npz')}.npz")
        os.makedirs(target.parent, exist_ok=True)
        call = command(engine_python(), "export", str(take), "--format", name, "--out", str(target), *faded(scene, field))
        self._run(worker.run(call, cwd=str(take), env=environment()))
        return f"Exported {name.upper()} to {target}, for {said_of_clip_frames(scene, field, frames)}"

    def _take(self, scene, field):
        """The folder of a field's take; it need not exist for VDB, which is written from the values that the field carries."""
        settings, vdb = scene.seeing_wind, self.format == "VDB"
        if field == settings.field_object and settings.recovered_take:
            take = takes.shown(settings) if vdb else takes.recovered(settings)
        else:
            named = field.get("seeing_wind_take", "")
            take = Path(absolute(named)) if named else takes.home_of(scene, field.name)
        if vdb:  # if the take is gone, its former folder may belong to another project by now
            return take if take.is_dir() else takes.home_of(scene, field.name).with_name(take.name)
        if not take.is_dir():
            raise UsageError(f"{field.name} was added without its take, which {self.format} is made from.", "Export OpenVDB instead.")
        return take

    def _run(self, messages: "worker.Messages") -> None:
        """Run the engine and wait, as it takes only seconds. Raises SeeingWindError with the engine's message."""
        errors: list[dict] = []
        out = console.ReportsBesides() if bpy.app.background else None

        def handle(message: dict) -> None:
            if message["type"] == "error":
                errors.append(message)
            if out is not None:
                out.show(message)

        if worker.wait(messages, handle)["outcome"] != "done":
            last = errors[-1] if errors else {"message": "The export failed.", "hint": ""}
            raise SeeingWindError(*(in_panel_words(str(last.get(key, ""))) for key in ("message", "hint")))


CLASSES = (
    SEEING_WIND_OT_apply_to_field, SEEING_WIND_OT_calibrate, SEEING_WIND_OT_calibrate_again, SEEING_WIND_OT_conform,
    SEEING_WIND_OT_export_field, SEEING_WIND_OT_turn_override,
)  # fmt: skip
