"""Drives the extension in a Blender with a window, by mouse and keyboard: `blender --enable-event-simulate --python drive.py`.

run.sh prepares SEEING_WIND_PYTHON (a stand-in for the engine) and SEEING_WIND_CLIP. Marks the object as marking.py does, then recovers with
the modal operator: progress, cancel, again, done, undo and redo; also while a box is drawn, and when the extension is switched off. With
SEEING_WIND_REAL (a Python with the engine) and SEEING_WIND_SCENE (a folder that a sample scene's make.py wrote) it cancels and resumes a
real recovery too. At the end it prints what the panels' `draw` has cost. Ends Blender with exit code 0, or 9 at the first thing that is not
as it should be.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[3]), str(Path(__file__).resolve().parent)]

from marking import check, correct, draw_box, escape, largest_area, mouse, override  # noqa: E402

import seeing_wind.ui as ui  # noqa: E402
from seeing_wind.engine.progress import in_words  # noqa: E402
from seeing_wind.ui.job import operator as job_operator  # noqa: E402
from seeing_wind.ui.job import status  # noqa: E402

PATIENCE = 60.0
"""Seconds for any one thing to happen: a software screen on a busy machine is slow."""

drawn: dict[str, list[float]] = {}
"""Processor time of each panel's draws [s]."""


def watched(cls: type):
    """The panel's `draw`, with a note of its processor time."""
    draw = cls.draw

    def timed(self, context):
        began = time.process_time()
        draw(self, context)
        drawn.setdefault(cls.bl_idname, []).append(time.process_time() - began)

    return timed


for panel in ui.CLASSES:
    if issubclass(panel, bpy.types.Panel):
        panel.draw = watched(panel)
ui.register()
window = bpy.context.window_manager.windows[0]


