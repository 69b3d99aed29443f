"""The settings of the step *Recover*, and what a scene records about its results. Names, units and defaults are those of the command line.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, PointerProperty, StringProperty

from ...engine.errors import UsageError
from ...engine.settings import RecoverSettings, WindSettings
from ..clip.object.properties import ObjectOptions
from ..clip.properties import ClipOptions
from ..job.notes import SEEING_WIND_PG_note
from ..option_properties import with_options
from ..property_kinds import PATH, changed, choice

Given = dict[str, tuple[Any, Any]]
"""Options that an operator was called with: what the scene had before, and what it has of them now."""

DATA = {"mask_data": "masks", "held_mask": "masks", "proxy": "objects"}
"""Datablocks that an operator takes by name, and the collection of Blender's data that each is in."""

MODES = {
    "box": ("object_mode", "BOX"),
    "mask": ("object_mode", "MASK"),
    "pin": ("held_mode", "FILE"),
    "held_box": ("held_mode", "BOX"),
    "distance": ("scale_mode", "DISTANCE"),
    "pixels_per_metre": ("scale_mode", "PIXELS"),
    "fov": ("camera_mode", "FOV"),
    "camera": ("camera_mode", "JSON"),
    "gravity": ("gravity_mode", "CUSTOM"),
}
"""A keyword argument that chooses a mode as well, unless the mode is given too; of two, the later."""


@with_options(WindSettings)
@with_options(RecoverSettings)
class RecoverOptions(ClipOptions, ObjectOptions):
    """All options of Recover: a scene has them as settings, the operator as keyword arguments."""

    gravity_mode: choice("Gravity", "Known acceleration that is not part of the recovered field", [
        ("SCENE", "Scene", "The scene's gravity, if it is on"),
        ("NONE", "None", "Gravity counts as part of the field"),
        ("CUSTOM", "Custom", "An acceleration of your own"),
    ])  # fmt: skip
    take: StringProperty(
        name="Take", subtype="DIR_PATH", options=PATH, update=changed,
        description="Folder of the results; empty: CLIP.take beside the .blend file, or in the temporary folder while it is unsaved",
    )  # fmt: skip


class RecoverResults:
    """The results, and the settings that they were made with; saved in the .blend file and subject to undo."""

    unfinished: StringProperty(options={"HIDDEN"}, description="The step whose job runs: says after a reopening that it was cut off")
    recovered_digest: StringProperty(options={"HIDDEN"})
    recovered_take: StringProperty(options={"HIDDEN"}, description="The take that the scene shows")
    recovered_stamp: StringProperty(options={"HIDDEN"}, description="Of its field: tells when another one has taken its place")
    field_verdict: StringProperty(
        options={"HIDDEN"}, description="What the recovery says about its field: a force or a wind, how strong, and why"
    )
    recovered_notes: CollectionProperty(type=SEEING_WIND_PG_note)
    answers_gravity: BoolProperty(
        options={"HIDDEN"}, description="The field is what holds up an object of which nothing was marked as held, not a wind"
    )
    owner: StringProperty(options={"HIDDEN"}, description="By which edits in takes are known to be this scene's")
    owner_file: StringProperty(options={"HIDDEN"}, description="The .blend file that wrote the last of them")
    started_take: StringProperty(options={"HIDDEN"}, description="Where the last Recover of this scene went")
    field_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})
    arrows_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})
    recovered_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})
    camera_object: PointerProperty(type=bpy.types.Object, options={"HIDDEN"})


OPTIONS = tuple(name for base in (ClipOptions, ObjectOptions, RecoverOptions) for name in base.__annotations__)
"""Names of all options of Recover."""

IMPLIED = MODES | {name.removeprefix("use_"): (name, True) for name in OPTIONS if name.startswith("use_")}
"""`MODES`, and for each optional number the checkbox in front of it."""


def adopt(settings: bpy.types.PropertyGroup, arguments: bpy.types.OperatorProperties) -> Given:
    """Take over an operator's options, datablocks, and the modes that they imply. Returns the former and new values, for `give_back`.

    Raises:
        UsageError: when there is no datablock of the given name; the settings are then unchanged.
    """
    data = {name: _found(settings, name, getattr(arguments, name)) for name in DATA if arguments.is_property_set(name)}
    given = [name for name in OPTIONS if arguments.is_property_set(name)]
    modes = {mode: value for name, (mode, value) in IMPLIED.items() if name in given and mode not in given}
    former = {name: _plain(getattr(settings, name)) for name in (*modes, *given, *data)}
    for name, value in (modes | data).items():
        setattr(settings, name, value)
    for name in given:
        setattr(settings, name, getattr(arguments, name))
    return {name: (value, _plain(getattr(settings, name))) for name, value in former.items()}


def give_back(settings: bpy.types.PropertyGroup, given: Given) -> None:
    """Restore the values that `adopt` replaced, except where a value was changed since."""
    for name, (former, taken) in given.items():
        if _plain(getattr(settings, name)) == taken:
            setattr(settings, name, _with_id(DATA[name], former) if name in DATA else former)


def _found(settings: bpy.types.PropertyGroup, name: str, called: str) -> bpy.types.ID:
    """The datablock for an option of `DATA`; of objects, one of the scene. Raises UsageError when there is none."""
    pool = settings.id_data.objects if DATA[name] == "objects" else getattr(bpy.data, DATA[name])
    found = pool.get(called)
    if found is None:
        raise UsageError(f"There is no {called!r} in this file.", "Check the name.")
    return found


def _with_id(pool: str, session_uid: int | None) -> bpy.types.ID | None:
    """The datablock with this session id; None if the user has deleted it since."""
    return next((each for each in getattr(bpy.data, pool) if each.session_uid == session_uid), None)


def _plain(value: Any) -> Any:
    """A property's value as a copy that later changes of the property do not affect; of a datablock, which an undo replaces, its id."""
    if isinstance(value, bpy.types.ID):
        return value.session_uid
    return tuple(value) if isinstance(value, bpy.types.bpy_prop_array) else value
