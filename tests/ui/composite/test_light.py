"""Sun and sky as the clip has them."""

from __future__ import annotations

import shutil

import bpy
import numpy as np
import pytest

from seeing_wind.engine.take import Take
from seeing_wind.ui.clip.clip_scene import FRAME_COLOUR
from seeing_wind.ui.composite import composite
from seeing_wind.ui.composite.light import BANDS, SKY, SUN, bands_of, light_of, linear, set_light, sun_of
from seeing_wind.ui.job import takes
from tests.ui.jobs import recover


def test_blenders_default_light_counts_as_none_and_motion_is_blurred(workplace):
    bpy.ops.wm.read_factory_settings(use_empty=False)
    scene = bpy.context.scene
    recover(workplace)
    said = composite.set_up(scene)
    assert scene.objects["Light"].hide_render and scene.objects["Seeing Wind Sun"].data.type == "SUN"
    assert "default light is off" in str(said)
    assert scene.world.name == SKY and "sky of the clip" in str(said), "in the dark grey of a new file shadows are black"
    assert scene.render.use_motion_blur and scene.render.motion_blur_shutter == 0.5 and "motion blur" in str(said)
    assert composite.set_up(scene, shutter=0.0).light == said.light and not scene.render.use_motion_blur
    own = bpy.data.objects.new("Key", bpy.data.lights.new("Key", "AREA"))
    scene.collection.objects.link(own)
    bpy.data.objects.remove(scene.objects["Seeing Wind Sun"])
    assert composite.set_up(scene).light == "", "a light of the user's is enough"


def relit(scene, brightness: int, way: tuple[float, float, float]) -> str:
    """What is set up over surroundings that bright, for an object that is brightest where it faces a way, as of another take."""
    take = Take(takes.shown(scene.seeing_wind))
    arrays = take.read_arrays("observation.npz")
    take.write_arrays("observation.npz", {**arrays, "background": np.full_like(arrays["background"], brightness)})
    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=16)
    ball = scene.seeing_wind.recovered_object = bpy.context.object
    values = shaded(np.array([vertex.normal[:] for vertex in ball.data.vertices]), np.array(way) / np.linalg.norm(way))
    colours = ball.data.attributes.new(FRAME_COLOUR, "FLOAT_COLOR", "POINT")
    colours.data.foreach_set("color", np.repeat(values[:, None], 4, axis=1).astype(np.float32).ravel())
    return composite.set_up(scene, samples=1).light


def towards(sun: bpy.types.Object) -> np.ndarray:
    return np.array(sun.rotation_euler.to_matrix().col[2])


def test_sun_and_sky_follow_the_take_until_the_user_changes_them(scene):
    left, right = (-0.7, -0.5, 0.5), (0.7, -0.5, 0.5)
    assert "brightest" in relit(scene, 200, left)
    sun, sky, energy = scene.objects[SUN], scene.world, scene.objects[SUN].data.energy
    assert towards(sun) @ left > 0.8
    relit(scene, 90, right)
    assert scene.objects[SUN] == sun and towards(sun) @ right > 0.8 and sun.data.energy < 0.5 * energy
    assert len([each for each in bpy.data.lights if each.users]) == 1 and scene.world.name == SKY and len(bpy.data.worlds) == 1
    # by hand: the lamp alone, then the sky alone
    sun.rotation_euler.z += 0.2
    turned = towards(sun)
    assert "as you have set it" in relit(scene, 200, left)
    assert np.allclose(towards(sun), turned) and scene.world.name == SKY
    bpy.data.objects.remove(sun)
    scene.world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.3
    sky = scene.world
    assert "brightest" in relit(scene, 90, right)
    assert scene.world == sky and towards(scene.objects[SUN]) @ right > 0.8


def test_a_sun_that_the_user_hides_stays_hidden(scene):
    composite.set_up(scene, samples=1)
    sun = scene.objects[SUN]
    sun.hide_render = True
    scene.collection.objects.link(bpy.data.objects.new("Key", bpy.data.lights.new("Key", "AREA")))
    said = composite.set_up(scene, samples=1).light
    assert sun.hide_render and "as you have set it" in said


def test_render_sets_up_again_after_another_take_was_loaded(scene, workplace, tmp_path):
    bpy.ops.seeing_wind.set_up_composite(samples=1)
    scene.render.film_transparent = False
    take = takes.shown(scene.seeing_wind)
    other = take.with_name("other.take")
    shutil.copytree(take, other)
    bpy.ops.seeing_wind.build_scene(take=str(other))
    bpy.ops.seeing_wind.render_composite(filepath=str(tmp_path / "a.png"), still=True)
    assert scene.render.film_transparent


