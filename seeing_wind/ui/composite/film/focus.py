"""How the clip's lens is focused: on the object, wherever that goes."""

from __future__ import annotations

import bpy
import numpy as np

from ....engine.errors import UsageError
from ...bake.animation import curves_of, make_linear, remove_curves, retime
from ...clip.inputs.pace import Pace
from ...scene_units import metres_per_unit
from ..own import FOCUS, own_object


def set_focus(scene: bpy.types.Scene, depths: np.ndarray | None, fstop: float, pace: Pace) -> None:
    """Let the scene's camera focus on an empty that goes with the object; a focus of the user's own stays without an f-stop.

    Args:
        depths: of the object along the camera's axis (T+1,), one per clip frame [m]; None where it is not known.
        fstop: of a lens on a sensor 36 mm wide; 0 takes the empty, and the depth of field with it, away.
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
    # Blender takes a lens of 50 mm for 0.05 units, whatever these are
    lens.use_dof, lens.focus_object, lens.aperture_fstop = True, focus, fstop * unit


def check_depths(depths: np.ndarray | None) -> None:
    """UsageError where the depths of the object (T+1,) are not known: there is nothing to focus on."""
    if depths is None:
        raise UsageError("There is no object to focus on.", "Run Recover on a clip, or set Aperture to 0.")


def keep_focus(scene: bpy.types.Scene, pace: Pace) -> None:
    """Let the focus of a scene, if it has one, go by at another pace."""
    focus = own_object(scene, FOCUS)
    if focus is not None:
        frames = int(scene.seeing_wind.field_object["seeing_wind_frames"]) + 1
        retime(curves_of(focus), pace.at, pace.at + pace.stride * (frames - 1))
