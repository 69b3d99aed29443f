"""What a scene already has: objects of an earlier set-up, found by name (Blender numbers a name that another scene uses); the camera and
render settings that a set-up changes; and the output settings, which are restored after a render. Without NumPy, since the panel lists the
changes beforehand."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ..scene_units import metres_per_unit

AS_FILMED = {
    "view_transform": "Standard", "look": "None", "exposure": 0.0, "gamma": 1.0, "use_curve_mapping": False, "use_white_balance": False,
}  # fmt: skip
"""View settings that leave the clip's colors as they were filmed."""
SETTING = {
    "view_transform": "view transform", "look": "look", "exposure": "view exposure", "gamma": "view gamma",
    "use_curve_mapping": "use of curves", "use_white_balance": "white balance",
}  # fmt: skip
"""Names of these settings in texts."""
FOCUS = "Seeing Wind Focus"
"""Name of the empty on which the camera focuses."""
OUTPUT = (
    ("render", ("filepath", "use_file_extension", "use_compositing", "use_sequencer")),
    ("render.image_settings", ("media_type", "file_format")),
    ("render.ffmpeg", (
        "format", "codec", "audio_codec", "constant_rate_factor", "ffmpeg_preset",
        # these get values as soon as a video format is chosen for the first time
        "video_bitrate", "minrate", "maxrate", "muxrate", "gopsize", "buffersize", "packetsize", "audio_bitrate",
    )),
    ("render.image_settings", ("color_mode", "color_depth", "color_management")),
)  # fmt: skip
"""Output settings that our render sets, or that change as a consequence. They must be restored in this order, since later ones depend on
earlier ones."""

SAME = 1e-5
"""Relative difference below which two numbers count as equal in single precision."""

ENDS = (bpy.app.handlers.render_complete, bpy.app.handlers.render_cancel)
"""Handlers that Blender calls when a render has ended."""


def is_called(datablock: bpy.types.ID, name: str) -> bool:
    """Whether a datablock has this name, with or without Blender's numeric suffix."""
    return re.sub(r"\.\d{3,}$", "", datablock.name) == name


def own_object(scene: bpy.types.Scene, name: str) -> bpy.types.Object | None:
    """The scene's object called `name`, with or without a numeric suffix, if any."""
    return scene.objects.get(name) or next((obj for obj in scene.objects if is_called(obj, name)), None)


def drop_unused(blocks: bpy.types.bpy_prop_collection, name: str) -> None:
    """Remove the datablocks called `name` that have no users any more."""
    for each in [each for each in blocks if is_called(each, name) and each.users == 0]:
        blocks.remove(each)


def samples_for(scene: bpy.types.Scene) -> int | None:
    """Samples that a set-up gives the scene: those of its look if changed since the last, or if the scene has none set; else None."""
    settings, cycles = scene.seeing_wind, getattr(scene, "cycles", None)  # the panel is drawn even if the Cycles add-on is disabled
    asked = settings.composite.samples
    return None if asked == settings.composite_samples and cycles is not None and cycles.is_property_set("samples") else asked


def changes(scene: bpy.types.Scene, use_cycles: bool, use_standard: bool, samples: int | None) -> list[tuple[str, str, Any, str]]:
    """Render settings that `set_render` changes: owner, name, new value, and the change in words. `samples` of None are unchanged."""
    render, view, found = scene.render, scene.view_settings, []
    if use_cycles and render.engine != "CYCLES":
        found.append(("render", "engine", "CYCLES", f"render engine from {_engine(render.engine)} to Cycles"))
    cycles = getattr(scene, "cycles", None)
    if cycles is not None and samples is not None and cycles.samples != samples and (use_cycles or render.engine == "CYCLES"):
        found.append(("cycles", "samples", samples, f"samples from {cycles.samples} to {samples}"))
    if not render.film_transparent:
        found.append(("render", "film_transparent", True, "film to transparent"))
    for name in _recolors(view) if use_standard else ():
        found.append(("view_settings", name, AS_FILMED[name], _instead(view, name)))
    return found


