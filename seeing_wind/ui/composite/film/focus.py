"""Keep the camera focused on the object as it moves."""

from __future__ import annotations

import bpy
import numpy as np

from ....engine.errors import UsageError
from ...bake.animation import curves_of, make_linear, remove_curves, retime
from ...clip.inputs.pace import Pace
from ...scene_units import metres_per_unit
from ..own import FOCUS, own_object


def set_focus(scene: bpy.types.Scene, depths: np.ndarray | None, fstop: float, pace: Pace) -> None:
    """Focus the scene's camera on an empty that follows the object. With `fstop` 0, the user's own focus is left alone.

    Args:
        depths: (T+1,) depth of the object along the camera's axis in each clip frame [m]; None if unknown.
        fstop: of a lens on a 36 mm wide sensor; 0 removes the empty, and switches off the depth of field that used it.
        pace: of the clip in the scene.

    Raises:
        UsageError: when there is nothing to focus on.
    """
    focus, lens = own_object(scene, FOCUS), scene.camera.data.dof
    if not fstop:
        if focus is not None:
            lens.use_dof = lens.use_dof and lens.focus_object != focus
            bpy.data.objects.remove(focus)
        return
    check_depths(depths)
    if focus is None:
        focus = bpy.data.objects.new(FOCUS, None)
        scene.collection.objects.link(focus)
        focus.empty_display_size, focus.hide_select = 0.05, True
    focus.parent = scene.camera
    remove_curves(focus, ["location"])
    unit = metres_per_unit(scene)
    for t, depth in enumerate(depths.tolist()):
        focus.location = (0.0, 0.0, -depth / unit)
        focus.keyframe_insert("location", frame=pace.at + pace.stride * t)
    make_linear(focus, ["location"])
    # Blender takes a 50 mm lens to be 0.05 scene units, whatever the unit
    lens.use_dof, lens.focus_object, lens.aperture_fstop = True, focus, fstop * unit


def check_depths(depths: np.ndarray | None) -> None:
    """Raise UsageError if the object's depths (T+1,) are None, so that there is nothing to focus on."""
    if depths is None:
        raise UsageError("There is no object to focus on.", "Run Recover on a clip, or set Aperture to 0.")


def keep_focus(scene: bpy.types.Scene, pace: Pace) -> None:
    """Retime the animated focus of a scene, if it has one, to another pace."""
    focus = own_object(scene, FOCUS)
    if focus is not None:
        frames = int(scene.seeing_wind.field_object["seeing_wind_frames"]) + 1
        retime(curves_of(focus), pace.at, pace.at + pace.stride * (frames - 1))
