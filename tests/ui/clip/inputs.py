"""A small clip's masks, tracks, cameras and solves, as a user makes them, and the files that they become."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Euler

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.records import Camera
from seeing_wind.ui.clip.inputs.scene_inputs import scene_inputs

WIDTH, HEIGHT, FRAMES = 96, 64, 13
"""Of the clip."""


def pixel(x: float, y: float) -> tuple[float, float]:
    """Our pixel coordinates as the clip editor's 0..1 from the lower left."""
    return (x + 0.5) / WIDTH, 1.0 - (y + 0.5) / HEIGHT


def written(settings, folder: Path) -> dict[str, Path]:
    """The files made from the scene, by the worker's option for each."""
    made = {}
    for each in scene_inputs(bpy.context.scene):
        made[each.option] = folder / each.name
        each.write(made[each.option])
    assert all(path.is_file() for path in made.values())
    return made


def stamps() -> list[tuple]:
    return [each.stamp for each in scene_inputs(bpy.context.scene)]


def read_png(path: Path) -> np.ndarray:
    cv2 = pytest.importorskip("cv2")
    frame = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert frame.shape == (HEIGHT, WIDTH) and frame.dtype == np.uint8
    return frame > 0


def spline(layer: bpy.types.MaskLayer, points: list[tuple[float, float]], kind: str = "VECTOR") -> None:
    """A closed spline through pixels."""
    made = layer.splines.new()
    made.points.add(len(points) - 1)  # a new spline has one already
    for point, (x, y) in zip(made.points, points):
        point.co = ((x + 0.5 - 0.5 * WIDTH) / WIDTH + 0.5, (HEIGHT - y - 0.5 - 0.5 * HEIGHT) / WIDTH + 0.5)
    made.use_cyclic = True
    for point in made.points:  # last, for Blender places the handles now, by the neighbours as they are
        point.handle_type = kind


def camera(turn: float) -> Camera:
    """A camera of the clip's size, off centre and turned."""
    pose = front_view(3.0)
    pose[:3, :3] = np.array(Euler((0.1 * turn, -0.2, 0.15 * turn)).to_matrix()) @ pose[:3, :3]
    pose[:3, 3] += [0.3 * turn, 0.1, 0.2]
    return Camera(WIDTH, HEIGHT, 110.0, 110.0, 44.3, 35.9, pose)


def with_box(settings):
    settings.box = (20.0, 20.0, 44.0, 44.0)
    return settings


def solve(clip: bpy.types.MovieClip, k1: float = 0.0, k2: float = 0.0) -> None:
    """Tracks of points at rest before a camera that moves, bent by OpenCV's formula, and Blender's own solve of them."""
    clip.tracking.camera.units, clip.tracking.camera.focal_length_pixels = "PIXELS", 100.0
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 3)) * [1.5, 1.0, 1.0]
    for number, point in enumerate(points):
        track = clip.tracking.tracks.new(name=f"Point {number}", frame=1)
        for frame in range(1, FRAMES):
            angle = 0.06 * frame
            turn = np.array(Euler((0.0, angle, 0.0)).to_matrix())
            x, y, z = (point - [4.0 * np.sin(angle), 0.3 * np.sin(2.0 * angle), 4.0 * np.cos(angle)]) @ turn
            r2 = (x**2 + y**2) / z**2
            focal = 100.0 * (1.0 + k1 * r2 + k2 * r2**2)
            track.markers.insert_frame(frame, co=(-x / z * focal / WIDTH + 0.5, -y / z * focal / HEIGHT + 0.5))
    window = bpy.context.window_manager.windows[0]
    area = window.screen.areas[0]
    area.type = "CLIP_EDITOR"
    area.spaces.active.clip = clip
    clip.tracking.settings.use_keyframe_selection = True
    with bpy.context.temp_override(window=window, area=area, region=next(r for r in area.regions if r.type == "WINDOW")):
        bpy.ops.clip.solve_camera()
    assert clip.tracking.reconstruction.is_valid
