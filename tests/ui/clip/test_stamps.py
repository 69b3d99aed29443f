"""Which changes of masks, tracks, cameras and proxies ask for another recovery, and which do not: frames, saving, renaming."""

from __future__ import annotations

import dataclasses

import bpy
import pytest
from mathutils import Matrix

from seeing_wind.ui.bake.animation import curves_of
from seeing_wind.ui.clip.clip_scene import setup_clip_scene
from seeing_wind.ui.clip.inputs.clips import loaded_clip
from seeing_wind.ui.clip.inputs.scene_inputs import scene_inputs
from seeing_wind.ui.edit.resimulate.geometry import forget_geometry
from seeing_wind.ui.job import status
from seeing_wind.ui.recover.request import RecoverRequest
from tests.ui.clip.inputs import FRAMES, camera, pixel, solve, spline, stamps, with_box
from tests.ui.clip.test_masks_and_tracks import CORNERS, plane_track

SQUARE = [(20.5, 10.5), (60.5, 10.5), (60.5, 40.5), (20.5, 40.5)]


def masked(settings) -> bpy.types.Mask:
    """A mask with handles of the user's, as the object."""
    mask = bpy.data.masks.new("Leaf")
    spline(mask.layers.new(name="Outer"), SQUARE, "FREE")
    settings.object_mode, settings.mask_data = "BLENDER_MASK", mask
    return mask


def key_shape(mask: bpy.types.Mask, frame: int, shift: float) -> None:
    """Move all points of a mask, and key its shape, as *Insert Shape Key* of the Image Editor does."""
    bpy.context.scene.frame_set(frame)
    points = mask.layers[0].splines[0].points
    for point in points:
        point.co.x += shift
    window = bpy.context.window_manager.windows[0]
    area = window.screen.areas[0]
    area.type = "IMAGE_EDITOR"
    space, region = area.spaces[0], next(each for each in area.regions if each.type == "WINDOW")
    space.mode, space.mask = "MASK", mask
    with bpy.context.temp_override(window=window, area=area, region=region, space_data=space, edit_mask=mask):
        bpy.ops.mask.select_all(action="SELECT")
        assert bpy.ops.mask.shape_key_insert() == {"FINISHED"}


def mask_with_shapes(settings) -> bpy.types.Mask:
    """A mask whose shape is keyed."""
    mask = masked(settings)
    key_shape(mask, 1, 0.0)
    key_shape(mask, 11, 0.2)
    return mask


def tracked(settings) -> bpy.types.MovieClip:
    """A clip with a track of five markers that Recover is to use."""
    clip = bpy.context.scene.active_clip = loaded_clip(settings)
    track = clip.tracking.tracks.new(name="One", frame=1)
    for frame in range(1, 6):
        track.markers.insert_frame(frame, co=pixel(30.0 + frame, 20.0))
    with_box(settings).use_tracks = True
    return clip


def seen_by_a_camera(settings) -> bpy.types.Object:
    """The scene's camera, below a parent that is not keyed."""
    scene, above = bpy.context.scene, bpy.data.objects.new("Rig", None)
    setup_clip_scene(scene, settings.clip, dataclasses.asdict(camera(0.4)), 24.0, 0, FRAMES - 1, 1)
    scene.collection.objects.link(above)
    scene.camera.parent = above
    with_box(settings).camera_mode = "SCENE"
    bpy.context.view_layer.update()
    return scene.camera


def tied_to(scene, name: str) -> bpy.types.Object:
    """An empty that the scene's camera looks at."""
    target = bpy.data.objects.new(name, None)
    scene.collection.objects.link(target)
    scene.camera.constraints.new("TRACK_TO").target = target
    return target


def proxied(settings) -> bpy.types.Object:
    """A proxy mesh before the scene's camera."""
    seen_by_a_camera(settings)
    bpy.ops.mesh.primitive_cube_add(size=0.5)
    settings.proxy, settings.scale_mode, settings.object_mode = bpy.context.object, "PROXY", "PROXY"
    return bpy.context.object


def change(before: list, act) -> bool:
    """Whether an act changes the stamps."""
    act()
    bpy.context.view_layer.update()
    return stamps() != before


def test_a_handle_of_a_mask_counts(settings) -> None:
    point = masked(settings).layers[0].splines[0].points[0]
    before = stamps()
    assert change(before, lambda: setattr(point.handle_left, "x", point.handle_left.x + 0.05))
    assert change(stamps(), lambda: setattr(point, "handle_right_type", "VECTOR"))


@pytest.mark.parametrize("act", ["mute", "offset", "middle", "delete"])
def test_each_marker_of_a_track_counts(settings, act) -> None:
    track = tracked(settings).tracking.tracks[0]
    acts = {
        "mute": lambda: setattr(track.markers[2], "mute", True), "offset": lambda: setattr(track, "offset", (0.02, 0.0)),
        "middle": lambda: setattr(track.markers[2], "co", (0.1, 0.1)), "delete": lambda: track.markers.delete_frame(3),
    }  # fmt: skip
    assert change(stamps(), acts[act])


