"""Masks, tracks, plane tracks, camera solves and proxies of the scene become the engine's files, to a fraction of a pixel."""

from __future__ import annotations

import dataclasses
import json
import math
import runpy
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Euler

import seeing_wind.ui as ui
from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.errors import ObjectError, UsageError
from seeing_wind.engine.records import Camera
from seeing_wind.ui.clip.clip_scene import setup_clip_scene
from seeing_wind.ui.clip.frame_on_screen import box_in_picture, box_on_screen
from seeing_wind.ui.clip.inputs.camera import camera_source, scene_camera
from seeing_wind.ui.clip.inputs.clips import as_pattern, loaded_clip
from seeing_wind.ui.clip.inputs.scene_inputs import scene_inputs
from seeing_wind.ui.clip.object.options import object_options
from seeing_wind.ui.clip.options import clip_options
from seeing_wind.ui.job.takes import INPUTS
from seeing_wind.ui.recover.request import RecoverRequest, scene_values

WIDTH, HEIGHT, PICTURES = 96, 64, 13


@pytest.fixture(scope="module")
def video(tmp_path_factory) -> Path:
    tools = runpy.run_path(str(Path(__file__).resolve().parents[1] / "extension.py"))
    return tools["make_clip"](tmp_path_factory.mktemp("video") / "clip.mp4", PICTURES, (WIDTH, HEIGHT))


@pytest.fixture
def settings(clean_file, video):
    """The settings of an empty scene whose clip is chosen."""
    ui.register()
    bpy.context.scene.seeing_wind.clip = str(video)
    yield bpy.context.scene.seeing_wind
    ui.unregister()


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


def test_tracks_are_in_our_pixels_and_rows_are_the_file_s_pictures(settings, tmp_path) -> None:
    clip = loaded_clip(settings)
    one, other = clip.tracking.tracks.new(name="One", frame=1), clip.tracking.tracks.new(name="Other", frame=1)
    for picture in range(10):
        one.markers.insert_frame(picture + 1, co=pixel(30.0 + picture, 20.25))
        other.markers.insert_frame(picture + 1, co=pixel(40.0, 30.0 - 0.5 * picture))
    other.markers.find_frame(4).mute = True
    settings.use_tracks = True
    with np.load(written(settings, tmp_path)["tracks"]) as data:
        xy, visible = data["xy"], data["visible"]
    assert len(xy) > PICTURES, "more rows than pictures: the engine takes those of the range that was chosen"
    np.testing.assert_allclose(xy[:10, 0], np.stack([30.0 + np.arange(10), np.full(10, 20.25)], 1), atol=1e-4)
    assert visible[:10, 0].all() and not visible[10:, 0].any() and visible[:10, 1].tolist() == [True] * 3 + [False] + [True] * 6
    settings.use_frames, settings.frames = True, (11, 12)
    with pytest.raises(ObjectError, match="No track has a marker in picture 11"):
        written(settings, tmp_path)


def test_a_clip_that_starts_later_keeps_its_tracks(settings, tmp_path) -> None:
    """`frame_offset` shifts the file under the markers: marker frame 1 is picture 3 of the file."""
    clip = loaded_clip(settings)
    clip.frame_offset = 3
    clip.tracking.tracks.new(name="One", frame=1).markers.insert_frame(1, co=pixel(10.0, 11.0))
    settings.use_tracks, settings.use_frames, settings.frames = True, True, (3, 9)
    with np.load(written(settings, tmp_path)["tracks"]) as data:
        assert data["visible"][:, 0].nonzero()[0].tolist() == [3]
        np.testing.assert_allclose(data["xy"][3, 0], [10.0, 11.0], atol=1e-4)
    setup_clip_scene(bpy.context.scene, settings.clip, dataclasses.asdict(camera(0.0)), 24.0, 3, 6, frame_start=7)
    assert clip.frame_offset == 3 and 7 - clip.frame_start + clip.frame_offset == 3, "picture 3 at frame 7, markers untouched"


