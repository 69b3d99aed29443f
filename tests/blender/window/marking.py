"""Marking the object with the mouse: a box over the camera's background and in the Movie Clip Editor, points that correct the outline."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np

from seeing_wind.ui.clip.frame_on_screen import box_on_screen, frame_corners
from seeing_wind.ui.clip.inputs.clips import loaded_clip, scene_frame

BOX = (20.0, 16.0, 52.0, 48.0)
POINT, LATER = (12.0, 40.0), 3
"""A place in the frame with that index."""


def check(condition: bool, what: str) -> None:
    """An assertion that no optimisation switches off."""
    if not condition:
        raise AssertionError(what)
    print(f"ok  {what}", flush=True)


def window() -> bpy.types.Window:
    """The first one."""
    return bpy.context.window_manager.windows[0]


def largest_area() -> bpy.types.Area:
    """The viewport, or what has taken its place."""
    areas = [area for area in window().screen.areas if area.type in ("VIEW_3D", "CLIP_EDITOR")]
    return max(areas, key=lambda area: area.width * area.height)


def override(area: bpy.types.Area) -> dict:
    """The context of an area's main region."""
    region = next(region for region in area.regions if region.type == "WINDOW")
    return {"window": window(), "area": area, "region": region, "space_data": area.spaces.active}


def mouse(kind: str, value: str, at: np.ndarray) -> None:
    """One event at a place of the window."""
    window().event_simulate(kind, value, x=int(at[0]), y=int(at[1]))


def click(at: np.ndarray) -> Iterator[float]:
    """Move there, press and let go."""
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
        mouse(kind, value, at)
        yield 0.3


def on_screen(area: bpy.types.Area, box: tuple[float, float, float, float]) -> tuple[np.ndarray, float]:
    """Lower left and upper right corner (2, 2) of a box of the clip in the window, and a pixel of the window in pixels of the clip."""
    with bpy.context.temp_override(**override(area)):
        region = bpy.context.region
        corners, size = frame_corners(bpy.context, region), bpy.context.scene.active_clip.size
    return box_on_screen(corners, box, *size) + [region.x, region.y], size[0] / (corners[1] - corners[0])[0]


def draw_box(area: bpy.types.Area) -> Iterator[float]:
    """Drag a box round `BOX` with the mouse."""
    with bpy.context.temp_override(**override(area)):
        check(bpy.ops.seeing_wind.draw_box("INVOKE_DEFAULT") == {"RUNNING_MODAL"}, f"Draw Box waits in the {area.type}")
    yield 1.5  # the view has turned to the camera and has been drawn
    (low, high), pixel = on_screen(area, BOX)
    start, end = np.array([low[0], high[1]]), np.array([high[0], low[1]])
    for kind, value, at in (
        ("MOUSEMOVE", "NOTHING", start),
        ("LEFTMOUSE", "PRESS", start),
        ("MOUSEMOVE", "NOTHING", 0.5 * (start + end)),
        ("MOUSEMOVE", "NOTHING", end),
        ("LEFTMOUSE", "RELEASE", end),
    ):
        mouse(kind, value, at)
        yield 0.3
    drawn = np.array(bpy.context.scene.seeing_wind.box)
    check(np.abs(drawn - BOX).max() <= 1.5 * pixel + 0.1, f"a box in the {area.type}: {np.round(drawn, 1).tolist()} for {list(BOX)}")


def escape(area: bpy.types.Area) -> Iterator[float]:
    """Esc leaves the box as it was."""
    before = tuple(bpy.context.scene.seeing_wind.box)
    with bpy.context.temp_override(**override(area)):
        bpy.ops.seeing_wind.draw_box("INVOKE_DEFAULT")
    yield 1.0
    window().event_simulate("ESC", "PRESS", x=area.x + area.width // 2, y=area.y + area.height // 2)
    yield 1.0
    check(tuple(bpy.context.scene.seeing_wind.box) == before and not window().modal_operators, "Esc cancels Draw Box")


def correct(area: bpy.types.Area) -> Iterator[float]:
    """Click a point on the object in a later frame; beside the frame and in another area nothing is marked."""
    scene = bpy.context.scene
    points = scene.seeing_wind.corrections
    points.clear()
    scene.frame_set(scene_frame(loaded_clip(scene.seeing_wind), LATER))
    if area.type == "VIEW_3D":
        area.spaces.active.region_3d.view_perspective = "PERSP"

    def begin(beside: bool) -> None:
        with bpy.context.temp_override(**override(area)):
            started = bpy.ops.seeing_wind.correct_outline("INVOKE_DEFAULT", beside=beside)
        check(started == {"RUNNING_MODAL"} and len(window().modal_operators) == 1, f"a point is waited for in the {area.type}")

    for beside in (False, True):
        begin(beside)
        yield 1.5
        places, pixel = on_screen(area, POINT + POINT)
        yield from click(places.mean(axis=0))
        found = points[-1]
        check(np.abs(np.array(found.place) - POINT).max() <= pixel + 0.1, f"it is at {np.round(found.place, 1).tolist()} for {POINT}")
        check((found.clip_frame, found.beside) == (LATER, beside) and not window().modal_operators, "in the frame that is shown")
    begin(False)
    yield 1.0
    (low, _), _ = on_screen(area, (0.0, 0.0, 63.0, 63.0))
    yield from click(low - 8.0)
    check(len(points) == 2 and not window().modal_operators, "a click beside the frame marks nothing")
    begin(False)
    yield 1.0
    other = next(each for each in window().screen.areas if each.type == "OUTLINER")
    yield from click(np.array([other.x + other.width // 2, other.y + 5]))
    check(len(points) == 2 and not window().modal_operators, "a click elsewhere ends the wait")
    begin(False)
    yield 1.0
    sidebar = next(each for each in area.regions if each.type == "UI")
    yield from click(np.array([sidebar.x + sidebar.width // 2, sidebar.y + 5]))
    check(len(points) == 2 and not window().modal_operators, "and so does one on the sidebar")
    points.clear()