def camera_changes(scene: bpy.types.Scene, fstop: float) -> list[str]:
    """Changes that a set-up makes to the scene's camera, in words: its background images and its depth of field."""
    camera, clip, focus, found = scene.camera, scene.active_clip, own_object(scene, FOCUS), []
    if camera is None or camera.type != "CAMERA" or clip is None:
        return []
    lens = camera.data.dof
    if not camera.data.show_background_images:
        found.append(f"background images of {camera.name} on")
    if not any(each.clip == clip for each in camera.data.background_images):
        found.append(f"the clip among the background images of {camera.name}")
    if not fstop:
        ours = focus is not None and lens.focus_object == focus
        return found + [f"depth of field of {camera.name} off"] * (ours and lens.use_dof)
    if not lens.use_dof:
        found.append(f"depth of field of {camera.name} on")
    if lens.focus_object is None or lens.focus_object != focus:
        former = f" from {lens.focus_object.name}" if lens.focus_object is not None else ""
        found.append(f"focus of {camera.name}{former} to the clip's object")
    unit = metres_per_unit(scene)
    if abs(lens.aperture_fstop / (fstop * unit) - 1.0) > SAME:
        found.append(f"f-stop of {camera.name} from {lens.aperture_fstop / unit:.3g} to {fstop:.3g}")
    return found


def set_render(scene: bpy.types.Scene, use_cycles: bool, use_standard: bool, samples: int | None) -> list[str]:
    """Make the film transparent, and set engine, samples and view settings as asked. Returns the changes in words."""
    made = changes(scene, use_cycles, use_standard, samples)
    for owner, name, value, _ in made:
        setattr(getattr(scene, owner), name, value)
    return [words for *_, words in made]


def said_of_render(scene: bpy.types.Scene) -> list[str]:
    """Warnings about what the composite lacks with the scene's present engine and view settings."""
    said, engine, view = [], scene.render.engine, scene.view_settings
    if engine != "CYCLES":
        said.append(f"{_engine(engine)} catches no shadows: tick Use Cycles.")
    for name in _recolors(view):
        said.append(f"The {SETTING[name]}{_value(view, name)} changes the clip's colors, too: tick Standard View.")
    return said


def set_output(scene: bpy.types.Scene, path: Path, still: bool) -> Callable[[], None]:
    """Set the output to a PNG, or to a video (H.264 in MP4), of the composite alone.

    Returns:
        A function that restores the scene's output settings. With a window, it is called automatically once a render has ended.
    """
    settings = [(owner, scene.path_resolve(owner), name) for owner, names in OUTPUT for name in names]
    former = [(owner, name, getattr(holder, name)) for owner, holder, name in settings if hasattr(holder, name)]
    render, image, ffmpeg, known = scene.render, scene.render.image_settings, scene.render.ffmpeg, scene.session_uid
    if hasattr(image, "media_type"):  # from Blender 5.0
        image.media_type = "IMAGE" if still else "VIDEO"
    image.file_format, image.color_management = ("PNG" if still else "FFMPEG"), "FOLLOW_SCENE"
    if still:
        image.color_mode = "RGB"
    else:
        ffmpeg.format, ffmpeg.codec, ffmpeg.audio_codec = "MPEG4", "H264", "NONE"
        ffmpeg.constant_rate_factor, ffmpeg.ffmpeg_preset = "HIGH", "GOOD"
    render.use_compositing, render.use_sequencer = True, False
    render.filepath, render.use_file_extension = str(path), False

    def give_back() -> None:
        for each in ENDS if ended in ENDS[0] else ():
            each.remove(ended)
        found = next((each for each in bpy.data.scenes if each.session_uid == known), None)
        for owner, name, value in former if found is not None else ():
            setattr(found.path_resolve(owner), name, value)

    def ended(*_: object) -> None:  # called in the render thread, where no data may be changed
        if not bpy.app.timers.is_registered(give_back):
            bpy.app.timers.register(give_back)

    for each in () if bpy.app.background else ENDS:
        each.append(ended)
    return give_back


def _recolors(view: bpy.types.ColorManagedViewSettings) -> list[str]:
    """Names of the view settings that also change the clip's colors."""
    return [name for name, value in AS_FILMED.items() if getattr(view, name) != value]


def _value(view: bpy.types.ColorManagedViewSettings, name: str) -> str:
    """The value of a view setting as text to follow its name; "" for one that is on or off."""
    value = getattr(view, name)
    return "" if isinstance(value, bool) else f" {value}" if isinstance(value, str) else f" {value:.3g}"


def _instead(view: bpy.types.ColorManagedViewSettings, name: str) -> str:
    """The change of a view setting to its value in `AS_FILMED`, in words."""
    new = AS_FILMED[name]
    if isinstance(new, bool):
        return f"{SETTING[name]} off"
    return f"{SETTING[name]} from{_value(view, name)} to {new if isinstance(new, str) else f'{new:g}'}"


def _engine(name: str) -> str:
    """Display name of a render engine."""
    return {"CYCLES": "Cycles", "BLENDER_WORKBENCH": "Workbench"}.get(name, name.removeprefix("BLENDER_").removesuffix("_NEXT"))