def plane_track(clip: bpy.types.MovieClip, corners: list[tuple[float, float]]) -> bpy.types.MovieTrackingPlaneTrack:
    """A plane track with these corners [px] in the first picture, made as the user makes one, from four tracks."""
    window = bpy.context.window_manager.windows[0]
    area = window.screen.areas[0]
    area.type = "CLIP_EDITOR"
    area.spaces.active.clip = clip
    for name, corner in zip("ABCD", corners):
        track = clip.tracking.tracks.new(name=name, frame=1)
        track.markers.insert_frame(1, co=pixel(*corner))
        track.select = True
    with bpy.context.temp_override(window=window, area=area, region=next(r for r in area.regions if r.type == "WINDOW")):
        bpy.ops.clip.create_plane_track()
    return clip.tracking.plane_tracks[0]


CORNERS = [(20.0, 50.0), (70.0, 44.0), (60.0, 12.0), (28.0, 8.0)]


def test_a_plane_track_is_a_mask_and_a_grid_of_tracks(settings, tmp_path) -> None:
    plane = plane_track(loaded_clip(settings), CORNERS)
    for track in list(loaded_clip(settings).tracking.tracks):
        track.markers.delete_frame(1) if len(track.markers) > 1 else None
    plane.markers[0].corners = [pixel(*corner) for corner in CORNERS]
    settings.object_mode, settings.use_tracks = "PLANE", True
    files = written(settings, tmp_path)
    inside = read_png(files["mask"])
    a, b = np.array(CORNERS), np.roll(CORNERS, -1, axis=0)
    area = 0.5 * abs((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    assert inside.sum() == pytest.approx(area, rel=0.02)
    with np.load(files["tracks"]) as data:
        points = data["xy"][0][4:][data["visible"][0][4:]]
    assert len(points) == 36 and inside[tuple(np.round(points[:, ::-1]).astype(int).T)].all()
    # the diagonals of a quadrilateral cross in the image of the square's middle
    grid = points.reshape(6, 6, 2)
    middle = np.array([cross(grid[0, 0], grid[5, 5], grid[0, 5], grid[5, 0]), cross(*(np.array(CORNERS[k]) for k in (0, 2, 1, 3)))])
    np.testing.assert_allclose(middle[0], middle[1], atol=1e-3)


def cross(a, b, c, d) -> np.ndarray:
    """Where the line a-b meets the line c-d."""
    s = np.linalg.solve(np.stack([b - a, c - d], axis=1), c - a)[0]
    return a + s * (b - a)


def read_png(path: Path) -> np.ndarray:
    cv2 = pytest.importorskip("cv2")
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (HEIGHT, WIDTH) and picture.dtype == np.uint8
    return picture > 0


def spline(layer: bpy.types.MaskLayer, points: list[tuple[float, float]], kind: str = "VECTOR") -> None:
    """A closed spline through pixels."""
    made = layer.splines.new()
    made.points.add(len(points) - 1)  # a new spline has one already
    for point, (x, y) in zip(made.points, points):
        point.co = ((x + 0.5 - 0.5 * WIDTH) / WIDTH + 0.5, (HEIGHT - y - 0.5 - 0.5 * HEIGHT) / WIDTH + 0.5)
    made.use_cyclic = True
    for point in made.points:  # last, for Blender places the handles now, by the neighbours as they are
        point.handle_type = kind


def test_a_mask_is_drawn_at_the_clip_s_size(settings, tmp_path) -> None:
    mask = bpy.data.masks.new("Leaf")
    spline(mask.layers.new(name="Outer"), [(20.5, 10.5), (60.5, 10.5), (60.5, 40.5), (20.5, 40.5)])
    hole = mask.layers.new(name="Hole")
    spline(hole, [(30.5, 20.5), (40.5, 20.5), (40.5, 30.5), (30.5, 30.5)])
    hole.blend = "SUBTRACT"
    settings.object_mode, settings.mask_data = "BLENDER_MASK", mask
    expected = np.zeros((HEIGHT, WIDTH), dtype=bool)
    expected[11:41, 21:61] = True
    expected[21:31, 31:41] = False
    np.testing.assert_array_equal(read_png(written(settings, tmp_path)["mask"]), expected)
    before = stamps()
    mask.name = "Leaf of Another Name"
    assert stamps() == before
    hole.splines[0].points[0].co.x += 0.05
    assert stamps() != before
    bpy.data.masks.remove(mask)
    with pytest.raises(ObjectError, match="No mask is chosen"):
        scene_inputs(bpy.context.scene)


def test_a_round_mask_has_the_area_of_a_disc(settings, tmp_path) -> None:
    mask = bpy.data.masks.new("Disc")
    turn = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    spline(mask.layers.new(name="L"), [(48.0 + 25.0 * math.cos(a), 32.0 + 25.0 * math.sin(a)) for a in turn], "AUTO")
    settings.object_mode, settings.mask_data = "BLENDER_MASK", mask
    assert read_png(written(settings, tmp_path)["mask"]).sum() == pytest.approx(np.pi * 25.0**2, rel=0.01)


def camera(turn: float) -> Camera:
    """A camera of the clip's size, off centre and turned."""
    pose = front_view(3.0)
    pose[:3, :3] = np.array(Euler((0.1 * turn, -0.2, 0.15 * turn)).to_matrix()) @ pose[:3, :3]
    pose[:3, 3] += [0.3 * turn, 0.1, 0.2]
    return Camera(WIDTH, HEIGHT, 110.0, 110.0, 44.3, 35.9, pose)


@pytest.mark.parametrize("unit", [1.0, 0.01])
@pytest.mark.parametrize("moving", [False, True])
def test_the_scene_s_camera_is_the_inverse_of_what_a_take_makes(settings, tmp_path, unit, moving) -> None:
    scene, given = bpy.context.scene, camera(0.4)
    scene.unit_settings.scale_length = unit
    if moving:
        given = dataclasses.replace(given, camera_to_world=np.stack([camera(0.1 * k).camera_to_world for k in range(PICTURES)]))
    setup_clip_scene(scene, settings.clip, dataclasses.asdict(given), 24.0, 0, PICTURES - 1, settings.frame_start)
    scene.camera.scale = (2.0, 2.0, 2.0)  # a user's way to see it better
    settings.camera_mode = "SCENE"
    values = json.loads(written(settings, tmp_path)["camera"].read_text())
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        assert values[name] == pytest.approx(getattr(given, name), abs=1e-3)
    for picture in (0, 5, 12):
        np.testing.assert_allclose(values["camera_to_world"][picture], given.pose(picture), atol=1e-5)


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
def test_sensor_fit(settings, fit) -> None:
    scene = bpy.context.scene
    setup_clip_scene(scene, settings.clip, dataclasses.asdict(camera(0.0)), 24.0, 0, PICTURES - 1, 1)
    data = scene.camera.data
    data.sensor_fit, data.sensor_height = fit, 24.0
    settings.camera_mode = "SCENE"
    frame = np.array([tuple(corner) for corner in data.view_frame(scene=scene)])
    values = scene_camera(scene)
    corners = frame[:, :2] / -frame[:, 2:] * [values["fx"], -values["fy"]] + [values["cx"], values["cy"]]
    np.testing.assert_allclose([corners.min(0), corners.max(0)], [[-0.5, -0.5], [WIDTH - 0.5, HEIGHT - 0.5]], atol=1e-3)


def test_a_camera_solve_is_found_by_itself_and_sees_its_own_points(settings, tmp_path) -> None:
    clip = loaded_clip(settings)
    assert "fov" in object_options(with_box(settings), scene_values(settings), tmp_path)[0]
    solve(clip)
    options = object_options(settings, scene_values(settings), tmp_path)[0]
    assert "camera" in options and "fov" not in options, "automatic: a solve goes before the field of view"
    assert "distance" not in options, "and its scale is the scene's: the object is about where the world's origin is"
    values = json.loads(written(settings, tmp_path)["camera"].read_text())
    poses = np.array(values["camera_to_world"])
    for track in clip.tracking.tracks:
        for marker in track.markers:
            pose = poses[marker.frame - 1]
            local = (np.array(track.bundle) - pose[:3, 3]) @ pose[:3, :3]
            seen = local[:2] / local[2] * [values["fx"], values["fy"]] + [values["cx"], values["cy"]]
            assert np.abs(pixel(*seen) - np.array(marker.co)).max() < 1e-3
    settings.camera_mode = "FOV"
    assert "fov" in object_options(settings, scene_values(settings), tmp_path)[0]


def with_box(settings):
    settings.box = (20.0, 20.0, 44.0, 44.0)
    return settings


def solve(clip: bpy.types.MovieClip, k1: float = 0.0, k2: float = 0.0) -> None:
    """Tracks of points at rest before a camera that moves, bent by OpenCV's formula, and Blender's own solve of them."""
    clip.tracking.camera.units, clip.tracking.camera.focal_length_pixels = "PIXELS", 100.0
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 3)) * [1.5, 1.0, 1.0]
    for number, point in enumerate(points):
        track = clip.tracking.tracks.new(name=f"Point {number}", frame=1)
        for frame in range(1, PICTURES):
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


