"""What a render over the clip leaves of the scene's own output, and what of its colors the composite needs otherwise."""

from __future__ import annotations

import bpy
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.ui.composite import composite
from seeing_wind.ui.composite.own import changes, samples_for
from tests.ui.composite.rendering import render


def _output(scene) -> dict:
    """All that can be set of it."""
    owners = (scene.render.image_settings, scene.render.ffmpeg)
    found = {f"{owner} {each.identifier}": getattr(owner, each.identifier)
             for owner in owners for each in owner.bl_rna.properties if not each.is_readonly}  # fmt: skip
    names = ("filepath", "use_file_extension", "use_compositing", "use_sequencer", "use_overwrite", "use_placeholder")
    return found | {name: getattr(scene.render, name) for name in names}


@pytest.mark.parametrize("still", (True, False))
def test_a_render_gives_the_scene_its_own_output_back(scene, tmp_path, still):
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGBA", "32"
    image.color_management = "OVERRIDE"
    scene.render.filepath, scene.render.use_compositing, scene.frame_end = "//own/shot_####", False, 2
    assert bpy.ops.seeing_wind.set_up_composite(samples=1) == {"FINISHED"}
    before = _output(scene)
    path = tmp_path / ("over.png" if still else "over.mp4")
    assert bpy.ops.seeing_wind.render_composite(filepath=str(path), still=still) == {"FINISHED"} and path.is_file()
    assert _output(scene) == before


@pytest.mark.parametrize("behind", ["CLIP", "PLATE"])
def test_mattes_that_are_gone_are_made_again_or_told(scene, tmp_path, workplace, behind):
    """Blender renders nothing in the place of a missing image, and says that all is well."""
    take, path = workplace / "out.take", tmp_path / "x.png"
    assert bpy.ops.seeing_wind.set_up_composite(samples=1, behind=behind) == {"FINISHED"}
    scene.cycles.use_denoising = False
    (take / "mattes" / "matte_0003.png").unlink()
    with pytest.raises(UsageError, match="There is no file .*matte_0003.png, which cuts the edit. Put the take back"):
        composite.render(scene, path, still=True)
    assert bpy.ops.seeing_wind.render_composite(filepath=str(path), still=True) == {"FINISHED"} and path.is_file()
    assert (take / "mattes" / "matte_0003.png").is_file()
    path.unlink()
    take.rename(tmp_path / "away.take")
    try:
        with pytest.raises(RuntimeError, match="There is no folder .*out.take. Put it beside"):
            bpy.ops.seeing_wind.render_composite(filepath=str(path), still=True)
        assert not path.exists()
    finally:
        (tmp_path / "away.take").rename(take)


def test_a_video_of_the_users_own_stays_as_it_was_set(scene, tmp_path):
    image, ffmpeg = scene.render.image_settings, scene.render.ffmpeg
    if hasattr(image, "media_type"):
        image.media_type = "VIDEO"
    image.file_format, ffmpeg.format, ffmpeg.codec = "FFMPEG", "QUICKTIME", "PRORES"
    assert bpy.ops.seeing_wind.set_up_composite(samples=1) == {"FINISHED"}
    before = _output(scene)
    with pytest.raises(RuntimeError):
        bpy.ops.seeing_wind.render_composite(filepath="/proc/over.png", still=True)
    assert _output(scene) == before, "also when it could not be written"
    assert bpy.ops.seeing_wind.render_composite(filepath=str(tmp_path / "over.png"), still=True) == {"FINISHED"}
    assert _output(scene) == before


def test_exposure_and_look_would_change_the_clip_too(scene):
    view = scene.view_settings
    view.view_transform = "Standard"
    view.look, view.exposure, view.gamma, view.use_curve_mapping = "High Contrast", 1.0, 1.2, True
    kept = composite.set_up(scene, samples=1, use_standard=False)
    assert view.exposure == 1.0
    assert "The look High Contrast changes the clip's colors, too: tick Standard View." in kept.warnings
    assert "The view exposure 1 changes the clip's colors, too: tick Standard View." in kept.warnings
    assert [words for *_, words in changes(scene, True, True, 1)][-4:] == [
        "look from High Contrast to None", "view exposure from 1 to 0", "view gamma from 1.2 to 1", "use of curves off",
    ]  # fmt: skip
    assert not [each for each in composite.set_up(scene, samples=1).warnings if "colors" in each]
    assert (view.look, view.exposure, view.gamma, view.use_curve_mapping) == ("None", 0.0, 1.0, False)


def test_nodes_that_the_user_puts_behind_ours_stay_there(scene, tmp_path):
    composite.set_up(scene, samples=1)
    tree = getattr(scene, "compositing_node_group", None) or scene.node_tree
    output = next(node for node in tree.nodes if node.bl_idname in ("NodeGroupOutput", "CompositorNodeComposite"))
    darker, viewer = tree.nodes.new("CompositorNodeExposure"), tree.nodes.new("CompositorNodeViewer")
    darker.inputs["Exposure"].default_value = -20.0
    tree.links.new(output.inputs[0].links[0].from_socket, darker.inputs[0])
    tree.links.new(output.inputs[0].links[0].from_socket, viewer.inputs[0])
    tree.links.new(darker.outputs[0], output.inputs[0])
    composite.set_up(scene, samples=1, grain=0.0)
    assert render(tmp_path / "dark.png").max() < 4, "the exposure acts on the new composite"
    assert viewer.inputs[0].links[0].from_socket == darker.inputs[0].links[0].from_socket
    tree.nodes.remove(darker)
    composite.set_up(scene, samples=1)
    assert render(tmp_path / "bright.png").max() > 100, "without them ours is the output"


def test_samples_of_the_artist_s_own_stay(scene):
    """They change at the first set-up of a scene that has none, and whenever other ones are asked for."""
    look, ops, cycles = scene.seeing_wind.composite, bpy.ops.seeing_wind, scene.cycles
    assert ops.set_up_composite() == {"FINISHED"} and cycles.samples == look.samples == 32
    cycles.samples = 256
    assert samples_for(scene) is None and ops.set_up_composite(floor=True) == {"FINISHED"} and cycles.samples == 256
    look.samples = 64
    assert ops.set_up_composite() == {"FINISHED"} and cycles.samples == 64
    cycles.samples = 256
    assert ops.set_up_composite(samples=64) == {"FINISHED"} and cycles.samples == 64, "asked for by name"


@pytest.mark.parametrize("samples", [256, 4096])
def test_samples_that_were_chosen_before_the_first_set_up_stay(scene, samples):
    """Also as many as Blender itself would take."""
    scene.cycles.samples = samples
    assert bpy.ops.seeing_wind.set_up_composite() == {"FINISHED"} and scene.cycles.samples == samples
    assert "samples" not in scene.seeing_wind.composite_said
