"""The Blender side. It imports bpy, NumPy and the engine's lowest layer; never torch, Taichi or OpenCV.

job        the worker process, its status in the panel, the takes on disk; `install`: the engine's Python
clip       the video; `inputs`: what Blender knows of it; `object`: the object that is followed in it
recover    the request to the engine, and its results as objects of the scene
field      the force field object, its arrows and legend; `solvers`: how Blender's own solvers feel it
edit       the bodies that are inserted into the field; `resimulate`: their simulation in it
bake       motion as keyframes
composite  the edit over the clip

Every feature has the same entry points: `properties` (its settings), `operators` (thin: gather, call one function, report) and `panel`; the
rest is its core. Modules that need NumPy are imported where they are used, so that switching on stays quick. Besides the features:

scene_properties         all settings of a scene
option_properties        properties made from the engine's options; property_kinds: other kinds of properties
direct_operator          the base of operators without a job
freshness                which steps are done, which are stale
commands, batch          `blender --command seeing_wind`
scene_mesh, scene_units  meshes of the scene as arrays; the scene's unit of length
user_paths               paths as the user writes them, relative in a saved file
at_exit                  clean-up when the process ends
"""

from __future__ import annotations

import bpy

from . import at_exit, batch, commands, freshness, scene_properties, user_paths
from .bake import operators as bake_operators
from .bake import panel as bake_panel
from .clip import draw_box as clip_draw_box
from .clip import marked as clip_marked
from .clip import operators as clip_operators
from .clip import panel as clip_panel
from .clip import properties as clip_properties
from .clip import views as clip_views
from .clip.object import correct as object_correct
from .clip.object import held as object_held
from .clip.object import material_menu
from .clip.object import operators as object_operators
from .clip.object import panel as object_panel
from .clip.object import preview as object_preview
from .clip.object import properties as object_properties
from .composite import operators as composite_operators
from .composite import panel as composite_panel
from .composite import properties as composite_properties
from .edit import inserting as edit_inserting
from .edit import operators as edit_operators
from .edit import panel as edit_panel
from .edit import properties as edit_properties
from .edit.resimulate import operators as resimulate_operators
from .edit.resimulate import panel as resimulate_panel
from .field import operators as field_operators
from .field import panel as field_panel
from .field import properties as field_properties
from .field.library import copies as library_copies
from .field.library import operators as library_operators
from .field.library import panel as library_panel
from .job import notes as job_notes
from .job import operator as job_operator
from .job import status, take_along
from .job.install import environment
from .job.install import operators as install_operators
from .job.install import preferences as install_preferences
from .recover import operators as recover_operators
from .recover import panel as recover_panel

FEATURES = (
    install_preferences, install_operators,
    clip_properties, clip_operators, clip_draw_box, clip_views, clip_panel,
    object_properties, object_operators, object_correct, object_held, object_preview, material_menu, object_panel,
    recover_operators, recover_panel,
    field_properties, field_operators, field_panel,
    library_operators, library_panel,
    edit_properties, edit_inserting, edit_operators, edit_panel,
    resimulate_operators, resimulate_panel,
    bake_operators, bake_panel,
    composite_properties, composite_operators, composite_panel,
)  # fmt: skip
"""Modules whose classes are registered, in the order of the work; the scene's settings come last, as they are composed of theirs."""

CLASSES = tuple(cls for door in (job_operator, job_notes, *FEATURES, scene_properties) for cls in door.CLASSES)

HANDLERS = (scene_properties, freshness, clip_marked, job_operator, take_along, user_paths, library_copies, commands)
"""Modules that register more than classes."""


def register() -> None:
    """Called by Blender when the extension is switched on."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    for each in HANDLERS:
        each.register()
    bpy.app.timers.register(look_round, first_interval=0.0)


def unregister() -> None:
    """Called by Blender when the extension is switched off: running workers end with it."""
    if bpy.app.timers.is_registered(look_round):
        bpy.app.timers.unregister(look_round)
    for each in reversed(HANDLERS):
        each.unregister()
    status.forget_all()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)


def look_round() -> None:
    """First refresh of engine and scenes, by a timer: Blender gives no access to data while it switches an extension on."""
    environment.refresh()
    freshness.refresh_all()


def _at_exit() -> None:
    """End the workers with Blender."""
    job_operator.kill_all()
    if bpy.app.module and hasattr(bpy.types.Scene, "seeing_wind"):
        unregister()


batch.switch_on = register
at_exit.actions.append(_at_exit)
at_exit.let_go = bpy.app.module
