"""The field object in the rest of Blender, and the edit over the clip: operators as a script calls them, on the stand-in for the engine."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view

from seeing_wind.engine.conventions import in_figures
from seeing_wind.engine.masks import Masks
from seeing_wind.engine.record_arrays import from_arrays
from seeing_wind.engine.take import Take
from seeing_wind.ui.clip.clip_scene import FRAME_COLOUR, create_recovered_object
from seeing_wind.ui.composite import composite
from seeing_wind.ui.composite.catchers import FLOOR, WALL
from seeing_wind.ui.composite.mattes import CARD, MARGIN, matte, narrowed, softened, widened, window_of
from seeing_wind.ui.composite.nodes import is_set_up
from seeing_wind.ui.composite.own import changes
from seeing_wind.ui.field.samples import read_samples, samples_of
from seeing_wind.ui.job import takes
from seeing_wind.ui.user_paths import absolute
from tests.ui.composite.rendering import red_cube, render
from tests.ui.jobs import notes_of, recover
from tests.ui.meshes import cube


def test_the_edit_is_rendered_over_the_clip(scene, tmp_path):
    red_cube(scene)
    scene.frame_set(4)
    said = composite.set_up(scene, samples=1)
    assert said.behind == "clip" and said.light
    frame = render(tmp_path / "over.png")
    assert frame.shape == (64, 96, 3)
    # frame 3 of the clip: grey 60, a square of 230 from column 26 to 50
    assert np.abs(frame[4:16, 60:90] - 60).max() < 12
    assert np.abs(frame[28:36, 32:44] - 230).max() < 14
    cube = frame[44:56, 12:24].reshape(-1, 3).mean(0)
    assert cube[0] > 150 and cube[0] > cube[1] + 80
    # another frame shows another clip frame of the clip
    scene.frame_set(12)
    assert np.abs(render(tmp_path / "later.png")[28:36, 30:38] - 60).max() < 12


def test_the_clips_object_simulated_anew_is_shown_over_the_clean_plate(scene, tmp_path):
    bpy.ops.seeing_wind.insert_mesh(recovered=True)
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake()
    assert bpy.ops.seeing_wind.set_up_composite(samples=1) == {"FINISHED"}
    assert scene.seeing_wind.recovered_object.hide_render
    scene.frame_set(1)
    frame = render(tmp_path / "plate.png")
    assert np.abs(frame[2:8, 80:94] - 60).max() < 12, "beside the object the clip goes on"
    assert np.abs(frame[28:36, 28:36] - [20, 120, 40]).max() < 4, "over it lies the plate"
    # asked for the clip instead, the object is in it and its outline only hides what is behind
    assert bpy.ops.seeing_wind.set_up_composite(samples=1, behind="CLIP") == {"FINISHED"}
    assert scene.objects[CARD].parent == scene.camera and scene.seeing_wind.recovered_object.hide_render
    assert np.abs(render(tmp_path / "clip.png")[2:8, 80:94] - 60).max() < 12


def test_the_card_is_no_larger_than_all_that_the_outlines_reach(scene, workplace):
    composite.set_up(scene, samples=1)
    card = scene.objects[CARD]
    bpy.context.view_layer.update()
    seen = np.array([world_to_camera_view(scene, scene.camera, card.matrix_world @ vertex.co)[:2] for vertex in card.data.vertices])
    uv = np.array([corner.uv[:] for corner in card.data.uv_layers[0].data])
    np.testing.assert_allclose(seen, uv, atol=1e-4)
    masks = from_arrays(Masks, Take(workplace / "out.take").read_arrays("observation.npz"), "masks.")
    rows, columns = np.nonzero(np.any([masks[t] for t in range(len(masks))], axis=0))
    low, high = uv.min(axis=0) * (masks.width, masks.height), uv.max(axis=0) * (masks.width, masks.height)
    np.testing.assert_allclose(low, [columns.min() - MARGIN, masks.height - rows.max() - 1 - MARGIN], atol=1e-3)
    np.testing.assert_allclose(high, [columns.max() + 1 + MARGIN, masks.height - rows.min() + MARGIN], atol=1e-3)


def test_nothing_is_held_out_where_there_is_no_outline():
    assert not window_of(Masks.of(np.zeros((2, 8, 8), bool))).any()


def test_set_up_again_makes_nothing_twice(scene):
    red_cube(scene)
    bpy.ops.seeing_wind.insert_mesh(object="Cube")
    for _ in range(2):
        assert bpy.ops.seeing_wind.set_up_composite(floor=True, wall=True) == {"FINISHED"}
        scene.objects[FLOOR].location.z = -3.0
    assert len([obj for obj in scene.objects if obj.type == "LIGHT"]) == 1
    assert {obj.name for obj in scene.objects if obj.type == "MESH" and obj.is_shadow_catcher} == {FLOOR, WALL}
    assert scene.objects[FLOOR].location.z == -3.0
    tree = getattr(scene, "compositing_node_group", None) or scene.node_tree
    kinds = [node.bl_idname for node in tree.nodes if node.get("seeing_wind")]
    assert kinds.count("CompositorNodeMovieClip") == kinds.count("CompositorNodeRLayers") == 1
    assert len([obj for obj in scene.objects if obj.name.startswith(CARD)]) == 1


def test_two_scenes_of_a_file_keep_their_composites(scene, workplace):
    other = bpy.data.scenes.new("Other")
    with bpy.context.temp_override(scene=other, view_layer=other.view_layers[0]):
        recover(workplace, take=str(workplace / "other.take"))
    for _ in range(2):
        for each in (scene, other):
            composite.set_up(each, plate="PLATE", samples=1, floor=False)
            composite.set_up(each, plate="CLIP", samples=1)
    for each, take in ((scene, "out.take"), (other, "other.take")):
        (card,) = (obj for obj in each.objects if obj.name.startswith(CARD))
        (image,) = (node.image for node in card.data.materials[0].node_tree.nodes if node.type == "TEX_IMAGE")
        assert take in image.filepath
        assert len([obj for obj in each.objects if obj.type == "LIGHT"]) == 1
    assert len(bpy.data.images) == len({image.filepath or image.name for image in bpy.data.images})


def test_a_clip_or_a_take_that_is_gone_is_told(scene, tmp_path, workplace):
    bpy.ops.seeing_wind.set_up_composite(samples=1)
    bpy.ops.seeing_wind.insert_mesh(object=cube("Box").name)
    take = workplace / "out.take"
    take.rename(workplace / "away.take")
    try:
        former = scene.seeing_wind.composite_said
        for call in (lambda: bpy.ops.seeing_wind.set_up_composite(samples=2), bpy.ops.seeing_wind.resimulate):
            with pytest.raises(RuntimeError, match="There is no folder .*out.take. Put it beside the .blend file, or run Recover again"):
                call()
        assert is_set_up(scene) and scene.seeing_wind.composite_said == former
    finally:
        (workplace / "away.take").rename(take)
    assert not composite.set_up(scene, samples=1).warnings
    (workplace / "clip.mp4").rename(workplace / "away.mp4")
    try:
        with pytest.raises(RuntimeError, match="There is no file .*clip.mp4"):
            bpy.ops.seeing_wind.set_up_composite(samples=1)
        with pytest.raises(RuntimeError, match="There is no file .*clip.mp4"):
            bpy.ops.seeing_wind.render_composite(filepath=str(tmp_path / "none.png"), still=True)
    finally:
        (workplace / "away.mp4").rename(workplace / "clip.mp4")


def test_without_a_clip_it_is_refused(scene):
    scene.active_clip = None
    with pytest.raises(RuntimeError, match="no camera with a clip"):
        bpy.ops.seeing_wind.set_up_composite()


def test_calibrate_takes_the_active_object_and_reports(scene):
    bpy.ops.mesh.primitive_grid_add(size=0.5)
    obj = bpy.context.object
    with pytest.raises(RuntimeError, match="no physics"):
        bpy.ops.seeing_wind.calibrate()
    cloth = obj.modifiers.new("Cloth", "CLOTH")
    assert bpy.ops.seeing_wind.calibrate(density=200.0) == {"FINISHED"}
    weight = cloth.settings.effector_weights.texture
    assert bpy.ops.seeing_wind.calibrate(object=obj.name) == {"FINISHED"}
    # the recovered density is 700: a heavier sheet feels less
    assert cloth.settings.effector_weights.texture / weight == pytest.approx(200.0 / 700.0, rel=1e-5)
    with pytest.raises(RuntimeError, match="no object 'Nobody'"):
        bpy.ops.seeing_wind.calibrate(object="Nobody")
    bpy.data.objects.remove(scene.seeing_wind.field_object)
    with pytest.raises(RuntimeError, match="no recovered field"):
        bpy.ops.seeing_wind.calibrate(object=obj.name)


def test_the_legend_names_the_peak_and_shows_its_colours_in_solid_view(scene):
    legend = scene.objects["Recovered Wind Legend"]
    texts = [node.inputs["String"].default_value for node in legend.modifiers[0].node_group.nodes if node.type == "STRING_TO_CURVES"]
    assert f"{in_figures(scene.seeing_wind.arrows_object['seeing_wind_peak'])} N/m³" in texts and "0" in texts and len(texts) == 3
    mesh = legend.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    assert mesh.color_attributes.active_color_name == "wind_colour" and len(mesh.polygons) > 48


def test_no_dashed_line_goes_from_the_field_to_what_follows_it(scene):
    """Blender draws one from each visible child to its parent, unless both are at one place."""
    field, legend = scene.seeing_wind.field_object, scene.objects["Recovered Wind Legend"]
    bpy.context.view_layer.update()
    seen = [child for child in field.children if not child.hide_viewport]
    assert len(seen) == 2 and field.matrix_world.translation.length > 0.1
    for child in seen:
        assert (child.matrix_world.translation - field.matrix_world.translation).length < 1e-6
    sampled = read_samples(samples_of(field)).points + np.array(field.matrix_world.translation)
    places = {}
    for obj in (scene.seeing_wind.arrows_object, legend):
        mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        places[obj] = np.array([obj.matrix_world @ vertex.co for vertex in mesh.vertices])
    arrows, bar = places.values()
    size = np.ptp(sampled, axis=0).max()
    assert (arrows > sampled.min(axis=0) - size).all() and (arrows < sampled.max(axis=0) + size).all(), "and they stay where they were"
    assert bar[:, 0].max() < sampled[:, 0].min() + 0.05 * size, "to the left of it"


def test_reloading_the_results_leaves_one_of_each(scene):
    before = {obj.name for obj in scene.objects}
    assert bpy.ops.seeing_wind.build_scene() == {"FINISHED"}
    assert {obj.name for obj in scene.objects} == before
    settings = scene.seeing_wind
    assert samples_of(settings.field_object) is not None and settings.arrows_object.parent == settings.field_object


@pytest.mark.skipif(bpy.app.version >= (5, 0, 0), reason="there the compositor cannot be switched off with nodes in it")
def test_nodes_of_a_compositor_that_was_switched_off_stay(scene):
    scene.use_nodes = True
    scene.node_tree.nodes.new("CompositorNodeBlur").name = "Mine"
    scene.use_nodes = False
    composite.set_up(scene)
    assert "Mine" in scene.node_tree.nodes and is_set_up(scene)


def test_footage_is_never_rendered_over(scene, tmp_path):
    footage = Path(absolute(scene.active_clip.filepath))
    before = footage.read_bytes()
    with pytest.raises(RuntimeError, match="is footage that this file shows"):
        bpy.ops.seeing_wind.render_composite(filepath=str(footage))
    assert footage.read_bytes() == before
    # the composite of one shot as the clip of the next
    own = takes.shown(scene.seeing_wind).with_name("composite.png")
    bpy.data.images.new("made", 8, 8).save(filepath=str(own))
    before, shown = own.read_bytes(), bpy.data.images.load(str(own))
    shown.use_fake_user = True
    assert bpy.ops.seeing_wind.render_composite(still=True) == {"FINISHED"}
    assert own.read_bytes() == before and own.with_name("composite_2.png").is_file()


def test_render_looks_as_the_panel_says(scene, tmp_path):
    assert bpy.ops.seeing_wind.set_up_composite(samples=1, shutter=0.5) == {"FINISHED"}
    scene.seeing_wind.composite.shutter = 0.0
    bpy.ops.seeing_wind.render_composite(filepath=str(tmp_path / "a.png"), still=True)
    assert not scene.render.use_motion_blur and scene.cycles.samples == 1
    # what the user has changed since by hand stays, as long as the panel says the same
    scene.cycles.samples = 2
    bpy.ops.seeing_wind.render_composite(filepath=str(tmp_path / "b.png"), still=True)
    assert scene.cycles.samples == 2


def test_a_scene_of_another_shape_than_the_clip_is_told(scene):
    assert "squeezed" not in str(composite.set_up(scene, samples=1))
    scene.render.resolution_x = scene.render.resolution_y = 500
    assert "squeezed into a frame of another shape: set the resolution to 96 x 64" in str(composite.set_up(scene, samples=1))


def test_a_scene_that_looks_through_no_camera_is_told(scene):
    scene.camera = bpy.data.objects.new("Empty", None)
    with pytest.raises(RuntimeError, match="looks through Empty, which is no camera"):
        bpy.ops.seeing_wind.set_up_composite()


def test_a_frame_that_cannot_be_written_is_told(scene, tmp_path):
    (tmp_path / "x.png").mkdir()
    with pytest.raises(RuntimeError, match="could not render") as raised:
        bpy.ops.seeing_wind.render_composite(filepath=str(tmp_path / "x.png"), still=True)
    assert "Traceback" not in str(raised.value)


def test_the_first_look_after_recover(workplace):
    """Nothing of a new file stands in front, and Solid view has the object's and the arrows' colors."""
    bpy.ops.wm.read_factory_settings(use_empty=False)
    scene = bpy.context.scene
    recover(workplace)
    cube = scene.objects["Cube"]
    assert cube.hide_get() and cube.hide_render and any("Alt H" in text for text in notes_of(scene))
    mesh = scene.seeing_wind.recovered_object.data
    assert mesh.color_attributes.active_color_name == FRAME_COLOUR
    # the stand-in's frame is a grey of 90
    assert np.allclose([value.color[0] for value in mesh.attributes[FRAME_COLOUR].data], ((90 / 255 + 0.055) / 1.055) ** 2.4, atol=1e-3)
    cube.hide_set(False)
    cube.location.x = 3.0
    bpy.ops.seeing_wind.build_scene()
    assert not cube.hide_get(), "moved, it is the user's"


@pytest.mark.parametrize(("depth", "hidden"), [(1.0, True), (-1.0, False)])
def test_what_flies_behind_the_object_is_cut_by_its_outline_and_what_flies_in_front_is_not(scene, tmp_path, depth, hidden):
    """A glowing board that fills the frame, behind and before the object's distance."""
    red_cube(scene)
    board = bpy.context.object
    board.location, board.scale = (0.0, depth, 0.0), (40.0, 0.01, 40.0)
    scene.frame_set(5)
    said = composite.set_up(scene, samples=1, shutter=0.0, grain=0.0)
    assert said.held_out == "outline"
    frame = render(tmp_path / "board.png")
    mask = np.zeros(frame.shape[:2], bool)
    mask[20:44, 28:52] = True  # frame 4 of the clip
    red = (frame[..., 0] > frame[..., 1] + 80)
    assert red[~widened(mask, 2)].all()
    assert not red[~widened(~mask, 2)].any() if hidden else red[mask].all()


