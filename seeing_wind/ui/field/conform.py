"""How fast a field's pictures go by: one in every frame of the scene, or at the clip's own speed whatever the scene's frame rate.

A field, its values and its arrows count frames by their modifiers' inputs, so they are retimed without the take. Pictures that fall between
two frames are right, too: a solver's step to a frame gets the force of the picture in the middle of that step.
"""

from __future__ import annotations

import math

import bpy

from ...engine.errors import UsageError
from ..bake.bodies import bake_bodies
from ..bake.plan import mark_of
from ..bake.shapes import retime
from ..edit.resimulate.preview import shown_as_preview
from ..job import takes
from .display import STRIDE, frames_per_second, is_field
from .node_groups import FRAMES_PER_PICTURE, modifier_input, set_input
from .samples import samples_of


def conform(scene: bpy.types.Scene, field: bpy.types.Object, real_time: bool) -> float:
    """Let a field, and what the scene's own field belongs to, go by in real time or picture by picture.

    Baked bodies are baked again, in the same way.

    Returns:
        Scene frames that a picture lasts.

    Raises:
        TakeError: when a re-simulation that was baked is gone.
        UsageError: when the field is linked, or was made by an earlier version.
    """
    settings, stride = scene.seeing_wind, 1.0
    if real_time:
        stride = frames_per_second(scene) / field["seeing_wind_fps"]
    set_stride(field, stride)
    if field == settings.field_object:
        settings.real_time = real_time
        if real_time:
            settings.follows -= {"FPS"}  # or the next Reload would take the scene's rate from the clip again
        conform_own(scene, stride)
        baked = [body for body in settings.bodies if _carries_bake(body)]
        preview = len(shown_as_preview(scene)) == len(baked)
        if baked and (settings.coarse_take if preview else settings.simulated_take) and takes.simulated(settings, preview).is_dir():
            bake_bodies(scene, preview=preview)
    return stride


def set_stride(field: bpy.types.Object, stride: float) -> None:
    """Scene frames per picture of a field object, its values and its arrows.

    Raises:
        UsageError: when the field cannot be retimed.
    """
    if field.library is not None:
        raise UsageError(f"{field.name} is linked from another file.", "Conform it there, or append it here.")
    if STRIDE not in field:
        raise UsageError(f"{field.name} was made by an earlier version.", "Press Reload in the Recover panel first.")
    field[STRIDE] = stride
    field.update_tag()
    for obj in (samples_of(field), *field.children):
        for modifier in obj.modifiers if obj is not None and obj.library is None else ():
            if modifier.type == "NODES" and modifier_input(modifier, FRAMES_PER_PICTURE) is not None:
                set_input(modifier, FRAMES_PER_PICTURE, stride)


def conform_own(scene: bpy.types.Scene, stride: float) -> None:
    """The recovered object of a scene in step with its field, and the range as long, where the range is the clip's."""
    settings = scene.seeing_wind
    start, field = settings.frame_start, settings.field_object
    obj = settings.recovered_object
    if obj is not None and obj.data.shape_keys is not None:
        retime(obj.data.shape_keys, start, start + stride * field["seeing_wind_frames"])
    if "RANGE" in settings.follows and is_field(field):
        scene.frame_end = start + math.ceil(stride * field["seeing_wind_frames"] - 1e-6)


def _carries_bake(body: bpy.types.PropertyGroup) -> bool:
    carrier = body.baked_copy or body.object
    return carrier is not None and mark_of(carrier) is not None
