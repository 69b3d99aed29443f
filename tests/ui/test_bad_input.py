"""What a newcomer does wrong: every operator answers with a sentence and what to do, nothing is lost, nothing stays running."""

from __future__ import annotations

import shutil
from pathlib import Path

import bpy
import pytest

from seeing_wind.ui.job import operator as job_operator
from seeing_wind.ui.job import status

pytestmark = pytest.mark.usefixtures("stand_in")


def refused(call, says: str | None = None) -> None:
    """It is refused with a sentence, not by a defect."""
    with pytest.raises(RuntimeError, match=says) as raised:
        call()
    assert "Traceback" not in str(raised.value), str(raised.value)
    assert not job_operator.jobs and status.of(bpy.context.scene.session_uid).running == ""


def mesh(name: str, vertices: list, faces: list) -> str:
    data = bpy.data.meshes.new(name)
    data.from_pydata(vertices, [], faces)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, data))
    return name


def test_in_an_empty_file_every_operator_says_what_comes_first(scene) -> None:
    harmless = {"add_view", "add_wind", "add_wind_library", "clear_bake", "doctor", "open_preferences"}
    names = [name for name in dir(bpy.ops.seeing_wind) if name not in harmless]
    assert len(names) > 20
    for name in names:
        refused(getattr(bpy.ops.seeing_wind, name))
    refused(bpy.ops.seeing_wind.match_scene, "No clip is chosen")
    refused(bpy.ops.seeing_wind.build_scene, "no recovered field")
    refused(lambda: bpy.ops.seeing_wind.build_scene(take=__file__), "is a file, not a folder. Choose the folder of a take")


def test_what_is_no_clip_is_refused_and_the_former_one_stays(scene, workplace, tmp_path) -> None:
    ops = bpy.ops.seeing_wind
    ops.choose_clip(filepath=str(workplace / "clip.mp4"))
    (tmp_path / "text.mp4").write_text("no video")
    (tmp_path / "empty.mp4").write_bytes(b"")
    for path in (tmp_path / "text.mp4", tmp_path / "empty.mp4", tmp_path):
        refused(lambda path=path: ops.choose_clip(filepath=str(path)), "no frames")
    assert scene.seeing_wind.clip == str(workplace / "clip.mp4")
    refused(lambda: ops.draw_box(box=(40, 40, 20, 20)), "too small")


def test_a_collider_without_an_inside_is_refused_when_it_is_added(scene, recovered) -> None:
    ops = bpy.ops.seeing_wind
    bpy.ops.mesh.primitive_plane_add()
    plane = bpy.context.object
    refused(lambda: ops.insert_collider(object=plane.name), "is open, .*Solidify")
    plane.modifiers.new("Thickness", "SOLIDIFY").thickness = 0.1
    assert ops.insert_collider(object=plane.name) == {"FINISHED"}
    refused(lambda: ops.insert_collider(object=plane.name), f"{plane.name} is in this edit already")


def test_a_box_that_holds_nothing_is_named(scene, workplace) -> None:
    bpy.ops.seeing_wind.choose_clip(filepath=str(workplace / "clip.mp4"))
    refused(lambda: bpy.ops.seeing_wind.recover(box=(40, 40, 20, 20)), "40 40 20 20, holds nothing")


