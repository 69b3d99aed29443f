"""Brings the panel into one state (SEEING_WIND_SHOT) in a Blender with a window; make.sh takes the picture."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seeing_wind import ui  # noqa: E402
from seeing_wind.ui import panel_field, panels, status  # noqa: E402

SHOT = os.environ["SEEING_WIND_SHOT"]
FOLDER = Path(os.environ["SEEING_WIND_CLIP"]).parent
BEHAVIOUR = {"running": "hang", "failed": "error"}.get(SHOT, "done")
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
    with bpy.context.temp_override(**window()):
        bpy.ops.screen.screen_full_area()
    yield 0.5
    while show_tab():
        yield 0.3
    yield 0.5
    if SHOT == "idle":
        return
    settings = bpy.context.scene.seeing_wind
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "leaf.blend"))
    settings.clip = "//leaf.mp4"
    settings.box = (20, 20, 44, 44)
    os.environ["SEEING_WIND_FAKE"] = BEHAVIOUR
    os.environ["SEEING_WIND_FAKE_SECONDS"] = "14" if SHOT == "running" else "0.2"
    if SHOT in ("done", "field"):
        for name in ("Cube", "Light", "Camera"):
            bpy.data.objects.remove(bpy.data.objects[name])
    with bpy.context.temp_override(**window()):
        bpy.ops.seeing_wind.recover("INVOKE_DEFAULT")
    yield 1.5
    if SHOT not in ("done", "field"):
        return
    while status.of(bpy.context.scene.session_uid).running:
        yield 0.2
    if SHOT == "field":
        yield from show_field()
        return
    with bpy.context.temp_override(**window()):
        bpy.ops.mesh.primitive_plane_add(size=0.3, location=(0.25, 0.0, 0.1), rotation=(1.2, 0.0, 0.3))
        bpy.context.object.name = "Flag"
        bpy.context.object.vertex_groups.new(name="Pole").add([0, 2], 1.0, "REPLACE")
        bpy.ops.seeing_wind.insert_mesh(mass_scale=2.0)
        bpy.ops.seeing_wind.pin_vertices()
        bpy.ops.seeing_wind.resimulate("INVOKE_DEFAULT")
    yield 1.0
    while status.of(bpy.context.scene.session_uid).running:
        yield 0.2
    with bpy.context.temp_override(**window()):
        bpy.ops.seeing_wind.bake()
        bpy.context.scene.frame_set(6)
        bpy.ops.object.select_all(action="DESELECT")
        bpy.context.scene.seeing_wind.recovered_object.select_set(True)
        bpy.ops.view3d.view_selected()
        space = window()["area"].spaces.active
        space.region_3d.view_distance *= 2.2
        space.overlay.show_extras = False
        bpy.context.scene.seeing_wind.field_object.hide_set(True)


def show_field():
    """The panel Field beside coloured arrows in Solid view, with a cloth that is to be calibrated."""
    with bpy.context.temp_override(**window()):
        bpy.ops.mesh.primitive_grid_add(x_subdivisions=20, y_subdivisions=20, size=0.3, location=(0.25, 0.0, -0.3))
        bpy.context.object.modifiers.new("Cloth", "CLOTH")
        bpy.ops.seeing_wind.calibrate()
        space = window()["area"].spaces.active
        space.shading.color_type = "VERTEX"
        bpy.context.scene.frame_set(6)
        bpy.ops.object.select_all(action="DESELECT")
        bpy.context.scene.seeing_wind.arrows_object.select_set(True)
        bpy.ops.view3d.view_selected()
        bpy.ops.object.select_all(action="DESELECT")
        space.overlay.show_extras = False
        bpy.context.scene.seeing_wind.field_object.hide_set(True)
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
        for cls in panels.PANELS:
            cls.bl_options = {"DEFAULT_CLOSED"}
        for cls in panel_field.CLASSES:
            cls.bl_options = set()
    ui.register()
    bpy.context.window_manager.windows[0].screen.show_statusbar = False
    steps = script()
    bpy.app.timers.register(turn, first_interval=1.0)


main()