def shaded(normals: np.ndarray, way: np.ndarray) -> np.ndarray:
    return 0.25 + 0.6 * np.maximum(normals @ way, 0.0)


@pytest.mark.parametrize("way", [(0.6, -0.5, 0.6), (-0.7, -0.6, 0.4), (0.0, -0.3, 0.95)])
def test_the_sun_stands_where_a_matt_object_is_brightest(scene, way):
    """A ball under a light that is known, with a pattern on it; and a pattern alone, which tells nothing."""
    way = np.array(way) / np.linalg.norm(way)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=16)
    ball = bpy.context.object
    normals = np.array([vertex.normal[:] for vertex in ball.data.vertices])
    front = normals[:, 1] < 0.2
    rng = np.random.default_rng(0)

    def paint(values: np.ndarray) -> None:
        attribute = ball.data.attributes.get(FRAME_COLOUR) or ball.data.attributes.new(FRAME_COLOUR, "FLOAT_COLOR", "POINT")
        attribute.data.foreach_set("color", np.repeat(values[:, None], 4, axis=1).astype(np.float32).ravel())

    paint(shaded(normals, way) * rng.uniform(0.8, 1.2, len(normals)))
    found, ratio = sun_of(ball)
    assert np.degrees(np.arccos(np.clip(np.array(found) @ way, -1.0, 1.0))) < 20.0 and front.any()
    assert ratio == pytest.approx(0.6 / 0.25, rel=0.25), "the light of the sun over that of the sky"
    paint(rng.uniform(0.1, 1.0, len(normals)))
    assert sun_of(ball) is None and sun_of(None) is None


def test_sun_and_sky_light_a_white_card_white_and_are_as_bright_as_the_clips_surroundings(scene):
    """A blue sky over a brown ground: a white wall between them, turned to the sun, is neutral and brighter than the sky alone makes it."""
    frame = np.zeros((8, 4, 3), np.uint8)
    frame[:4], frame[4:] = (120, 160, 220), (110, 90, 60)
    light = light_of(frame, np.linspace(0.21, -0.21, 8), 2.0)
    below, above = light.around[0], light.around[-1]
    assert above[2] > 1.5 * above[0] and below[0] > below[2] and light.heights[0] == -0.21
    assert light.colour[0] > 1.0 > light.colour[2] and light.colour.mean() == pytest.approx(1.0)
    around = 0.5 * (above + below)
    card = around + light.energy / np.pi * light.colour
    assert np.ptp(card) < 0.06 * card.mean() and card.mean() > 2.5 * around.mean()


def test_what_the_camera_sees_at_an_elevation_lights_from_there(workplace):
    """A camera that looks 30 degrees up, and one that lies on its side; the sky of the world has the frame's rows at their elevations."""
    scene = bpy.context.scene
    recover(workplace)
    half = np.degrees(scene.camera.data.angle_y) / 2
    scene.camera.rotation_mode = "XYZ"
    scene.camera.rotation_euler = (np.radians(120.0), 0.0, 0.3)
    bpy.context.view_layer.update()
    seen = np.degrees(np.arcsin(bands_of(scene, 64)))
    assert np.all(np.diff(seen) < 0.0) and seen[[0, -1]] == pytest.approx([30.0 + half, 30.0 - half], abs=half / 30.0)
    scene.camera.rotation_euler = (np.radians(90.0), np.radians(90.0), 0.0)
    bpy.context.view_layer.update()
    assert bands_of(scene, 5) == pytest.approx(np.zeros(5), abs=1e-6)
    scene.camera.rotation_euler = (np.radians(90.0), 0.0, 0.0)
    bpy.context.view_layer.update()
    rows = np.repeat(np.linspace(250, 20, 60).astype(np.uint8)[:, None, None], 3, axis=2)
    set_light(scene, rows, None)
    ramp = next(node for node in scene.world.node_tree.nodes if node.type == "VALTORGB").color_ramp
    assert len(ramp.elements) == BANDS
    for z, row in ((0.999, 3), (-0.999, 56), (0.0, 29)):
        assert ramp.evaluate(0.5 * (z + 1.0))[0] == pytest.approx(linear(rows[row, 0, 0]), abs=0.08)
