"""Names and texts by which the field's objects are known and read. Without NumPy: panels are drawn before anything is made."""

from __future__ import annotations

import importlib.util
import math
from typing import Any

from ...engine.conventions import beaufort, in_figures

ARROWS_MATERIAL = "Seeing Wind Arrows"

SAMPLES_MARK, LEGEND_MARK = "seeing_wind_samples", "seeing_wind_legend"
"""Custom properties of the object with the field's values, and of the arrows' legend."""

CARRIED = "seeing_wind_carried"
"""Custom property of the field object: the object with its values."""


FORCE, WIND = "FORCE", "WIND"
"""What solvers feel of a field object: a force per volume, or air that moves. Its custom property `KIND`."""

KIND, SPEEDS = "seeing_wind_kind", "seeing_wind_speeds"
"""Custom properties of a field object: what solvers feel, and, only where it has a wind, its mean and its strongest gust [m/s]."""

DRAG, LINEAR = "seeing_wind_drag", "seeing_wind_linear"
"""Custom properties of a field with a wind, see `solvers.in_wind`. The pressure on a plate across it over the square of the speed [kg/m³];
the speed [m/s] at which Blender's drag, which is linear, is right, and how far it is off in the mean."""

BLOWS = "seeing_wind_blows"
"""Custom property of a field object: 1 where solvers feel a wind, else 0; for drivers."""

NODES = "seeing_wind_nodes"
"""Custom property of a field object: nodes of its lattice along x, y and z."""

FELT = "seeing_wind_felt"
"""Custom property of a collection that was made so that solvers feel one kind of field, see `solvers.apart`."""

STRIDE = "seeing_wind_stride"
"""Custom property of a field object: scene frames that a clip frame lasts; 1 unless it was conformed to the scene's frame rate."""


SURE = "seeing_wind_sure"
"""Custom property of the arrows: for each frame the greatest confidence of any, in 0..1."""

ARROWS = "seeing_wind_arrows"
"""Custom property of a field object that was taken from the library: its arrows, which were made then; of these: True."""

WITH_FIELD = "seeing_wind_with_field"
"""Custom property of the object with a field's values: True where it goes with the field, of a copy and of a wind out of the library."""

SLOWS = "seeing_wind_slows"
"""Custom property of the companion that slows what moves in a wind: the field object. See `solvers.in_wind`."""

LOOP = "seeing_wind_loop"
"""Custom property of a field object: whether its first frame follows its last; the user's."""


def said_of_unseen(arrows: Any, asked: float) -> str:
    """Why arrows are drawn in few frames or none; "" where they are in most.

    Args:
        asked: the confidence below which they are hidden.
    """
    sure = list(arrows.get(SURE, ()))
    shown = sum(each > asked for each in sure)
    if 2 * shown >= len(sure):
        return ""
    why = f"the confidence is {max(sure):.2g} at most, and Min Confidence in the panel Field asks for more than {asked:.2g}"
    return f"Arrows are drawn in {shown or 'none'} of {len(sure)} frames: {why}"


def frames_per_second(scene: Any) -> float:
    """The scene's frame rate."""
    return scene.render.fps / scene.render.fps_base


def stride_of(field: Any) -> float:
    """Scene frames that a clip frame of a field lasts."""
    return field[STRIDE]


def blows_from_to(field: Any) -> tuple[int, int]:
    """Scene frames at which a field's first clip frame begins and its last one ends, the first round of one that loops."""
    first = int(field["seeing_wind_frame_start"])
    return first, first + math.ceil(stride_of(field) * field["seeing_wind_frames"] - 1e-6)


def said_of_speed(field: Any, scene: Any) -> str:
    """How much faster or slower than filmed a field goes by; "" at the right speed."""
    speed = frames_per_second(scene) / (stride_of(field) * field["seeing_wind_fps"])
    if abs(speed - 1.0) < 1e-3:
        return ""
    rates = f"{field['seeing_wind_fps']:.4g} clip frames and {frames_per_second(scene):.4g} scene frames a second"
    return f"Plays at {speed:.3g} times the speed of the clip ({rates})"


def said_of_pace(stride: float) -> str:
    """What becomes of a clip's frames where each lasts `stride` frames of the scene; "" where that is one."""
    if abs(stride - 1.0) < 1e-3:
        return ""
    if stride > 1.0:
        return f"every scene frame shows the nearest clip frame: {100.0 * (1.0 - 1.0 / stride):.2g} in 100 repeat the one before"
    return f"every scene frame shows the nearest clip frame: {100.0 * (1.0 - stride):.2g} in 100 clip frames are left out"


def said_of_mirror(field: Any) -> str:
    """What a negative scale does to a field, its own or a parent's; "" without one."""
    if field.matrix_world.determinant() >= 0.0:
        return ""
    return "Mirrored by a negative scale: solvers feel this wind against its arrows, in the opposite direction. Turn it instead"


