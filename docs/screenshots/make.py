"""Drives the panel in a Blender with a window and photographs the screen at every step; make.sh calls it.

SEEING_WIND_SHOT is a state that a stand-in for the engine shows at once (`running`, `cancelled`, `resumed`, `failed`), or a folder that
`make scenes` wrote: then the whole job is done on it, step by step. What Recover and Re-simulate have found in that folder is used again.
Frames of the window go to SEEING_WIND_PICTURES as NAME_STEP.png, the rendered composite beside them.
"""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
import traceback
from pathlib import Path

import bpy
from mathutils import Euler, Vector

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "sample_scenes" / "common")]

from seeing_wind import ui  # noqa: E402
from seeing_wind.ui.job import status  # noqa: E402

SHOT, PICTURES = os.environ["SEEING_WIND_SHOT"], Path(os.environ["SEEING_WIND_PICTURES"])
PHOTOGRAPH = ("import", "-window", "root")
"""ImageMagick's: Blender's own screenshots are black on a virtual screen."""
BEHAVIOUR = {"running": "hang", "cancelled": "hang", "resumed": "hang", "failed": "error"}
SETTLED, RENDERED = 2.0, 30.0
"""Seconds until a window that a processor draws shows what was done, and what is rendered."""
TOP = 0
"""Notches of the mouse wheel to the uppermost panel: steps that are done fold, so that the next ones are in sight."""
PAGES = 8
"""As many screens as all panels fill together, at most."""
END = 40 * PAGES
"""Notches to the end of the last panel."""
steps = iter(())


def window() -> dict:
    """The 3D view of the first window, as an override of the context."""
    first = bpy.context.window_manager.windows[0]
    area = max((area for area in first.screen.areas if area.type == "VIEW_3D"), key=lambda area: area.width)
    return {"window": first, "screen": first.screen, "area": area, "region": next(r for r in area.regions if r.type == "WINDOW")}


def sidebar() -> bpy.types.Region:
    """Where the panels are."""
    return next(region for region in window()["area"].regions if region.type == "UI")


def show_tab() -> float:
    """Open the sidebar; the tab can be chosen once it has drawn."""
    window()["area"].spaces.active.show_region_ui = True
    try:
        sidebar().active_panel_category = "Seeing Wind"
    except (AttributeError, TypeError):  # it has not drawn yet
        return 0.2
    return 0.0


def press(name: str, **options) -> None:
    """Press a button."""
    operator = getattr(bpy.ops.seeing_wind, name)
    with bpy.context.temp_override(**window()):
        operator("INVOKE_DEFAULT" if not options else "EXEC_DEFAULT", **options)


def scroll(notches: int) -> None:
    """Turn the mouse wheel over the panels, from their top."""
    with bpy.context.temp_override(**{**window(), "region": sidebar()}):
        for _ in range(PAGES):
            bpy.ops.view2d.scroll_up(page=True)
        for _ in range(notches):
            bpy.ops.view2d.scroll_down()


def photograph(step: str, notches: int | None = None):
    """When the window shows what was done, and the panels have their new height, by which Blender lets them be scrolled."""
    name = Path(SHOT).name if Path(SHOT).is_dir() else ""
    for again in range(1 if notches is None else 2):
        if again:
            scroll(notches)
        for area in window()["screen"].areas:
            area.tag_redraw()
        yield SETTLED
    path = PICTURES / f"{name}_{step}.png".removeprefix("_")
    subprocess.run([*PHOTOGRAPH, f"png:{path}"], check=True)
    print(f"screenshot {path.name}", flush=True)


def done(step: str):
    """Wait for the job of a step; what it says, if it failed, ends the tour."""
    yield 0.5
    now = status.of(bpy.context.scene.session_uid)
    while now.running:
        yield 0.5
    if step in now.steps and now.steps[step].state == status.State.FAILED:
        raise RuntimeError(f"{step}: {now.steps[step].message} {now.steps[step].hint}")


def ready():
    """The view over the whole window, the tab open."""
    with bpy.context.temp_override(**window()):
        bpy.ops.screen.screen_full_area()
    yield 0.5
    while show_tab():
        yield 0.3
    yield 0.5