def test_a_wall_catches_the_shadow_of_the_edit(scene, tmp_path):
    """The sun from behind the camera: the clip is darker on the wall behind a board than without a wall."""
    bpy.ops.mesh.primitive_cube_add(size=0.3, location=(-0.4, 0.0, 0.3))
    bpy.ops.seeing_wind.insert_mesh(object="Cube")
    shades = {}
    for wall in (False, True):
        assert bpy.ops.seeing_wind.set_up_composite(samples=4, wall=wall, shutter=0.0) == {"FINISHED"}
        scene.objects["Seeing Wind Sun"].rotation_euler = (np.radians(70.0), 0.0, np.radians(-25.0))
        shades[wall] = render(tmp_path / f"{wall}.png")[:, :, 1]
    darker = shades[False].astype(int) - shades[True]
    assert (darker > 15).sum() > 20 and abs(np.median(darker)) < 3
    wall = scene.objects[WALL]
    assert not (wall.visible_diffuse or wall.visible_glossy), "white as it is, it would light the edit"
    assert wall.location.y > 0.1 and abs((wall.matrix_world.to_3x3().col[2]).y) > 0.99


def test_obstacles_of_the_edit_catch_shadows(scene):
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=(0.0, 2.0, 0.0))
    bpy.context.object.name = "House"
    bpy.ops.seeing_wind.insert_collider(object="House")
    said = composite.set_up(scene)
    assert scene.objects["House"].is_shadow_catcher and "shadows on House" in str(said)