@pytest.mark.parametrize("unit", [1.0, 0.1])
def test_a_proxy_gives_the_depth_of_each_pixel(settings, tmp_path, unit) -> None:
    """A ball: depth along the view axis against the sphere's equation, outline where the discriminant says."""
    scene, seen = bpy.context.scene, camera(0.0)
    scene.unit_settings.scale_length = unit
    setup_clip_scene(scene, settings.clip, dataclasses.asdict(seen), 24.0, 0, PICTURES - 1, 1)
    centre = seen.unproject(np.array([50.0, 30.0]), 2.5)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.5 / unit, location=centre / unit, segments=96, ring_count=48)
    settings.proxy, settings.scale_mode, settings.object_mode = bpy.context.object, "PROXY", "PROXY"
    files = written(settings, tmp_path)
    assert "camera" in files and "mask" not in files, "the depth file is the outline as well"
    depth = np.load(files["depth"])
    assert depth.shape == (HEIGHT, WIDTH) and depth.dtype == np.float32
    column, row = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    rays = np.stack([(column - seen.cx) / seen.fx, (row - seen.cy) / seen.fy, np.ones(column.shape)], axis=-1)
    middle = np.linalg.inv(seen.pose(0)) @ [*centre, 1.0]
    along, square = rays @ middle[:3], (rays * rays).sum(axis=-1)
    discriminant = along**2 - square * (middle[:3] @ middle[:3] - 0.25)
    expected = (along - np.sqrt(np.maximum(discriminant, 0.0))) / square
    clear = np.abs(discriminant) > 0.02
    np.testing.assert_array_equal(np.isfinite(depth)[clear], (discriminant > 0)[clear])
    hit = np.isfinite(depth) & clear
    assert hit.sum() > 500 and np.abs(depth - expected)[hit].max() < 3e-3
    settings.scale_mode = "DISTANCE"
    with pytest.raises(ObjectError, match="does not give its depth"):
        scene_inputs(scene)


