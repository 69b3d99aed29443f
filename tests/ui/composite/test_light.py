"""Sun and sky as the clip has them."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from seeing_wind.ui.clip.clip_scene import PICTURE_COLOUR
from seeing_wind.ui.composite import composite
from seeing_wind.ui.composite.light import SKY, light_of, sun_of
from tests.ui.jobs import recover


def test_blenders_default_light_counts_as_none_and_motion_is_blurred(workplace):
    bpy.ops.wm.read_factory_settings(use_empty=False)
    scene = bpy.context.scene
    recover(workplace)
    said = composite.set_up(scene)
    assert scene.objects["Light"].hide_render and scene.objects["Seeing Wind Sun"].data.type == "SUN"
    assert "default light is off" in str(said)
    assert scene.world.name == "Seeing Wind Sky", "in the dark grey of a new file shadows are black"
    assert scene.render.use_motion_blur and scene.render.motion_blur_shutter == 0.5 and "motion blur" in str(said)
    assert composite.set_up(scene, shutter=0.0).light == "" and not scene.render.use_motion_blur
    own = bpy.data.objects.new("Key", bpy.data.lights.new("Key", "AREA"))
    scene.collection.objects.link(own)
    bpy.data.objects.remove(scene.objects["Seeing Wind Sun"])
    assert composite.set_up(scene).light == "", "a light of the user's is enough"


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
        attribute = ball.data.attributes.get(PICTURE_COLOUR) or ball.data.attributes.new(PICTURE_COLOUR, "FLOAT_COLOR", "POINT")
        attribute.data.foreach_set("color", np.repeat(values[:, None], 4, axis=1).astype(np.float32).ravel())

    paint(shaded(normals, way) * rng.uniform(0.8, 1.2, len(normals)))
    found, ratio = sun_of(ball)
    assert np.degrees(np.arccos(np.clip(np.array(found) @ way, -1.0, 1.0))) < 20.0 and front.any()
    assert ratio == pytest.approx(0.6 / 0.25, rel=0.25), "the light of the sun over that of the sky"
    paint(rng.uniform(0.1, 1.0, len(normals)))
    assert sun_of(ball) is None and sun_of(None) is None


def test_sun_and_sky_light_a_white_card_white_and_are_as_bright_as_the_clips_surroundings(scene):
    """A blue sky over a brown ground: a white wall between them, turned to the sun, is neutral and brighter than the sky alone makes it."""
    picture = np.zeros((9, 4, 3), np.uint8)
    picture[:3], picture[3:6], picture[6:] = (120, 160, 220), (128, 128, 128), (110, 90, 60)
    light = light_of(picture, 2.0)
    assert light.above[2] > 1.5 * light.above[0] and light.below[0] > light.below[2]
    assert light.colour[0] > 1.0 > light.colour[2] and light.colour.mean() == pytest.approx(1.0)
    around = 0.5 * (light.above + light.below)
    card = around + light.energy / np.pi * light.colour
    assert np.ptp(card) < 0.06 * card.mean() and card.mean() > 2.5 * around.mean()
    assert "sky of the clip" in composite.set_up(scene).light and scene.world.name.startswith(SKY)