def test_mattes_are_as_wide_and_as_soft_as_they_say():
    mask = np.zeros((20, 30), bool)
    mask[8:12, 10:20] = True
    assert np.array_equal(np.argwhere(widened(mask, 3))[[0, -1]], [[5, 7], [14, 22]]) and widened(mask, 3).sum() == 10 * 16
    both = matte(mask)
    assert np.array_equal(both[..., 0], softened(narrowed(mask), 1)) and np.array_equal(both[..., 1], softened(widened(mask, 2), 2))
    assert not matte(np.zeros((4, 5), bool)).any()
    mask[14:16, :] = True
    assert narrowed(mask)[8:12, 10:20].sum() == 2 * 8 and narrowed(mask)[14:16].all(), "a stem stays"
    soft = softened(mask, 1)
    assert soft[10, 15] == 255 and soft[7, 15] == 64 and soft[5, 15] == 0


def test_in_solid_view_the_rim_of_the_object_wears_no_pixel_from_behind_it(scene):
    """A red square on green, its outline known: no vertex is green, nor a mixture, though the mesh reaches beyond."""
    frame = np.full((40, 40, 3), (0, 255, 0), np.uint8)
    frame[10:30, 10:30] = (255, 0, 0)
    outline = frame[..., 0] > 0
    side = np.linspace(0.2, 0.8, 13)
    uv = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    place = np.column_stack([uv, np.zeros(len(uv))])
    for known, green in ((outline, 0.0), (None, 1.0)):
        obj = create_recovered_object(scene, "Square", place, np.array([[0, 1, 13]]), uv, frame, outline=known)
        colours = np.array([each.color[:3] for each in obj.data.attributes[FRAME_COLOUR].data])
        assert colours[:, 1].max() == pytest.approx(green)