def test_what_is_missing_is_told(settings, tmp_path) -> None:
    scene = bpy.context.scene
    for change, error, says in (
        ({"object_mode": "PLANE"}, ObjectError, "no plane track"),
        ({"use_tracks": True, "object_mode": "BOX"}, ObjectError, "no tracks"),
        ({"use_tracks": False, "scale_mode": "PROXY"}, UsageError, "No proxy"),
        ({"scale_mode": "DISTANCE", "camera_mode": "SOLVE"}, UsageError, "no camera solve"),
        ({"camera_mode": "SCENE"}, UsageError, "no camera"),
    ):
        for name, value in change.items():
            setattr(settings, name, value)
        with pytest.raises(error, match=says):
            scene_inputs(scene)


def test_gravity_is_the_scene_s_in_its_units(settings) -> None:
    scene = bpy.context.scene

    def gravity() -> tuple[float, ...]:
        return RecoverRequest.of(scene).recover.gravity

    with_box(settings)
    assert gravity() == (0.0, 0.0, -9.81)
    scene.unit_settings.scale_length = 0.1
    assert gravity()[2] == pytest.approx(-0.981, rel=1e-6), "what Blender's own panel shows then"
    scene.unit_settings.system = "NONE"
    assert gravity() == (0.0, 0.0, -9.81)


