"""Which meshes become bodies, and as what they are simulated: hidden ones, scaled to nothing, the results' own objects, awkward names."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from seeing_wind.ui.edit.panel import EditTab
from seeing_wind.ui.job import operator as job_operator
from tests.ui.drawn import Drawn
from tests.ui.job.test_modal import Window, resimulating, step_until_over
from tests.ui.jobs import recover
from tests.ui.meshes import cube

pytestmark = pytest.mark.usefixtures("stand_in")


def exported(scene, name: str) -> np.ndarray:
    """Vertices (V, 3) [m] as the engine got them."""
    return np.load(Path(scene.seeing_wind.simulated_take) / "meshes" / f"{name}.npz")["vertices"]


@pytest.mark.parametrize("how", ["shown", "eye", "viewport", "excluded", "collection", "layer"])
def test_a_hidden_object_is_simulated_as_it_would_be_shown(workplace, scene, how) -> None:
    recover(workplace)
    obj, collection = cube("Aside"), bpy.data.collections.new("Stage")
    scene.collection.children.link(collection)
    collection.objects.link(obj)
    scene.collection.objects.unlink(obj)
    obj.modifiers.new("Thick", "SOLIDIFY")
    obj.location.x = 5.0
    layer = bpy.context.view_layer.layer_collection.children["Stage"]
    hide = {
        "shown": lambda: None, "eye": lambda: obj.hide_set(True), "viewport": lambda: setattr(obj, "hide_viewport", True),
        "excluded": lambda: setattr(layer, "exclude", True), "collection": lambda: setattr(collection, "hide_viewport", True),
        "layer": lambda: setattr(layer, "hide_viewport", True),
    }  # fmt: skip
    hide[how]()
    objects = len(bpy.data.objects)
    bpy.ops.seeing_wind.insert_mesh(object="Aside")
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}
    vertices = exported(scene, "Aside")
    assert len(vertices) == 16 and vertices[:, 0].min() > 4.8 and len(bpy.data.objects) == objects


@pytest.mark.parametrize("scale", [(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1e-30, 1.0, 1.0)])
def test_a_scale_of_nothing_is_refused(workplace, scene, scale) -> None:
    recover(workplace)
    flat = cube("Flat")
    bpy.ops.seeing_wind.insert_mesh(object="Flat")
    flat.scale = scale
    with pytest.raises(RuntimeError, match="Flat has a scale of 0"):
        bpy.ops.seeing_wind.resimulate()
    scene.seeing_wind.bodies.clear()
    with pytest.raises(RuntimeError, match="Flat has a scale of 0"):
        bpy.ops.seeing_wind.insert_mesh(object="Flat")


def test_a_mesh_is_judged_as_it_is_in_the_clip_s_first_frame(workplace, scene) -> None:
    recover(workplace)
    fades = cube("Fades")
    for frame, scale in ((scene.seeing_wind.frame_start, 1.0), (9, 0.0)):
        fades.scale = (scale,) * 3
        fades.keyframe_insert("scale", frame=frame)
    scene.frame_set(10)
    bpy.ops.seeing_wind.insert_mesh(object="Fades")
    assert scene.frame_current == 10 and scene.seeing_wind.bodies[0].object == fades


def test_what_was_imported_and_cannot_move_is_not_left_behind(workplace, scene) -> None:
    recover(workplace)
    (workplace / "line.obj").write_text("o Line\nv 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    before = set(bpy.data.objects), set(bpy.data.meshes)
    with pytest.raises(RuntimeError, match="Line has no area"):
        bpy.ops.seeing_wind.insert_mesh(filepath=str(workplace / "line.obj"))
    assert (set(bpy.data.objects), set(bpy.data.meshes)) == before and not len(scene.seeing_wind.bodies)


def test_everything_selected_inserts_what_can_move(workplace, scene) -> None:
    recover(workplace)
    cube("One")
    bpy.ops.object.select_all(action="SELECT")
    assert bpy.ops.seeing_wind.insert_mesh() == {"FINISHED"}
    settings = scene.seeing_wind
    assert sorted((body.name, body.is_recovered) for body in settings.bodies) == [("One", False), ("Recovered Object", True)]
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}
    settings.bodies.clear()
    bpy.ops.object.select_all(action="DESELECT")
    for name in ("One", cube("Two").name):
        scene.objects[name].select_set(True)
    bpy.ops.seeing_wind.insert_collider()
    assert {each.name for each in settings.colliders} == {"One", "Two"}


def test_any_name_can_be_simulated(workplace, scene) -> None:
    recover(workplace)
    names = ["ж" * 31, "../..\\x:?*", " . ", "a", "A", "長" * 60]
    for name in names:
        cube(name)
        bpy.ops.seeing_wind.insert_mesh(object=bpy.context.object.name)
    assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"} == bpy.ops.seeing_wind.bake()
    results = {body.result.lower() for body in scene.seeing_wind.bodies}
    assert len(results) == len(names) and all(len(result.encode()) < 220 for result in results)


def test_a_body_deleted_during_the_run_does_not_take_the_recovered_object_s_result(workplace, scene, monkeypatch) -> None:
    recover(workplace)
    cube("Gone")
    bpy.ops.seeing_wind.insert_mesh(object="Gone")
    bpy.ops.seeing_wind.insert_mesh(recovered=True)
    monkeypatch.setattr(job_operator, "blocks", lambda context: False)
    operator, window = resimulating(scene), Window(scene)
    assert operator.execute(window) == {"RUNNING_MODAL"}
    bpy.data.objects.remove(bpy.data.objects["Gone"])
    assert step_until_over(operator, window) == {"FINISHED"}
    assert [body.result for body in scene.seeing_wind.bodies] == ["", "Recovered Object"]
    assert bpy.ops.seeing_wind.bake() == {"FINISHED"}


def sheet(name: str, vertices: list[tuple[float, float, float]], faces: list[tuple[int, ...]]) -> bpy.types.Object:
    """A mesh of these faces."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


