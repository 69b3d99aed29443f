"""A panorama of the user's lights the edit in place of the clip's sun and sky, and is taken off again."""

from __future__ import annotations

import math
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.ui.composite.composite import set_up
from seeing_wind.ui.composite.hdri import WORLD
from seeing_wind.ui.composite.light import SKY, SUN
from tests.ui.composite.rendering import render


@pytest.fixture
def panorama(tmp_path) -> Path:
    """Dark but for a red patch in its middle, twenty times as bright as a screen's white."""
    pixels = np.full((32, 64, 4), (0.02, 0.02, 0.02, 1.0), np.float32)
    pixels[12:20, 28:36] = (20.0, 0.5, 0.5, 1.0)
    image = bpy.data.images.new("made", 64, 32, float_buffer=True, is_data=True)
    image.pixels.foreach_set(pixels.ravel())
    image.filepath_raw, image.file_format = str(tmp_path / "field è.hdr"), "HDR"
    image.save()
    bpy.data.images.remove(image)
    return tmp_path / "field è.hdr"


def lit(path: Path) -> np.ndarray:
    """(2, 3) mean colours of the left and the right side of a ball before the camera."""
    frame = render(path)
    height, width = frame.shape[:2]
    rows = frame[height // 2 - 3 : height // 2 + 3]
    return np.array([rows[:, width // 2 + at : width // 2 + at + 4].mean(axis=(0, 1)) for at in (-9, 5)])


def test_the_panorama_lights_the_edit_from_where_it_is_turned(scene, tmp_path, panorama) -> None:
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.25, location=(0.0, -0.3, 0.0), segments=48, ring_count=24)
    bpy.ops.object.shade_smooth()
    settings, sides = scene.seeing_wind, {}
    settings.hdri = str(panorama)
    for turn in (0.0, 180.0):
        settings.hdri_turn = math.radians(turn)
        assert "the light of field è.hdr" in str(set_up(scene, samples=32, shutter=0.0, grain=0.0))
        sides[turn] = lit(tmp_path / f"{turn:g}.png")
    for turn, bright in ((0.0, 1), (180.0, 0)):
        red, dim = sides[turn][bright], sides[turn][1 - bright]
        assert red[0] > 2.0 * max(dim[0], 10.0) and red[0] > red[1] + 60.0, (turn, sides)
    settings.hdri_strength = 0.0
    assert bpy.ops.seeing_wind.set_up_composite(samples=4, shutter=0.0, grain=0.0) == {"FINISHED"}
    assert lit(tmp_path / "dark.png").max() < 10.0
    assert SUN not in scene.objects or scene.objects[SUN].hide_render


def test_what_was_there_comes_back_without_it(scene, panorama) -> None:
    mine = scene.world = bpy.data.worlds.new("Mine")
    ops = bpy.ops.seeing_wind
    assert ops.set_up_composite(hdri=str(panorama)) == {"FINISHED"} and scene.world.name == WORLD
    assert ops.set_up_composite() == {"FINISHED"} and scene.world.name == WORLD and len(bpy.data.worlds) == 2, "it stays with the scene"
    assert ops.set_up_composite(hdri="") == {"FINISHED"} and scene.world == mine and len(bpy.data.worlds) == 1
    bpy.data.worlds.remove(mine)
    scene.world = None
    bpy.data.objects.remove(scene.objects[SUN])
    assert ops.set_up_composite() == {"FINISHED"} and scene.world.name == SKY and not scene.objects[SUN].hide_render
    sky = scene.world
    assert ops.set_up_composite(hdri=str(panorama)) == {"FINISHED"} and scene.objects[SUN].hide_render
    assert ops.set_up_composite(hdri="") == {"FINISHED"} and scene.world == sky and not scene.objects[SUN].hide_render


def test_a_world_that_was_taken_apart_is_made_anew(scene, panorama) -> None:
    scene.seeing_wind.hdri = str(panorama)
    set_up(scene, samples=1)
    nodes = scene.world.node_tree.nodes
    nodes.remove(next(node for node in nodes if node.bl_idname == "ShaderNodeMapping"))
    set_up(scene, samples=1)
    assert "ShaderNodeMapping" in {node.bl_idname for node in scene.world.node_tree.nodes}


def test_what_is_no_panorama_is_refused_and_the_light_stays(scene, tmp_path, panorama) -> None:
    (tmp_path / "text.hdr").write_text("no light")
    image = bpy.data.images.new("flat", 8, 4)
    image.filepath_raw, image.file_format = str(tmp_path / "flat.png"), "PNG"
    image.save()
    bpy.data.images.remove(image)
    assert bpy.ops.seeing_wind.set_up_composite() == {"FINISHED"}
    world, images = scene.world, len(bpy.data.images)
    for name, says in (("gone.exr", "no file"), ("text.hdr", "(?i)cannot open|is no image"), ("flat.png", "no more range")):
        with pytest.raises(RuntimeError, match=says):
            bpy.ops.seeing_wind.set_up_composite(hdri=str(tmp_path / name))
        assert scene.world == world and len(bpy.data.images) == images
        assert scene.seeing_wind.hdri == "", "so that the next time is not refused for it"


def test_a_panorama_that_is_gone_is_told_before_the_render(scene, tmp_path, panorama) -> None:
    """Blender would light the edit in magenta, and say that all is well."""
    assert bpy.ops.seeing_wind.set_up_composite(samples=1, hdri=str(panorama)) == {"FINISHED"}
    panorama.unlink()
    path = tmp_path / "x.png"
    with pytest.raises(RuntimeError, match="There is no file .*field è.hdr, which lights the scene. Put it back"):
        bpy.ops.seeing_wind.render_composite(filepath=str(path), still=True)
    assert not path.exists()


def test_the_look_stays_with_the_scene(scene, tmp_path) -> None:
    look, ops = scene.seeing_wind.composite, bpy.ops.seeing_wind
    assert ops.set_up_composite(samples=3, shutter=0.0) == {"FINISHED"}
    assert (look.samples, look.shutter) == (3, 0.0) and scene.seeing_wind.composite_said.startswith("Composite over")
    look.show_field = True
    assert ops.set_up_composite() == {"FINISHED"}
    assert scene.cycles.samples == 3 and not scene.render.use_motion_blur and not scene.seeing_wind.arrows_object.hide_render
    with pytest.raises(RuntimeError, match="none.hdr"):
        ops.set_up_composite(samples=7, hdri=str(tmp_path / "none.hdr"))
    assert look.samples == 3, "what was refused is not kept"