def stand_in():
    """A state of a job that the stand-in for the engine plays."""
    yield from ready()
    settings, folder = bpy.context.scene.seeing_wind, Path(os.environ["SEEING_WIND_CLIP"]).parent
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "leaf.blend"))
    settings.clip, settings.box = "//leaf.mp4", (20, 20, 44, 44)
    os.environ |= {"SEEING_WIND_FAKE": BEHAVIOUR[SHOT], "SEEING_WIND_FAKE_SECONDS": "40"}
    for again in range(1 + (SHOT == "resumed")):
        if again:
            press("cancel")
            yield from done("")
        press("recover")
        now = status.of(bpy.context.scene.session_uid)
        while now.running and now.steps["recover"].fraction < (0.5 if again else 0.2):
            yield 0.2
    if SHOT == "cancelled":
        press("cancel")
        yield from done("")
    yield from photograph(SHOT)


def tour(folder: Path):
    """The whole job on a sample scene."""
    known = json.loads((folder / "box.json").read_text())
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "tour.blend"))
    yield from ready()
    yield from photograph("0_new")
    scene = bpy.context.scene
    settings = scene.seeing_wind
    press("choose_clip", filepath=str(folder / "clip.mp4"))
    yield 1.0
    settings.camera_mode, settings.camera = "JSON", "//camera.json"
    yield from photograph("1_clip")
    settings.object_mode, settings.mask = "MASK", "//mask_0000.png"
    settings.scale_mode, settings.distance, settings.material = "DISTANCE", known["distance"], known["material"]
    for name in ("density", "youngs_modulus", "thickness"):
        setattr(settings, f"use_{name}", True)
        setattr(settings, name, known[name])
    if (folder / "held_0000.png").is_file():
        settings.pin = "//held_0000.png"
    settings.take = "//wind.take"
    press("preview")
    yield from done("object")
    yield from photograph("2_object")
    press("recover")
    yield from done("recover")
    look(scene, 0.2)
    yield from photograph("3_recovered", TOP)
    runpy.run_path(str(ROOT / "sample_scenes" / "common" / "whole_job.py"), run_name="tour")["insert_beside"](scene, known)
    look(scene, 0.2)
    yield from photograph("4_edit", TOP)
    yield from photograph("4_field", END)
    press("resimulate")
    yield from done("resimulate")
    press("bake")
    yield from done("bake")
    scene.frame_set((scene.frame_start + scene.frame_end) // 2)
    yield from photograph("5_baked", TOP)
    press("set_up_composite", samples=16, shutter=0.0)
    space = window()["area"].spaces.active
    space.region_3d.view_perspective = "CAMERA"
    space.shading.type, space.shading.use_compositor, space.overlay.show_overlays = "RENDERED", "CAMERA", False
    for obj in scene.objects:  # what is not rendered stands in the viewport all the same
        obj.hide_viewport = obj.hide_viewport or obj.hide_render
    yield RENDERED
    yield from photograph("6_composite", END)
    space.shading.type = "SOLID"
    press("render_composite", filepath=str(PICTURES / f"{folder.name}_7_rendered.png"), still=True)
    while bpy.app.is_job_running("RENDER"):
        yield 1.0


def look(scene: bpy.types.Scene, aside: float) -> None:
    """At the object and what was put beside it, a little from the side."""
    space, field = window()["area"].spaces.active, scene.seeing_wind.field_object
    corners = [field.matrix_world @ Vector(corner) for corner in field.bound_box]
    middle, size = sum(corners, Vector()) / 8, max((a - b).length for a in corners for b in corners)
    view = space.region_3d
    view.view_perspective, view.view_distance, view.view_location = "PERSP", 1.5 * size, middle
    view.view_rotation = Euler((1.45, 0.0, aside)).to_quaternion()


def turn() -> float | None:
    """One action; Blender calls again after the pause returned."""
    try:
        return next(steps)
    except StopIteration:
        pass
    except Exception:
        traceback.print_exc()
    bpy.ops.wm.quit_blender()
    return None


def main() -> None:
    """Register, then act from a timer, when the window stands."""
    global steps
    bpy.context.preferences.view.show_splash = False
    bpy.context.preferences.view.ui_scale = 0.85
    if Path(SHOT).is_dir():  # the later panels are open, too
        for cls in ui.CLASSES:
            if issubclass(cls, bpy.types.Panel):
                cls.bl_options = cls.bl_options - {"DEFAULT_CLOSED"}
    ui.register()
    bpy.context.window_manager.windows[0].screen.show_statusbar = False
    steps = tour(Path(SHOT)) if Path(SHOT).is_dir() else stand_in()
    bpy.app.timers.register(turn, first_interval=1.0, persistent=True)


main()