def test_each_marker_of_a_plane_track_and_which_is_active_count(settings) -> None:
    clip = loaded_clip(settings)
    plane = plane_track(clip, CORNERS)
    settings.object_mode = "PLANE"
    plane.markers.insert_frame(4).corners = [pixel(x + 2.0, y) for x, y in CORNERS]
    assert change(stamps(), lambda: setattr(plane.markers[-1], "corners", [pixel(x + 3.0, y) for x, y in CORNERS]))
    assert change(stamps(), lambda: setattr(plane.markers[-1], "mute", True))
    other = plane_track(clip, [(x + 5.0, y) for x, y in CORNERS])
    assert len(clip.tracking.plane_tracks) == 2
    before = stamps()
    now = clip.tracking.plane_tracks.active
    clip.tracking.plane_tracks.active = other if now != other else plane
    assert stamps() != before


@pytest.mark.parametrize("act", ["parent", "above", "target", "fit", "height", "aspect", "lens"])
def test_all_that_places_a_camera_counts(settings, act) -> None:
    scene = bpy.context.scene
    seen = seen_by_a_camera(settings)
    target = tied_to(scene, "Look")
    further = bpy.data.objects.new("Above", None)
    scene.collection.objects.link(further)
    seen.parent.parent = further
    bpy.context.view_layer.update()
    acts = {
        "parent": lambda: setattr(seen.parent.location, "x", 1.0), "above": lambda: setattr(further.location, "z", 1.0),
        "target": lambda: setattr(target.location, "y", 2.0), "fit": lambda: setattr(seen.data, "sensor_fit", "VERTICAL"),
        "height": lambda: setattr(seen.data, "sensor_height", 20.0), "aspect": lambda: setattr(scene.render, "pixel_aspect_x", 1.5),
        "lens": lambda: setattr(seen.data, "lens", 20.0),
    }  # fmt: skip
    assert change(stamps(), acts[act])


def test_where_a_solved_camera_was_moved_counts(settings) -> None:
    scene = bpy.context.scene
    solve(loaded_clip(settings))
    seen = bpy.data.objects.new("Solved", bpy.data.cameras.new("Solved"))
    scene.collection.objects.link(seen)
    scene.camera = seen
    seen.constraints.new("CAMERA_SOLVER")
    with_box(settings)
    assert change(stamps(), lambda: setattr(seen, "matrix_basis", Matrix.Scale(2.0, 4)))


@pytest.mark.parametrize("act", ["vertex", "place", "parent"])
def test_shape_and_place_of_a_proxy_count(settings, act) -> None:
    proxy = proxied(settings)
    proxy.parent = bpy.data.objects.new("Stand", None)
    bpy.context.scene.collection.objects.link(proxy.parent)
    acts = {
        "vertex": lambda: setattr(proxy.data.vertices[0].co, "x", 3.0), "place": lambda: setattr(proxy.location, "x", 1.0),
        "parent": lambda: setattr(proxy.parent.location, "x", 1.0),
    }  # fmt: skip
    before = stamps()
    acts[act]()
    forget_geometry()  # as the handler does after a change of a mesh
    assert stamps() != before


def moving_rig(settings) -> None:
    """A camera under a parent, with a constraint to a target; all three are keyed, in part, and the constraint's influence."""
    scene, seen = bpy.context.scene, seen_by_a_camera(settings)
    target = tied_to(scene, "Look")
    for obj, path in ((seen.parent, "location"), (target, "location")):
        for frame in (1, 11):
            setattr(obj, path, (0.1 * frame, 0.0, 0.0))
            obj.keyframe_insert(path, index=0, frame=frame)
    for frame in (1, 11):
        seen.constraints[0].influence = 0.1 * frame / 1.1
        seen.constraints[0].keyframe_insert("influence", frame=frame)
    turn = seen.parent.driver_add("rotation_euler", 2).driver
    turn.expression = "0.01 * frame"
    key = curves_of(target)[0].keyframe_points[1]
    key.handle_left_type, key.handle_left, key.interpolation = "FREE", (8.0, 0.3), "BEZIER"
    seen.data.lens = 30.0
    seen.data.keyframe_insert("lens", frame=1)
    seen.data.lens = 40.0
    seen.data.keyframe_insert("lens", frame=11)