def said_of_override(field: Any) -> str:
    """What a library override that is turned does not turn; "" for any other field."""
    linked = field.override_library.reference if field.override_library is not None else None
    texture = field.field.texture
    if linked is None or texture is None or texture.library is None:  # one in this file turns with it
        return ""
    if linked.matrix_world.to_quaternion().rotation_difference(field.matrix_world.to_quaternion()).angle < 1e-3:
        return ""
    return "A library override that is turned: Blender's solvers feel it at its new place, in the old directions"


def has_wind(field: Any) -> bool:
    """Whether a field object carries the velocity of a wind beside its force."""
    return field is not None and SPEEDS in field


def is_wind(field: Any) -> bool:
    """Whether solvers feel a field object as air that moves."""
    return field is not None and field.get(KIND) == WIND


def share(field: Any) -> float:
    """Strength of a field object over the recovered one: the user's factor."""
    return field.field.strength / field.get("seeing_wind_strength", field.field.strength or 1.0)


def in_beaufort(speed: float) -> str:
    """A speed [m/s] with its number."""
    return f"{in_figures(speed, 2)} m/s (Beaufort {beaufort(speed)})"


def said_of_wind(field: Any) -> str:
    """How strong a field's wind blows as its strength is set; "" for one without."""
    if not has_wind(field):
        return ""
    mean, gust = (in_beaufort(abs(share(field)) * speed) for speed in field[SPEEDS])
    return f"Wind: {mean} in the mean, gusts up to {gust}"


def said_of_fit(field: Any) -> str:
    """How far Blender's solvers feel a field object off the recovered field, in the mean over its box; "" where it was not measured."""
    error = field.get("seeing_wind_error")
    if error is None:
        return ""
    what = "wind" if is_wind(field) else "field"
    nodes = " x ".join(f"{count}" for count in field[NODES])
    return f"{nodes} nodes; between them solvers feel about {100.0 * error[1]:.1f} % and {error[0]:.1f}° off the recovered {what}"


def arrows_of(field: Any, scene: Any) -> Any:
    """The arrows that show a field object in a scene; None where there are none."""
    arrows = scene.seeing_wind.arrows_object
    if arrows is None or arrows.parent != field:
        arrows = field.get(ARROWS)
    return arrows if arrows is not None and arrows.parent == field and scene in arrows.users_scene else None


def lacks_arrows(obj: Any) -> bool:
    """Whether an object is a wind that came without its take and has no arrows yet: out of the library, or a copy of such a one."""
    if not is_field(obj) or not has_wind(obj) or obj.get("seeing_wind_take") or obj.library is not None or obj.override_library is not None:
        return False
    arrows = obj.get(ARROWS)
    return ARROWS not in obj or (arrows is not None and arrows.parent != obj)


def has_lost_field(obj: Any, scene: Any) -> bool:
    """Whether an object belongs to a field that has been deleted since: arrows of a wind out of the library, values of one or of a copy,
    or what slows in a wind."""
    if obj.library is None and SLOWS in obj:
        return obj[SLOWS] is None or scene not in obj[SLOWS].users_scene
    if obj.library is not None or not (obj.get(ARROWS) is True or WITH_FIELD in obj):
        return False
    return obj.parent is None or scene not in obj.parent.users_scene


def is_field(obj: Any) -> bool:
    """Whether an object is a recovered field: of this scene's own Recover, appended, or linked."""
    return obj is not None and "seeing_wind_density" in obj and obj.field is not None and obj.field.type == "TEXTURE"


def home_of(field: Any, scene: Any) -> Any:
    """The collection in which what belongs to a field object has its place: of this file, and none that only says who feels it."""
    return next((each for each in field.users_collection if each.library is None and FELT not in each), scene.collection)


def field_at_hand(context: Any) -> Any:
    """The field that a selection means, else the scene's own; None when there is none."""
    # a script that a Blender with a window starts with has no window yet, and its context no selection
    selected = (getattr(context, "active_object", None), *getattr(context, "selected_objects", ()))
    candidates = (*selected, context.scene.seeing_wind.field_object)
    return next((obj for obj in candidates if is_field(obj)), None)


def out_of_time(scene: Any) -> list[Any]:
    """Calibrations that were made for a field that was felt otherwise, or rigid bodies' for another frame rate than the scene has now.

    The other solvers count a field per frame, and a clip frame is a frame whatever the rate.
    """
    fps = frames_per_second(scene)
    listed = (each for each in scene.seeing_wind.calibrations if each.object is not None and each.field is not None)
    return [
        each for each in listed
        if each.wind != is_wind(each.field) or (each.object.rigid_body is not None and abs(each.fps - fps) > 1e-3 * fps)
    ]  # fmt: skip


def openvdb_available() -> bool:
    """Whether there is an OpenVDB for Python: in Blender's own builds, not in the `bpy` wheels."""
    return importlib.util.find_spec("openvdb") is not None