def test_one_request_gives_options_digest_and_files(settings, tmp_path) -> None:
    scene, mask = bpy.context.scene, bpy.data.masks.new("Leaf")
    spline(mask.layers.new(name="Outer"), [(20.5, 10.5), (60.5, 10.5), (60.5, 40.5), (20.5, 40.5)])
    settings.take, settings.object_mode, settings.mask_data = str(tmp_path / "one.take"), "BLENDER_MASK", mask
    request = RecoverRequest.of(scene)
    file = tmp_path / "one.take" / INPUTS / "mask.png"
    words = request.arguments()
    assert words[words.index("--mask") + 1] == str(file) and request.files() == [Path(settings.clip)] and not file.exists()
    with pytest.raises(dataclasses.FrozenInstanceError):
        request.clip = ""
    request.write_inputs()
    assert file.is_file() and RecoverRequest.of(scene) == request, "the file is no setting"
    settings.take = str(tmp_path / "moved.take")
    assert RecoverRequest.of(scene).digest() == request.digest(), "nor is its place"
    mask.layers[0].splines[0].points[0].co.x += 0.05
    assert RecoverRequest.of(scene).digest() != request.digest()
    settings.object_mode = "BOX"
    with pytest.raises(ObjectError, match="No box"):
        RecoverRequest.of(scene)


def test_a_sequence_of_pictures_plays_at_the_scene_s_rate(settings, tmp_path) -> None:
    assert as_pattern("/a/shot_0007.png") == "/a/shot_%04d.png" and as_pattern("/a/clip7.mp4") == "/a/clip7.mp4"
    first = tmp_path / "wind è_001.png"
    first.write_bytes(b"")
    settings.clip = str(first)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 30, 1.001
    assert clip_options(settings, scene_values(settings))[:2] == (str(tmp_path / "wind è_%03d.png"), {"fps": 29.97003, "frames": None})


def test_boxes_on_the_screen_and_in_the_picture() -> None:
    corners = np.array([[100.0, 50.0], [580.0, 370.0]])
    box = box_in_picture(corners, np.array([205.0, 300.0]), np.array([400.0, 100.0]), WIDTH, HEIGHT)
    assert box == (20.5, 13.5, 59.5, 53.5), "five screen pixels to one of the clip"
    np.testing.assert_allclose(box_on_screen(corners, box, WIDTH, HEIGHT), [[205.0, 100.0], [400.0, 300.0]], atol=0.5)
    outside = box_in_picture(corners, np.array([0.0, 0.0]), np.array([900.0, 900.0]), WIDTH, HEIGHT)
    assert outside == (0.0, 0.0, WIDTH - 1.0, HEIGHT - 1.0)