def test_meshes_that_cannot_move_are_refused(scene, recovered) -> None:
    ops, leaf = bpy.ops.seeing_wind, [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    unfit = {
        "Empty": ([], [], "no faces"), "Edge": (leaf[:2], [], "no faces"),
        "Line": ([(0, 0, 0), (1, 3, 0), (0.1, 0.3, 0)], [(0, 1, 2)], "no area"),
        "Nowhere": ([leaf[0], (float("nan"), 0, 0), leaf[2]], [(0, 1, 2)], "nowhere"),
    }  # fmt: skip
    for name, (vertices, faces, says) in unfit.items():
        mesh(name, vertices, faces)
        refused(lambda name=name: ops.insert_mesh(object=name), f"{name} has .*{says}")
        refused(lambda name=name: ops.insert_collider(object=name), f"{name} has .*{says}")
        assert not len(scene.seeing_wind.bodies) and not len(scene.seeing_wind.colliders)
        fine = scene.objects[mesh(f"{name} later", leaf, [(0, 1, 2)])]
        ops.insert_mesh(object=fine.name)
        fine.data = scene.objects[name].data
        refused(ops.resimulate, f"{name} later has .*{says}")
        refused(ops.bake)
        ops.remove_body()
    mesh("Beyond", [leaf[0], (float("inf"), 0, 0), leaf[2]], [(0, 1, 2)])
    refused(lambda: ops.insert_mesh(object="Beyond"), "nowhere")
    refused(lambda: ops.insert_mesh(object=scene.seeing_wind.field_object.name), "no mesh that could move")
    for kind, says in (("obj", "no mesh that could move"), ("ply", "cannot import"), ("stl", "cannot import")):
        (recovered.parent / f"bad.{kind}").write_text("garbage")
        refused(lambda kind=kind: ops.insert_mesh(filepath=str(recovered.parent / f"bad.{kind}")), says)
    mesh("Held", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    ops.insert_mesh(object="Held", pin_group="nothing")
    refused(ops.resimulate, "no vertex group")


def test_factors_that_mean_nothing_are_refused(scene, recovered) -> None:
    ops, body = bpy.ops.seeing_wind, scene.seeing_wind.bodies
    ops.insert_mesh(object=mesh("Leaf", [(0, 0, 0), (0.1, 0, 0), (0, 0, 0.1)], [(0, 1, 2)]))
    for factor, said in ((float("nan"), "nan"), (float("inf"), "3.4"), (0.0, "0"), (-1.0, "-1")):
        refused(lambda factor=factor: ops.scale_mass(factor=factor), f"mass factor of Leaf cannot be {said}.*Give 0.001 or more")
        refused(lambda factor=factor: ops.scale_stiffness(factor=factor), f"stiffness factor of Leaf cannot be {said}.*Give 0.001 or more")
    assert body[0].mass_scale == body[0].stiffness_scale == 1.0
    assert ops.scale_mass(factor=0.001) == {"FINISHED"} and ops.scale_stiffness() == {"FINISHED"}
    assert (body[0].mass_scale, body[0].stiffness_scale) == (pytest.approx(0.001), 2.0)


def test_places_that_cannot_be_written_are_named(scene, recovered) -> None:
    ops, blocked = bpy.ops.seeing_wind, recovered.parent / "a file"
    blocked.write_text("no folder")
    refused(lambda: ops.export_field(format="FGA", filepath=str(blocked / "in it" / "x")), "a file")
    refused(lambda: ops.render_composite(filepath=str(blocked / "x.png"), still=True), "a file")


def test_results_that_were_deleted_or_damaged_are_told_and_what_is_shown_stays(scene, recovered) -> None:
    ops = bpy.ops.seeing_wind
    mesh("Leaf", [(0, 0, 0), (0.1, 0, 0), (0, 0, 0.1)], [(0, 1, 2)])
    ops.insert_mesh(object="Leaf")
    ops.resimulate()
    shutil.rmtree(Path(scene.seeing_wind.simulated_take))
    refused(ops.bake, "There is no folder .*Re-simulate again")
    (recovered / "trajectory.npz").write_bytes(b"broken")
    refused(ops.build_scene, "trajectory.npz")
    shutil.rmtree(recovered)
    for call in (ops.build_scene, ops.resimulate, ops.open_report, lambda: ops.export_field(format="NPZ")):
        refused(call)
    assert scene.seeing_wind.field_object.name in scene.objects and scene.seeing_wind.recovered_object.data.shape_keys


@pytest.fixture
def recovered(scene, workplace, tmp_path) -> Path:
    """The take of a field."""
    take = tmp_path / "out.take"
    options = {"clip": str(workplace / "clip.mp4"), "box": (20, 20, 44, 44), "distance": 2.0, "take": str(take)}
    assert bpy.ops.seeing_wind.recover(**options) == {"FINISHED"}
    return take


def test_a_failure_is_forgotten_once_its_cause_is_mended(scene, workplace) -> None:
    ops, settings = bpy.ops.seeing_wind, scene.seeing_wind

    def state(step: str) -> str:
        return status.of(scene.session_uid).steps[step].state

    refused(ops.recover, "No clip is chosen")
    refused(ops.preview, "No clip is chosen")
    assert state("recover") == state("preview") == "failed"
    ops.choose_clip(filepath=str(workplace / "clip.mp4"))
    assert state("recover") == state("preview") == "idle", "there is a clip now"
    refused(ops.recover, "No box is drawn")
    settings.box = (20, 20, 44, 44)
    assert state("recover") == "idle"
    assert ops.recover(take=str(workplace / "out.take")) == {"FINISHED"}
    refused(ops.resimulate, "No mesh is inserted")
    ops.insert_mesh(object=mesh("Leaf", [(0, 0, 0), (0.1, 0, 0), (0, 0, 0.1)], [(0, 1, 2)]))
    assert state("resimulate") == "idle"
    scene.objects["Leaf"].data.clear_geometry()
    refused(ops.resimulate, "no faces")
    assert state("resimulate") == "failed"
    settings.edit_gravity_mode = "NONE"
    assert state("resimulate") == "idle", "another edit"