def test_a_camera_that_is_not_where_the_clip_s_was_is_told(scene, capfd):
    ours = scene.camera
    assert composite.set_up(scene, samples=1).astray == ""
    own = bpy.data.objects.new("Own", ours.data.copy())
    scene.collection.objects.link(own)
    own.matrix_world, scene.camera = ours.matrix_world, own
    bpy.context.view_layer.update()
    assert composite.set_up(scene, samples=1).astray == "", "a solve's camera may stand in the same place"
    own.location.x += 0.1
    bpy.context.view_layer.update()
    assert bpy.ops.seeing_wind.set_up_composite(samples=1) == {"FINISHED"}
    assert "Warning: Own is not where the clip's camera was" in capfd.readouterr().out
    own.location.x -= 0.1
    own.data.lens *= 1.5
    bpy.context.view_layer.update()
    assert "make Seeing Wind Camera the active camera" in composite.set_up(scene, samples=1).astray


def test_engine_and_colors_change_only_where_the_panel_says_so(scene, capfd):
    eevee = next(item.identifier for item in scene.render.bl_rna.properties["engine"].enum_items if "EEVEE" in item.identifier)
    scene.render.engine, scene.view_settings.view_transform = eevee, "AgX"
    scene.render.film_transparent, look = False, scene.seeing_wind.composite
    scene.cycles.property_unset("samples")
    assert [words for *_, words in changes(scene, True, True, 32)] == [
        "render engine from EEVEE to Cycles", "samples from 4096 to 32", "film to transparent", "view transform from AgX to Standard",
    ]  # fmt: skip
    look.use_cycles = look.use_standard = False
    assert bpy.ops.seeing_wind.set_up_composite() == {"FINISHED"}
    said = capfd.readouterr().out
    assert (scene.render.engine, scene.view_settings.view_transform) == (eevee, "AgX") and scene.cycles.samples == 4096
    assert scene.seeing_wind.composite_said.endswith(". Changed: film to transparent")
    assert "Warning: EEVEE catches no shadows: tick Use Cycles" in said
    assert "Warning: The view transform AgX changes the clip's colors, too: tick Standard View" in said
    assert bpy.ops.seeing_wind.set_up_composite(use_cycles=True, use_standard=True) == {"FINISHED"}
    assert (scene.render.engine, scene.view_settings.view_transform) == ("CYCLES", "Standard")
    told = ". Changed: render engine from EEVEE to Cycles, samples from 4096 to 32, view transform from AgX to Standard"
    assert scene.seeing_wind.composite_said.endswith(told) and not changes(scene, True, True, 32)


def test_stereoscopy_is_refused(scene, tmp_path):
    bpy.ops.seeing_wind.set_up_composite(samples=1)
    scene.render.use_multiview = True
    for still in (False, True):
        with pytest.raises(RuntimeError, match=r"Stereoscopy is on.*Switch it off \(Properties > Output\)"):
            bpy.ops.seeing_wind.render_composite(filepath=str(tmp_path / "over.png"), still=still)
    assert not list(tmp_path.iterdir())