def test_choosing_a_clip_shows_it_and_keeps_its_place_in_time(settings, video) -> None:
    scene = bpy.context.scene
    settings.clip = ""
    with pytest.raises(RuntimeError, match="no active movie clip"):
        bpy.ops.seeing_wind.choose_clip(active=True)
    with pytest.raises(RuntimeError, match="(?i)no such|cannot|not"):
        bpy.ops.seeing_wind.choose_clip(filepath="/no/such.mp4")
    assert settings.clip == ""
    scene.active_clip = bpy.data.movieclips.load(str(video))
    scene.active_clip.frame_start = 101
    assert bpy.ops.seeing_wind.choose_clip(active=True) == {"FINISHED"}
    assert settings.frame_start == 101 and scene.active_clip.frame_start == 101 and scene.frame_start == 101
    assert scene.camera is not None and scene.camera.data.background_images[0].clip == scene.active_clip
    assert (scene.render.resolution_x, scene.render.fps, len(bpy.data.movieclips)) == (WIDTH, 24, 1)
    assert bpy.ops.seeing_wind.draw_box(box=(20.0, 20.0, 44.0, 44.0)) == {"FINISHED"} and settings.object_mode == "BOX"
    with pytest.raises(RuntimeError, match="too small"):
        bpy.ops.seeing_wind.draw_box(box=(20.0, 20.0, 20.0, 44.0))


@pytest.mark.parametrize(("told", "fits"), [((-0.25, 0.05), True), ((0.0, 0.0), False)])
def test_blenders_own_solver_means_the_lens_as_the_engine_does(settings, told, fits) -> None:
    """Points bent by OpenCV's formula are solved without a rest when Blender is told the same numbers, and not otherwise."""
    clip = loaded_clip(settings)
    lens = clip.tracking.camera
    lens.distortion_model, lens.k1, lens.k2 = "POLYNOMIAL", *told
    solve(clip, -0.25, 0.05)
    assert (clip.tracking.reconstruction.average_error < 0.01) == fits
    found = scene_camera(bpy.context.scene)
    assert (found.get("k1", 0.0), found.get("k2", 0.0)) == pytest.approx(told)


@pytest.mark.parametrize("model", ["POLYNOMIAL", "DIVISION", "BROWN"])
def test_the_lens_of_a_solve_is_handed_on(settings, model) -> None:
    """Blender's numbers by OpenCV's names; Division, which has another formula, to a fraction of a pixel."""
    scene, clip = bpy.context.scene, loaded_clip(settings)
    solve(clip)
    lens, stamp = clip.tracking.camera, camera_source(scene)
    assert "k1" not in scene_camera(scene), "a lens that bends nothing says nothing"
    lens.distortion_model = model
    if model == "POLYNOMIAL":
        lens.k1, lens.k2 = -0.25, 0.05
    elif model == "DIVISION":
        lens.division_k1, lens.division_k2 = -0.12, 0.01
    else:
        lens.brown_k1, lens.brown_k2, lens.brown_p1, lens.brown_p2 = -0.2, 0.04, 0.01, -0.006
    found = scene_camera(scene)
    assert camera_source(scene) != stamp
    if model == "DIVISION":
        straight = np.linspace(0.0, 0.5, 20)
        bent = straight * (1.0 + found["k1"] * straight**2 + found["k2"] * straight**4 + found["k3"] * straight**6)
        assert np.abs(bent / (1.0 - 0.12 * bent**2 + 0.01 * bent**4) - straight).max() * found["fx"] < 0.02
        return
    given = (-0.25, 0.05, 0.0, 0.0) if model == "POLYNOMIAL" else (-0.2, 0.04, 0.01, -0.006)
    assert [found[name] for name in ("k1", "k2", "p1", "p2")] == pytest.approx(given, abs=1e-6)


def test_a_lens_that_the_engine_lacks_is_said(settings) -> None:
    clip = loaded_clip(settings)
    solve(clip)
    clip.tracking.camera.distortion_model = "NUKE"
    with pytest.raises(UsageError, match="lens model Nuke"):
        scene_camera(bpy.context.scene)
