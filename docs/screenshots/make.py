"""Brings the panel into one state (SEEING_WIND_SHOT) in a Blender with a window; make.sh takes the picture.

`idle`, `running`, `cancelled`, `resumed` and `failed` use a stand-in for the engine; `done` and `field` open the file of a
whole job (SEEING_WIND_JOB).
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import bpy
from mathutils import Euler, Vector

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seeing_wind import ui  # noqa: E402
from seeing_wind.ui import freshness
from seeing_wind.ui.job import status  # noqa: E402

SHOT = os.environ["SEEING_WIND_SHOT"]
FOLDER = Path(os.environ["SEEING_WIND_CLIP"]).parent
BEHAVIOUR = {"running": "hang", "cancelled": "hang", "resumed": "hang", "failed": "error"}.get(SHOT, "done")
steps = iter(())


def window() -> dict:
    """The 3D view of the first window, as an override of the context."""
    first = bpy.context.window_manager.windows[0]
    area = max((area for area in first.screen.areas if area.type == "VIEW_3D"), key=lambda area: area.width)
    return {"window": first, "screen": first.screen, "area": area, "region": next(r for r in area.regions if r.type == "WINDOW")}


def show_tab() -> float:
    """Open the sidebar; the tab can be chosen once it has drawn."""
    area = window()["area"]
    area.spaces.active.show_region_ui = True
    sidebar = next(region for region in area.regions if region.type == "UI")
    try:
        sidebar.active_panel_category = "Seeing Wind"
    except (AttributeError, TypeError):  # it has not drawn yet
        return 0.2
    return 0.0


def script():
    """What the user does, one action per turn; a yielded number is a pause in seconds."""
    if SHOT in ("done", "field"):
        bpy.ops.wm.open_mainfile(filepath=os.environ["SEEING_WIND_JOB"], load_ui=False)
        yield 1.0
    with bpy.context.temp_override(**window()):
        bpy.ops.screen.screen_full_area()
    yield 0.5
    while show_tab():
        yield 0.3
    yield 0.5
    if SHOT in ("done", "field"):
        yield from show_results()
        return
    if SHOT == "idle":
        return
    settings = bpy.context.scene.seeing_wind
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "leaf.blend"))
    settings.clip = "//leaf.mp4"
    settings.box = (20, 20, 44, 44)
    os.environ["SEEING_WIND_FAKE"] = BEHAVIOUR
    os.environ["SEEING_WIND_FAKE_SECONDS"] = "40"
    start()
    yield from some_progress()
    if SHOT in ("cancelled", "resumed"):
        with bpy.context.temp_override(**window()):
            bpy.ops.seeing_wind.cancel()
        while status.of(bpy.context.scene.session_uid).running:
            yield 0.2
    if SHOT == "resumed":
        start()
        yield from some_progress()


def some_progress():
    """Until the job is well under way, or has failed."""
    now = status.of(bpy.context.scene.session_uid)
    while now.running and now.steps["recover"].fraction < 0.2:
        yield 0.2


def start() -> None:
    """Press Recover."""
    with bpy.context.temp_override(**window()):
        bpy.ops.seeing_wind.recover("INVOKE_DEFAULT")


def show_results():
    """The recovered leaf, its arrows and the ribbon, a little from the side."""
    scene = bpy.context.scene
    settings, space = scene.seeing_wind, window()["area"].spaces.active
    # paths that mean the same wherever the pictures are taken
    settings.clip, settings.take, settings.mask, settings.camera = "//clip.mp4", "//wind.take", "//mask_0000.png", "//camera.json"
    freshness.refresh(scene)
    scene.frame_set(5)  # later the leaf drifts before the ribbon
    leaf, ribbon = settings.recovered_object.evaluated_get(bpy.context.evaluated_depsgraph_get()), bpy.data.objects["Ribbon"]
    middle = sum((leaf.matrix_world @ vertex.co for vertex in leaf.data.vertices), Vector()) / len(leaf.data.vertices)
    for obj in scene.objects:
        obj.select_set(False)
    view = space.region_3d
    view.view_perspective, view.view_distance = "PERSP", 1.3
    view.view_location = 0.7 * middle + 0.3 * ribbon.matrix_world.translation + Vector((0.05, 0.0, -0.18))
    view.view_rotation = Euler((1.45, 0.0, 0.2)).to_quaternion()
    space.overlay.show_extras, space.overlay.show_relationship_lines = False, False
    space.shading.color_type = "VERTEX" if SHOT == "field" else "TEXTURE"
    yield 1.0
    settings.field_object.hide_set(True)
    yield 0.5


def turn() -> float | None:
    """One action; Blender calls again after the pause returned."""
    pause = next(steps, None)
    return pause


def main() -> None:
    """Register, then act from a timer, when the window stands."""
    global steps
    bpy.context.preferences.view.show_splash = False
    bpy.context.preferences.view.ui_scale = 0.85
    if SHOT == "field":  # the panels of the six steps closed, the later ones open
        for cls in ui.CLASSES:
            if issubclass(cls, bpy.types.Panel):
                cls.bl_options = {"DEFAULT_CLOSED"} if cls.step else set()
    ui.register()
    bpy.context.window_manager.windows[0].screen.show_statusbar = False
    steps = script()
    bpy.app.timers.register(turn, first_interval=1.0, persistent=True)


main()
