"""A field object that was moved, turned, scaled or weakened: a re-simulation and Blender's own solvers feel the same of it."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Euler

from seeing_wind.ui import freshness
from seeing_wind.ui.field.solvers.calibration import calibrate_object
from seeing_wind.ui.scene_units import METRES, said_of_units
from tests.ui.edit.edits import state, written
from tests.ui.fake_engine import DENSITY, FRAMES, swirl
from tests.ui.fake_engine import away as from_object
from tests.ui.jobs import notes_of
from tests.ui.meshes import cube

BOX = np.array([[-0.5, -0.3, -0.5], [0.7, 0.3, 0.6]])
INTERVAL = 5


@pytest.fixture
def field(recovered):
    """The field object, and a body in it."""
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    return recovered.seeing_wind.field_object


def simulated(workplace, places: np.ndarray) -> np.ndarray:
    """What the edit says of the field (P, 3) [m/s²] at places (P, 3) [m] in a frame, by the definitions of docs/reference/edit.md."""
    edit = written(workplace)
    world = np.load(workplace / "out.edit.take" / edit["field_place"])[INTERVAL] if "field_place" in edit else np.eye(4)
    local = (places - world[:3, 3]) @ np.linalg.inv(world[:3, :3]).T
    nearest = np.clip(local, *BOX)
    away = np.linalg.norm(local - nearest, axis=1)
    left = np.ones(len(places))
    if "fade" in edit:
        for distance in (away, from_object(np.broadcast_to(nearest, (FRAMES, *nearest.shape)))[INTERVAL]):
            t = np.clip(distance / edit["fade"], 0.0, 1.0)
            left = left * (1.0 - t * t * (3.0 - 2.0 * t))
    elif "falloff" in edit:
        near, power = edit["falloff"]
        left = (near / (near + away)) ** power
    U, _, Vt = np.linalg.svd(world[:3, :3] * np.sign(np.linalg.det(world[:3, :3])))
    force = swirl(np.broadcast_to(nearest, (FRAMES, *nearest.shape)))[INTERVAL] * left[:, None] @ (U @ Vt).T
    strength = edit["field_strength"]
    return force / DENSITY * (strength[INTERVAL] if isinstance(strength, list) else strength)


def compare(workplace, checks, field) -> None:
    """A re-simulation and native particles, inside and beside the box."""
    bpy.ops.seeing_wind.resimulate()
    scene = bpy.context.scene
    scene.frame_set(scene.seeing_wind.frame_start + INTERVAL + 1)
    matrix = np.array(field.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world)
    rng = np.random.default_rng(1)
    half = 0.5 * np.ptp(BOX, axis=0)
    local = np.concatenate([rng.uniform(-half, half, (40, 3)), rng.uniform(-2.0 * half, 2.0 * half, (40, 3))])
    places = local @ matrix[:3, :3].T + matrix[:3, 3]
    at, truth = checks["released_accelerations"](scene, field, places, scene.seeing_wind.frame_start + INTERVAL)
    found = simulated(workplace, at)
    error = np.linalg.norm(found - truth, axis=1) / np.abs(truth).max()
    print(f"mean {100.0 * error.mean():.2f} %, worst {100.0 * error.max():.2f} % of the largest")
    assert error.mean() < 0.01 and error.max() < 0.04 and np.linalg.norm(truth, axis=1).max() > 0.1


@pytest.mark.parametrize("change", [
    {}, {"location": (0.4, 1.0, -0.3)}, {"rotation_euler": Euler((0.5, -0.7, 1.1))}, {"scale": (2.0, 2.0, 2.0)},
    {"scale": (-1.0, 1.0, 1.0), "rotation_euler": Euler((0.3, 0.2, 0.9))},
])  # fmt: skip
def test_place_turn_and_size_count_as_for_solvers(workplace, recovered, field, checks, change):
    for name, value in change.items():
        setattr(field, name, value)
    compare(workplace, checks, field)
    assert ("field_place" in written(workplace)) == bool(change)


@pytest.mark.parametrize("reach", ["FADE", "HOLD", "CONTINUE"])
def test_what_is_beside_the_box_counts_as_for_solvers(workplace, recovered, field, checks, reach):
    recovered.seeing_wind.field_reach = reach
    with bpy.context.temp_override(active_object=field, selected_objects=[field]):
        bpy.ops.seeing_wind.apply_to_field()
    compare(workplace, checks, field)
    assert ("fade" in written(workplace), "falloff" in written(workplace)) == (reach == "FADE", reach == "CONTINUE")


def test_a_field_on_a_moving_parent_and_its_keyed_strength_count_as_for_solvers(workplace, recovered, field, checks):
    carrier = bpy.data.objects.new("Carrier", None)
    recovered.collection.objects.link(carrier)
    field.parent = carrier
    for frame, turn in ((1, 0.0), (13, 1.2)):
        carrier.rotation_euler.z, carrier.location.x = turn, 0.2 * turn
        carrier.keyframe_insert("rotation_euler", frame=frame)
        carrier.keyframe_insert("location", frame=frame)
    compare(workplace, checks, field)
    before = field.field.strength
    field.field.strength = 0.5 * before
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"
    for frame in (1, 13):
        field.field.strength = before * (0.5 if frame == 1 else 2.0)
        field.keyframe_insert("field.strength", frame=frame)
    recovered.seeing_wind.field_strength = 2.0
    bpy.ops.seeing_wind.resimulate()
    said = written(workplace)["field_strength"]
    assert said[-1] == pytest.approx(2.0 * 2.0, rel=1e-4) and 2.0 * 0.5 < said[0] < 1.2 and sorted(said) == said
    for frame in (1, 6, 13):
        recovered.frame_set(frame)
        freshness.refresh(recovered)
        assert state("resimulate") == "done"


def test_in_another_unit_it_is_the_same_place(workplace, recovered, checks):
    recovered.unit_settings.scale_length = 0.1
    bpy.ops.seeing_wind.build_scene()
    cube("Box").scale *= 10.0
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    field = recovered.seeing_wind.field_object
    bpy.ops.seeing_wind.resimulate()
    assert "field_place" not in written(workplace) and written(workplace)["fade"] == pytest.approx(0.75 * 1.2, rel=1e-3)
    field.location.x += 10.0
    bpy.ops.seeing_wind.resimulate()
    place = np.load(workplace / "out.edit.take" / "field_place.npy")
    np.testing.assert_allclose(place[3], [[1, 0, 0, 1.0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-5)


def test_another_unit_is_told_until_the_results_are_loaded_again(recovered, tmp_path):
    ops, field, units = bpy.ops.seeing_wind, recovered.seeing_wind.field_object, recovered.unit_settings
    cube("Box")
    ops.insert_mesh(object="Box")
    assert said_of_units(field, recovered) == "" and ops.resimulate() == {"FINISHED"}
    units.scale_length = 0.01
    says = "was made for a unit scale of 1, and the scene's is 0.01: .*Press Reload in the Recover panel, or set Unit Scale to 1"
    for call in (ops.resimulate, ops.preview_edit, lambda: ops.export_field(format="PLY", filepath=str(tmp_path / "ply"))):
        with pytest.raises(RuntimeError, match=says):
            call()
    bpy.context.object.modifiers.new("Dust", "PARTICLE_SYSTEM")
    assert said_of_units(field, recovered) in calibrate_object(recovered, bpy.context.object, field)
    units.system = "NONE"
    assert said_of_units(field, recovered) == "", "a unit is a metre again"
    units.system = "METRIC"
    assert ops.build_scene() == {"FINISHED"} and said_of_units(field, recovered) == ""
    assert ops.resimulate() == {"FINISHED"}


@pytest.mark.parametrize(("gone", "learnt"), [(False, 0.1), (True, 0.02)])
def test_a_field_of_an_earlier_version_learns_its_unit_when_its_file_is_opened(recovered, workplace, tmp_path, gone, learnt):
    """From its box in the take, if that is there; else it is the scene's, so that a later change is noticed."""
    recovered.unit_settings.scale_length = 0.1
    assert bpy.ops.seeing_wind.build_scene() == {"FINISHED"}
    settings = recovered.seeing_wind
    del settings.field_object[METRES]
    recovered.unit_settings.scale_length = 0.02
    assert said_of_units(settings.field_object, recovered) == "", "nothing is known"
    if gone:
        settings.recovered_take = settings.field_object["seeing_wind_take"] = str(tmp_path / "gone.take")
    bpy.ops.wm.save_as_mainfile(filepath=str(workplace / "earlier.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(workplace / "earlier.blend"))
    scene = bpy.context.scene
    field = scene.seeing_wind.field_object
    assert field[METRES] == pytest.approx(learnt, rel=1e-6)
    assert ("made for a unit scale of 0.1, and the scene's is 0.02" in said_of_units(field, scene)) != gone
    scene.unit_settings.scale_length = 1.0
    assert f"made for a unit scale of {learnt:g}, and the scene's is 1" in said_of_units(field, scene)


def test_a_field_that_is_deleted_or_hidden_is_told_and_still_fades(workplace, recovered, field):
    def told(said: str) -> bool:
        bpy.ops.seeing_wind.resimulate()
        return any(said in note for note in notes_of(recovered, "resimulate"))

    assert not told("hidden in viewports")
    field.hide_viewport = True
    assert told("hidden in viewports")
    fade = written(workplace)["fade"]
    bpy.data.objects.remove(field)
    assert told("was deleted") and written(workplace)["fade"] == pytest.approx(fade, rel=1e-5)
