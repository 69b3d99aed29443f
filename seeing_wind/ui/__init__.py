"""The Blender side. Imports bpy, NumPy and the engine's ground floor; never torch, Taichi or OpenCV."""

from __future__ import annotations

import bpy

from . import later

later.declare(
    __name__,
    (
        "animation", "bake", "batch", "bodies", "clip_scene", "composite", "console", "edit_export", "edits", "engine_environment",
        "engine_install", "field_calibration", "field_vdb", "job", "native", "picture_frame", "results", "scene_export", "worker_calls",
    ),
)  # fmt: skip

from . import leaving, operators, panels, properties
from .field import panel as panel_field
from .install import environment as engine_environment
from .install import preferences
from .job import commands, status, takes
from .job import operator as job_operator
from .recover import freshness

CLASSES = (*preferences.CLASSES, *properties.CLASSES, *operators.CLASSES, *job_operator.CLASSES, *panels.CLASSES, *panel_field.CLASSES)


def register() -> None:
    """Called by Blender when the extension is switched on."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.seeing_wind = bpy.props.PointerProperty(type=properties.SEEING_WIND_PG_scene)
    freshness.register()
    job_operator.register()
    takes.register()
    commands.register()
    bpy.app.timers.register(_look_round, first_interval=0.0)


def unregister() -> None:
    """Called by Blender when the extension is switched off: running workers end with it."""
    if bpy.app.timers.is_registered(_look_round):
        bpy.app.timers.unregister(_look_round)
    commands.unregister()
    takes.unregister()
    job_operator.unregister()
    freshness.unregister()
    status.forget_all()
    del bpy.types.Scene.seeing_wind
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)


def _look_round() -> None:
    """While it is being switched on, Blender lends no data: the first look at the scenes comes right after."""
    engine_environment.refresh()
    freshness.refresh_all()


def _at_exit() -> None:
    """End the workers with Blender."""
    job_operator.kill_all()
    if bpy.app.module and hasattr(bpy.types.Scene, "seeing_wind"):
        unregister()


leaving.actions.append(_at_exit)
leaving.let_go = bpy.app.module
