"""What a composite is put together from: all that is missing is told at once, and all that changes of the user's camera."""

from __future__ import annotations

import re
import shutil

import bpy
import pytest

from seeing_wind.ui.composite.composite import set_up
from seeing_wind.ui.composite.own import camera_changes
from seeing_wind.ui.composite.panel import CompositeTab
from seeing_wind.ui.job import takes
from tests.ui.drawn import Drawn


def said_by(call) -> str:
    """What a refused operator says."""
    with pytest.raises(RuntimeError) as raised:
        call()
    return str(raised.value)


def test_all_that_is_missing_is_told_at_once_and_nothing_is_changed(scene, tmp_path) -> None:
    ops, before = bpy.ops.seeing_wind, scene.render.engine
    away = tmp_path / "away.mp4"
    scene.active_clip.filepath = str(away)
    scene.seeing_wind.recovered_take = str(tmp_path / "away.take")
    said = said_by(lambda: ops.set_up_composite(hdri=str(tmp_path / "gone.hdr"), fstop=2.0))
    for each in ("away.mp4. Put it back", "no folder .*away.take. Put it", "gone.hdr. Choose a panorama"):
        assert re.search(each, said), (each, said)
    assert scene.render.engine == before != "CYCLES" and scene.seeing_wind.hdri == ""


def test_a_plate_and_a_focus_that_are_not_there_are_told_together(scene) -> None:
    (takes.shown(scene.seeing_wind) / "observation.npz").unlink()
    said = said_by(lambda: bpy.ops.seeing_wind.set_up_composite(behind="PLATE", fstop=2.0))
    assert "There is no clean plate" in said and "There is no object to focus on" in said
    assert said_by(lambda: bpy.ops.seeing_wind.set_up_composite(behind="PLATE")).count("There is no") == 1


def test_a_render_tells_of_missing_mattes_and_panorama_at_once(scene, tmp_path) -> None:
    image = bpy.data.images.new("made", 8, 4, float_buffer=True)
    image.filepath_raw, image.file_format = str(tmp_path / "sky.hdr"), "HDR"
    image.save()
    bpy.data.images.remove(image)
    scene.seeing_wind.hdri = str(tmp_path / "sky.hdr")
    set_up(scene, samples=1)
    (tmp_path / "sky.hdr").unlink()
    shutil.rmtree(takes.shown(scene.seeing_wind) / "mattes")
    scene.render.use_multiview = True
    said = said_by(lambda: bpy.ops.seeing_wind.render_composite(filepath=str(tmp_path / "x.png"), still=True))
    for each in ("sky.hdr, which lights the scene", "matte_0001.png, which cuts the edit", "Stereoscopy is on"):
        assert each in said
    assert not (tmp_path / "x.png").exists()


def plain(camera: bpy.types.Object) -> dict[str, object]:
    """All numbers, choices and pointers of a camera and its depth of field, the clips behind it, and its place."""
    found: dict[str, object] = {"matrix": [tuple(row) for row in camera.matrix_world]}
    for holder in (camera.data, camera.data.dof):
        for prop in holder.bl_rna.properties:
            value = getattr(holder, prop.identifier)
            if prop.type in ("BOOLEAN", "INT", "FLOAT", "STRING", "ENUM") and not getattr(prop, "is_array", False):
                found[prop.identifier] = value
    focus = camera.data.dof.focus_object
    clips = [image.clip.name for image in camera.data.background_images if image.clip is not None]
    return found | {"focus_object": focus.name if focus is not None else "", "clips": clips}


WORDS = {
    "show_background_images": "background images of Own on", "clips": "the clip among the background images of Own",
    "use_dof": "depth of field of Own on", "focus_object": "focus of Own from Cube to the clip's object",
    "aperture_fstop": "f-stop of Own from 5.6 to 2",
}  # fmt: skip


def test_what_changes_of_the_user_s_camera_is_named_and_nothing_else_changes(scene) -> None:
    own = bpy.data.objects.new("Own", bpy.data.cameras.new("Own"))
    bpy.ops.mesh.primitive_cube_add()
    own.data.dof.focus_object, own.data.dof.aperture_fstop, own.data.clip_end = bpy.context.object, 5.6, 7.0
    scene.collection.objects.link(own)
    scene.camera = own
    bpy.context.view_layer.update()
    for fstop, names in ((0.0, ["show_background_images", "clips"]), (2.0, ["use_dof", "focus_object", "aperture_fstop"]), (2.0, [])):
        before, foretold = plain(own), camera_changes(scene, fstop)
        scene.seeing_wind.composite.fstop = fstop
        layout = Drawn()
        CompositeTab().fill(bpy.context, layout)
        assert all(words in " ".join(layout.labels) for words in foretold), "the panel says it beforehand"
        told = set_up(scene, samples=1, fstop=fstop)
        changed = {name for name, value in plain(own).items() if value != before[name]}
        assert changed == set(names), "neither lens nor sensor, clipping, shift or place"
        assert foretold == [WORDS[name] for name in names] == [each for each in told.changed if "Own" in each]
        assert all(WORDS[name] in str(told) for name in names)
    assert camera_changes(scene, 0.0) == ["depth of field of Own off"]
    assert "depth of field of Own off" in set_up(scene, samples=1).changed and not own.data.dof.use_dof
    assert camera_changes(scene, 0.0) == []