def draw_box_while(area: bpy.types.Area) -> Iterator[float]:
    """A job ends, and makes the camera's background anew, while a box waits to be drawn; undo waits, a click elsewhere ends it."""
    now, settings = status.of(bpy.context.scene.session_uid), bpy.context.scene.seeing_wind
    settings.take = str(Path(os.environ["SEEING_WIND_CLIP"]).parent / "meanwhile.take")
    os.environ["SEEING_WIND_FAKE"], os.environ["SEEING_WIND_FAKE_SECONDS"] = "done", "2"
    before = tuple(settings.box)
    with bpy.context.temp_override(**override(area)):
        bpy.ops.seeing_wind.recover("INVOKE_DEFAULT")
        bpy.ops.seeing_wind.draw_box("INVOKE_DEFAULT")
    yield 0.5
    middle = np.array([area.x + area.width // 3, area.y + area.height // 2])
    mouse("MOUSEMOVE", "NOTHING", middle)
    window.event_simulate("Z", "PRESS", x=int(middle[0]), y=int(middle[1]), ctrl=True)
    window.event_simulate("Z", "RELEASE", x=int(middle[0]), y=int(middle[1]))
    yield from until(lambda: not now.running)
    check(now.steps["recover"].state == "done", f"a job ends while a box is drawn: {now.steps['recover'].message}")
    check("SEEING_WIND_OT_draw_box" in [each.bl_idname for each in window.modal_operators], "and Ctrl Z leaves the drawing alone")
    other = next(each for each in window.screen.areas if each.type == "OUTLINER")
    at = np.array([other.x + other.width // 2, other.y + 5])
    mouse("MOUSEMOVE", "NOTHING", at)
    mouse("LEFTMOUSE", "PRESS", at)
    yield 0.5
    mouse("LEFTMOUSE", "RELEASE", at)
    yield 0.5
    check(not window.modal_operators and tuple(settings.box) == before, "a click elsewhere ends the drawing")
    camera = bpy.context.scene.camera.data
    check(camera.background_images[0].display_depth == "BACK", "the clip is behind the scene again")


def switch_off_and_on(area: bpy.types.Area) -> Iterator[float]:
    """The extension is switched off while a job runs: the worker ends, and after switching on everything works."""
    os.environ["SEEING_WIND_FAKE"], os.environ["SEEING_WIND_FAKE_SECONDS"] = "done", "60"
    with bpy.context.temp_override(**override(area)):
        bpy.ops.seeing_wind.recover("INVOKE_DEFAULT")
    running = job_operator.jobs[bpy.context.scene.session_uid]
    yield from until(lambda: running.started)
    process = running.messages.gi_yieldfrom.gi_frame.f_locals["process"]
    ui.unregister()
    yield 1.0
    check(process.poll() is not None and not window.modal_operators, "switched off during a job: the worker has ended")
    for _ in range(10):
        ui.register()
        ui.unregister()
    ui.register()
    yield 1.0
    now = status.of(bpy.context.scene.session_uid)
    os.environ["SEEING_WIND_FAKE_SECONDS"] = "0.2"
    with bpy.context.temp_override(**override(area)):
        check(bpy.ops.seeing_wind.recover("INVOKE_DEFAULT") == {"RUNNING_MODAL"}, "switched on again, Recover starts")
    yield from until(lambda: not now.running)
    check(now.steps["recover"].state == "done", "and ends")


def recover(area: bpy.types.Area) -> Iterator[float]:
    """The modal operator: progress while the window lives, cancel, again, done."""
    now = status.of(bpy.context.scene.session_uid)
    settings = bpy.context.scene.seeing_wind
    settings.take = str(Path(os.environ["SEEING_WIND_CLIP"]).parent / "window.take")
    os.environ["SEEING_WIND_FAKE"], os.environ["SEEING_WIND_FAKE_SECONDS"] = "done", "20"
    with bpy.context.temp_override(**override(area)):
        check(bpy.ops.seeing_wind.recover("INVOKE_DEFAULT") == {"RUNNING_MODAL"}, "Recover returns at once")
    yield from until(lambda: now.steps["recover"].fraction > 0.0)
    check(now.running == "recover" and now.steps["recover"].state == "running", f"progress: {now.steps['recover'].message}")
    with bpy.context.temp_override(**override(area)):
        bpy.ops.seeing_wind.cancel()
    yield from until(lambda: not now.running)
    check(now.steps["recover"].state == "idle" and settings.field_object is None, "cancelled, nothing half made")
    check("goes on from what was finished" in now.steps["recover"].message, "and the panel says how to go on")
    os.environ["SEEING_WIND_FAKE_SECONDS"] = "0.2"
    with bpy.context.temp_override(**override(area)):
        bpy.ops.seeing_wind.recover("INVOKE_DEFAULT")
    yield from until(lambda: not now.running)
    check(now.steps["recover"].state == "done" and settings.field_object is not None, "recovered")
    yield 1.0
    bpy.ops.ed.undo()
    check(bpy.context.scene.seeing_wind.field_object is None, "Ctrl Z takes the results away")
    bpy.ops.ed.redo()
    check(bpy.context.scene.seeing_wind.field_object is not None, "and redo brings them back")


def resume_a_real_one(area: bpy.types.Area) -> Iterator[float]:
    """The engine itself: cancelled after its first stages, which the second run does not do again."""
    folder = Path(os.environ["SEEING_WIND_SCENE"])
    known, take = json.loads((folder / "box.json").read_text()), Path(os.environ["SEEING_WIND_CLIP"]).parent / "real.take"
    os.environ["SEEING_WIND_PYTHON"] = os.environ["SEEING_WIND_REAL"]
    options = {name: known[name] for name in ("distance", "material", "density", "youngs_modulus", "thickness")}
    options |= {"clip": str(folder / "clip.mp4"), "mask": str(folder / "mask_0000.png"), "camera": str(folder / "camera.json")}
    options |= {"take": str(take), "iterations": 1, "particles": 100}
    if (folder / "held_0000.png").is_file():
        options["pin"] = str(folder / "held_0000.png")
    now = status.of(bpy.context.scene.session_uid)
    with bpy.context.temp_override(**override(area)):
        check(bpy.ops.seeing_wind.recover("INVOKE_DEFAULT", **options) == {"RUNNING_MODAL"}, "a real recovery starts")
    ticks = 0

    def built() -> bool:
        nonlocal ticks
        ticks += 1
        return (take / "particles.npz").is_file() or not now.running

    yield from until(built, 400.0)
    check(now.running == "recover" and ticks > 5, f"the window lives while the engine works: {now.steps['recover'].message}")
    left = status.remaining(now.steps["recover"])
    check(left is not None and left > 0.0, f"the panel knows that about {in_words(left or 0.0)} are left")
    with bpy.context.temp_override(**override(area)):
        bpy.ops.seeing_wind.cancel()
    yield from until(lambda: not now.running)
    seen = (take / "observation.npz").stat().st_mtime_ns
    with bpy.context.temp_override(**override(area)):
        bpy.ops.seeing_wind.recover("INVOKE_DEFAULT")
    yield from until(lambda: not now.running, 400.0)
    check(now.steps["recover"].state == "done", f"resumed and finished: {now.steps['recover'].message}")
    check((take / "observation.npz").stat().st_mtime_ns == seen, "what was finished was not done again")


def until(condition, patience: float = PATIENCE) -> Iterator[float]:
    """Wait, with the window alive."""
    for _ in range(int(patience / 0.2)):
        if condition():
            return
        yield 0.2
    raise AssertionError(f"nothing happened for {patience:g} s")


def story() -> Iterator[float]:
    """One thing after the other; yields the seconds to wait."""
    yield 2.0
    ui.look_round()
    bpy.context.preferences.view.show_splash = False
    check(bpy.ops.seeing_wind.choose_clip(filepath=os.environ["SEEING_WIND_CLIP"]) == {"FINISHED"}, "a clip is chosen")
    area = largest_area()
    area.spaces.active.show_region_ui = True
    yield 1.0
    next(region for region in area.regions if region.type == "UI").active_panel_category = "Seeing Wind"
    yield 1.0
    yield from draw_box(area)
    yield from escape(area)
    yield from correct(area)
    bpy.context.scene.seeing_wind.box = (0.0, 0.0, 0.0, 0.0)
    area.type = "CLIP_EDITOR"
    area.spaces.active.clip = bpy.context.scene.active_clip
    yield 1.0
    yield from draw_box(area)
    yield from escape(area)
    yield from correct(area)
    area.type = "VIEW_3D"
    yield 1.0
    yield from recover(area)
    yield from draw_box_while(area)
    yield from switch_off_and_on(area)
    if "SEEING_WIND_SCENE" in os.environ:
        yield from resume_a_real_one(area)


def tell_costs() -> None:
    """With Blender's own layout; the middle one of all draws, since a first draw loads icons and fonts."""
    middle = {name: sorted(seconds)[len(seconds) // 2] for name, seconds in drawn.items()}
    for name in sorted(middle, key=middle.get, reverse=True):
        print(f"    {1e3 * middle[name]:.3f} ms  draw of {name.removeprefix('SEEING_WIND_PT_')}, {len(drawn[name])} times")


steps = story()


def advance() -> float:
    """Blender's timer: the next step, or the end."""
    try:
        return next(steps)
    except StopIteration:
        tell_costs()
        code = 0
    except Exception:
        traceback.print_exc()
        code = 9
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


bpy.app.timers.register(advance, first_interval=2.0)