SQUARE, CORNERS = [(0, 1, 2, 3)], [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)]
UP, DOWN = [(0.0, 0.0, 1.0), (1.0, 0.0, 1.0)], [(0.0, 0.0, -1.0), (1.0, 0.0, -1.0)]


NO_SHEETS = pytest.mark.parametrize(
    ("vertices", "faces", "says"),
    [
        ([*CORNERS, *UP], SQUARE, "has 2 loose vertices.*Delete Loose"),
        ([*CORNERS, *UP, *DOWN], [*SQUARE, (0, 1, 5, 4), (0, 1, 7, 6)], "has 1 edge with three faces.*By Distance"),
        ([*CORNERS, *CORNERS, *CORNERS, *UP], [*SQUARE, (4, 5, 6, 7), (8, 9, 13, 12)], "has 2 edges with three faces"),
    ],
)  # fmt: skip


@NO_SHEETS
def test_what_is_no_sheet_is_refused_when_it_is_inserted_as_one(workplace, scene, vertices, faces, says) -> None:
    recover(workplace)
    sheet("Sail", vertices, faces)
    with pytest.raises(RuntimeError, match=f"Sail {says}"):
        bpy.ops.seeing_wind.insert_mesh(object="Sail", material="cotton")
    assert not len(scene.seeing_wind.bodies)
    assert bpy.ops.seeing_wind.insert_mesh(object="Sail", material="rubber") == {"FINISHED"}, "a solid is filled all the same"


def panel() -> str:
    """What the panel *Edit* says."""
    layout = Drawn()
    EditTab.fill(SimpleNamespace(bl_space_type="VIEW_3D"), bpy.context, layout)
    return " ".join(layout.labels)


@NO_SHEETS
def test_what_becomes_no_sheet_by_its_material_is_told_at_once_and_refused_before_the_job(workplace, scene, vertices, faces, says) -> None:
    recover(workplace)
    obj = sheet("Sail", vertices, faces)
    bpy.ops.seeing_wind.insert_mesh(object="Sail", material="rubber")
    assert "Sail has" not in panel()
    scene.seeing_wind.bodies[0].material = "cotton"
    assert re.search(f"Sail {says}", panel())
    with pytest.raises(RuntimeError, match=f"Sail {says}"):
        bpy.ops.seeing_wind.resimulate()
    assert not (workplace / "out.edit.take" / "edit.toml").exists(), "the engine was not asked"
    obj.data.clear_geometry()
    obj.data.from_pydata(CORNERS, [], SQUARE)
    bpy.context.view_layer.update()
    assert "Sail has" not in panel() and "Shell" in panel() and bpy.ops.seeing_wind.resimulate() == {"FINISHED"}


def test_a_modifier_may_mend_what_is_no_sheet(workplace, scene) -> None:
    recover(workplace)
    obj = sheet("Sail", [*CORNERS, *UP, *DOWN], [*SQUARE, (0, 1, 5, 4), (0, 1, 7, 6)])
    obj.modifiers.new("Thick", "SOLIDIFY").solidify_mode = "NON_MANIFOLD"
    bpy.ops.seeing_wind.insert_mesh(object="Sail", material="cotton")
    assert "Sail has" not in panel() and bpy.ops.seeing_wind.resimulate() == {"FINISHED"}


def test_sheets_and_solids_are_taken_as_before(workplace, scene) -> None:
    """Two sheets that meet in a point, one whose vertices repeat at a seam, and a cube with a loose vertex inside, which is a solid."""
    recover(workplace)
    sheet("Seam", [*CORNERS, *CORNERS, *UP], [*SQUARE, (4, 5, 9, 8)])
    sheet("Bow", [*CORNERS, (2.0, 1.0, 0.0), (2.0, 2.0, 0.0), (1.0, 2.0, 0.0)], [*SQUARE, (2, 4, 5, 6)])
    box = cube("Box")
    box.data.vertices.add(1)
    for name in ("Seam", "Bow", "Box"):
        assert bpy.ops.seeing_wind.insert_mesh(object=name, material="cotton") == {"FINISHED"}
    assert len(scene.seeing_wind.bodies) == 3