def camera_in_strips(settings) -> bpy.types.NlaTrack:
    """A camera moved by a strip of the NLA editor, and so is the rig that it hangs from."""
    seen = seen_by_a_camera(settings)
    for obj in (seen, seen.parent):
        for frame in (1, 11):
            obj.location = (0.1 * frame, 0.0, 0.02 * frame)
            obj.keyframe_insert("location", frame=frame)
        data = obj.animation_data
        strip = data.nla_tracks.new().strips.new("Fly", 1, data.action)
        data.action = None
        strip.use_animated_influence = True
        for frame in (1, 11):
            strip.influence = 0.05 * frame
            strip.keyframe_insert("influence", frame=frame)
    bpy.context.view_layer.update()
    return seen.animation_data.nla_tracks[0]


@pytest.mark.parametrize("source", [masked, mask_with_shapes, moving_rig, proxied])
def test_files_made_from_the_scene_leave_its_frame_as_it_was(settings, source, tmp_path) -> None:
    source(settings)
    scene = bpy.context.scene
    scene.frame_set(-3, subframe=0.5)
    for each in scene_inputs(scene):
        each.write(tmp_path / each.name)
        assert scene.frame_current_final == -2.5, each.option


@pytest.mark.parametrize("source", [masked, mask_with_shapes, tracked, seen_by_a_camera, moving_rig, camera_in_strips, proxied])
def test_neither_frames_nor_saving_nor_names_ask_for_another_recovery(settings, source, tmp_path) -> None:
    source(settings)
    scene = bpy.context.scene
    fresh = stamps()
    for frame in (1, 7, 12):
        scene.frame_set(frame)
        assert stamps() == fresh
    before = RecoverRequest.of(scene).digest()
    for obj in scene.objects:
        obj.name = f"My {obj.name}"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert RecoverRequest.of(scene).digest() == before
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    scene = bpy.context.scene
    forget_geometry()
    assert RecoverRequest.of(scene).digest() == before, "before Blender has evaluated anything"
    for frame in (1, 5):
        scene.frame_set(frame)
        assert RecoverRequest.of(scene).digest() == before


@pytest.mark.parametrize("act", ["interpolation", "handle", "extrapolation", "mute", "modifier"])
def test_what_shapes_a_curve_between_its_keys_counts(settings, act) -> None:
    moving_rig(settings)
    curve = curves_of(bpy.context.scene.camera.parent)[0]
    key = curve.keyframe_points[0]
    acts = {
        "interpolation": lambda: setattr(key, "interpolation", "LINEAR"),
        "extrapolation": lambda: setattr(curve, "extrapolation", "LINEAR"),
        "handle": lambda: setattr(key, "handle_right_type", "FREE"), "mute": lambda: setattr(curve, "mute", True),
        "modifier": lambda: curve.modifiers.new("NOISE"),
    }  # fmt: skip
    assert change(stamps(), acts[act])
    if act == "handle":
        assert change(stamps(), lambda: setattr(key, "handle_right", (4.0, 2.0)))


def test_the_keyed_shape_of_the_first_frame_counts_whichever_frame_is_shown(settings) -> None:
    mask = mask_with_shapes(settings)
    before = stamps()
    key_shape(mask, 15, 0.1)
    assert stamps() == before, "a later key does not change the first frame's shape"
    key_shape(mask, 1, 0.1)
    bpy.context.scene.frame_set(11)
    assert stamps() != before


@pytest.mark.parametrize("act", ["key", "time", "speed", "mute", "off"])
def test_what_a_strip_plays_counts(settings, act) -> None:
    track = camera_in_strips(settings)
    strip = track.strips[0]
    key = curves_of_strip(strip)[0].keyframe_points[1]
    acts = {
        "key": lambda: setattr(key, "co", (11.0, 3.0)), "time": lambda: setattr(strip, "frame_start_ui", 3.0),
        "speed": lambda: setattr(strip, "scale", 2.0), "mute": lambda: setattr(track, "mute", True),
        "off": lambda: setattr(bpy.context.scene.camera.animation_data, "use_nla", False),
    }  # fmt: skip
    assert change(stamps(), acts[act])


def curves_of_strip(strip: bpy.types.NlaStrip) -> list[bpy.types.FCurve]:
    return list(strip.action.layers[0].strips[0].channelbag(strip.action_slot).fcurves)


def test_an_unkeyed_turn_of_a_keyed_rig_counts(settings) -> None:
    moving_rig(settings)
    rig = bpy.context.scene.camera.parent
    assert change(stamps(), lambda: setattr(rig.rotation_euler, "x", 0.5))
    assert change(stamps(), lambda: setattr(rig.location, "y", 0.5))


def test_a_camera_that_is_moved_is_noticed_without_an_edit(settings) -> None:
    scene, seen = bpy.context.scene, seen_by_a_camera(settings)
    settings.recovered_digest = RecoverRequest.of(scene).digest()
    status.refresh(scene)
    now = status.of(scene.session_uid).steps["recover"]
    assert now.state == "done" and len(scene_inputs(scene)) == 1
    seen.parent.location.x = 1.0
    bpy.context.view_layer.update()
    assert status.of(scene.session_uid).steps["recover"].state == "stale"
