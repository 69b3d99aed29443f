"""A field that was recovered as a wind: what the panel says of it, and what Blender's cloth and particles do in it."""

from __future__ import annotations

import runpy
import tomllib
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.ui.field.display import KIND, LEGEND_MARK, LINEAR, is_wind, out_of_time, said_of_fit, said_of_wind
from seeing_wind.ui.field.field_object import linear_drag
from seeing_wind.ui.field.samples import read_samples, samples_of
from seeing_wind.ui.field.solvers.in_wind import still_air
from tests.ui.jobs import recover
from tests.ui.meshes import cube

CHECK = runpy.run_path(str(Path(__file__).resolve().parents[2] / "blender" / "wind_check.py"), run_name="checks")
DRAG, SPEED, U, FPS = (CHECK[name] for name in ("DRAG", "SPEED", "U", "FPS"))
steady, sheet, places = CHECK["steady"], CHECK["sheet"], CHECK["places"]


def test_cloth_is_driven_by_the_law_and_drifts_with_the_wind(scene, stand_in):
    """A plate of 0.1 kg/m² across the wind. One that is not slowed by the air would be five times as far."""
    steady(scene)
    obj = sheet(scene)
    assert bpy.ops.seeing_wind.calibrate(object=obj.name, areal_density=0.1) == {"FINISHED"}
    z = places(obj, scene, 26)[:, 2] + 0.9
    truth = CHECK["drag_way"](DRAG * SPEED / 0.1, 26)[0]
    assert z[[5, 25]] == pytest.approx(truth[[5, 25]], rel=0.06)
    assert 0.95 * SPEED < (z[25] - z[24]) * FPS < 1.05 * SPEED


def test_only_faces_across_the_wind_are_pushed(scene, stand_in):
    steady(scene)
    obj = sheet(scene)
    obj.rotation_euler.x = 0.5 * np.pi
    bpy.ops.seeing_wind.calibrate(object=obj.name, areal_density=0.1)
    found = places(obj, scene, 6)
    assert np.abs(found - found[0]).max() < 0.01, "across the wind it has gone 0.17 m by then"


def test_particles_reach_the_wind_and_no_more(scene, stand_in):
    steady(scene)
    obj = CHECK["dust"](scene)
    bpy.ops.seeing_wind.calibrate(object=obj.name, density=5.0)
    speeds = CHECK["dust_speeds"](obj, scene, 30)
    truth = CHECK["drag_way"](DRAG * SPEED / (2.0 * 5.0 * 0.01), 30)[1]
    assert speeds[3] == pytest.approx(truth[3], rel=0.2)
    assert speeds[-1] == pytest.approx(SPEED, rel=0.01)


def test_where_the_linear_drag_is_right_and_how_far_off():
    """Winds of 2 and 6 m/s: the speed that minimises the squared difference from the quadratic drag, by a search."""
    velocity = np.array([[[2.0, 0.0, 0.0]], [[0.0, 6.0, 0.0]]])
    tried = np.linspace(1.0, 8.0, 70001)
    squares = ((np.array([4.0, 36.0]) - tried[:, None] * [2.0, 6.0]) ** 2).sum(axis=1)
    speed, off = linear_drag(velocity)
    assert speed == pytest.approx(tried[squares.argmin()], abs=1e-3)
    assert off == pytest.approx(np.sqrt(squares.min() / (16.0 + 1296.0)), rel=1e-3)
    assert linear_drag(np.zeros((1, 2, 3))) == (0.0, 0.0)


def test_solvers_can_feel_the_force_instead_and_calibrations_say_that_they_are_old(scene, stand_in):
    field, obj = steady(scene), sheet(scene)
    bpy.ops.seeing_wind.calibrate(object=obj.name)
    assert not out_of_time(scene) and (field.field.wind_factor, field["seeing_wind_units"]) == (1.0, "m/s")
    scene.seeing_wind.field_kind = "FORCE"
    assert bpy.ops.seeing_wind.apply_to_field(field="Wind") == {"FINISHED"}
    assert (field.field.wind_factor, field["seeing_wind_units"]) == (0.0, "N/m3")
    scene.frame_set(2)
    assert still_air(scene, field).field.flow == 0.0, "nothing is slowed by a force"
    assert [entry.object for entry in out_of_time(scene)] == [obj]
    bpy.ops.seeing_wind.calibrate_again()
    assert not out_of_time(scene)
    found = places(obj, scene, 3)
    moved = found - found[0]
    assert moved[-1, 0] > 10.0 * abs(moved[-1, 2]), "the force blows along X, the wind along Z"
    scene.seeing_wind.field_kind = "WIND"
    bpy.ops.seeing_wind.apply_to_field(field="Wind")
    assert is_wind(field) and np.allclose(read_samples(samples_of(field)).velocity, U)


def test_a_rigid_ball_is_driven_by_the_law_and_drifts_with_the_wind(scene, stand_in):
    """Of the recovery's law a ball feels two thirds of its disk. Force alone would throw it three times as far."""
    steady(scene)
    obj = CHECK["ball"](scene)
    assert bpy.ops.seeing_wind.calibrate(object=obj.name) == {"FINISHED"}
    z = places(obj, scene, 26)[:, 2] + 0.9
    truth = CHECK["drag_way"](DRAG * SPEED * CHECK["BALL"] / 0.005, 26)[0]
    assert z[[5, 25]] == pytest.approx(truth[[5, 25]], rel=0.04)
    assert 0.95 * SPEED < (z[25] - z[24]) * FPS < 1.01 * SPEED


def test_a_rigid_body_goes_the_same_way_at_another_frame_rate_and_speed_of_its_world(scene, stand_in):
    """A clip frame is a frame: as far per frame at 50 frames a second, and with a world that runs at twice the speed."""
    steady(scene)
    obj, ways = CHECK["ball"](scene), []
    for fps, speed in ((25, 1.0), (50, 1.0), (25, 2.0)):
        scene.render.fps, scene.rigidbody_world.time_scale = fps, speed
        bpy.ops.seeing_wind.calibrate(object=obj.name)
        ways.append(places(obj, scene, 16)[15, 2] + 0.9)
    assert ways[1:] == pytest.approx([ways[0]] * 2, rel=0.04)


def test_set_mass_suits_a_second_rigid_body_whose_surface_differs(scene, stand_in):
    """A ball of twice the radius and the mass that makes its drag over its mass that of the first goes as far; calibrating twice too."""
    steady(scene)
    first, second = CHECK["ball"](scene, mass=0.02), CHECK["ball"](scene, radius=0.2, mass=0.08)
    second.location.x = 0.5
    bpy.ops.seeing_wind.calibrate(object=first.name)
    for _ in range(2):
        bpy.ops.seeing_wind.calibrate(object=second.name, set_mass=True)
        assert second.rigid_body.mass == pytest.approx(0.02, rel=1e-3)
    said = scene.seeing_wind.calibrations[-1].said
    assert "80 g" in said and "Its mass is 20 g" in said and first.name in said
    assert places(second, scene, 20)[19, 2] == pytest.approx(places(first, scene, 20)[19, 2], rel=1e-3)


def test_hair_is_driven_by_the_law_and_its_tips_drift_with_the_wind(scene, stand_in):
    steady(scene)
    obj, system = CHECK["strands"](scene)
    bpy.ops.seeing_wind.calibrate(object=obj.name, density=30.0)
    z = CHECK["tip_heights"](obj, scene, 9)
    truth, speed = CHECK["drag_way"](DRAG * SPEED / (30.0 * 0.01), 9)
    assert z[5] == pytest.approx(truth[5], rel=0.08)
    assert (z[8] - z[7]) * FPS < 1.01 * SPEED, "without drag it would be three times as fast"
    system.settings.radius_scale = 0.0
    with pytest.raises(RuntimeError, match="no thickness"):
        bpy.ops.seeing_wind.calibrate(object=obj.name)


def test_a_light_cloth_and_what_cannot_be_calibrated_is_said(scene, stand_in):
    steady(scene)
    obj = sheet(scene)
    from seeing_wind.ui.field.solvers.calibration import calibrate_object

    obj.modifiers["Cloth"].settings.mass = 3.0
    said = calibrate_object(scene, obj, scene.objects["Wind"], areal_density=0.05)[0]
    weights = obj.modifiers["Cloth"].settings.effector_weights
    assert "All multiplies" in said and "linear" in said and weights.all > 1.0 and max(weights.texture, weights.wind) == 200.0
    obj.modifiers["Cloth"].settings.time_scale = 2.0
    with pytest.raises(RuntimeError, match="Speed Multiplier"):
        bpy.ops.seeing_wind.calibrate(object=obj.name, field="Wind")
    obj.modifiers["Cloth"].settings.time_scale = 1.0
    scene.objects["Wind"].field.strength = 0.0
    with pytest.raises(RuntimeError, match="No wind blows"):
        bpy.ops.seeing_wind.calibrate(object=obj.name, field="Wind")


def test_recover_as_a_wind_says_speed_and_why_everywhere(scene, stand_in, workplace):
    assert recover(workplace, field="WIND") == {"FINISHED"}
    settings = scene.seeing_wind
    field, arrows = settings.field_object, settings.arrows_object
    assert settings.field == "WIND" and settings.field_verdict.startswith("Effective wind: 4.1 m/s (Beaufort 3)")
    assert said_of_wind(field) == "Wind: 4.1 m/s (Beaufort 3) in the mean, gusts up to 6 m/s (Beaufort 4)"
    field.field.strength *= 2.0
    assert said_of_wind(field) == "Wind: 8.2 m/s (Beaufort 5) in the mean, gusts up to 12 m/s (Beaufort 6)"
    assert "off the recovered wind" in said_of_fit(field) and field[LINEAR][0] == pytest.approx(4.1, abs=0.2)
    assert arrows["seeing_wind_units"] == "m/s" and 4.0 < arrows["seeing_wind_peak"] < 5.0
    legend = next(child for child in field.children if LEGEND_MARK in child)
    texts = [node.inputs["String"].default_value for node in legend.modifiers[0].node_group.nodes if "String" in node.inputs]
    assert any(text.endswith(" m/s") for text in texts)
    carried = read_samples(samples_of(field)).velocity
    assert carried[..., 1] == pytest.approx(1.0) and 3.5 < carried[..., 0].mean() < 4.5


def test_auto_that_keeps_to_the_force_says_why_and_another_run_takes_the_wind_away(scene, stand_in, workplace):
    recover(workplace, field="WIND")
    recover(workplace, field="AUTO", take=str(workplace / "auto.take"))
    settings = scene.seeing_wind
    assert settings.field_verdict == "Field: force. A wind is less probable."
    assert settings.field_object[KIND] == "FORCE" and said_of_wind(settings.field_object) == ""
    recover(workplace, field="FORCE", take=str(workplace / "plain.take"))
    assert settings.field_verdict == "" and settings.arrows_object["seeing_wind_units"] == "N/m³"


def test_the_edit_chooses_wind_or_force(scene, stand_in, workplace):
    recover(workplace, field="WIND")
    bpy.ops.seeing_wind.insert_mesh(object=cube("Box").name)
    edits = []
    for chosen in ("PRESET", "FORCE"):
        scene.seeing_wind.edit_field = chosen
        assert bpy.ops.seeing_wind.resimulate() == {"FINISHED"}
        edits.append(tomllib.loads((Path(scene.seeing_wind.simulated_take) / "edit.toml").read_text()).get("field"))
    assert edits == [None, "force"]


def test_a_wind_that_makes_no_sense_is_refused(scene, stand_in, workplace):
    recover(workplace, field="WIND")
    told = Path(scene.seeing_wind.recovered_take) / "wind.json"
    told.write_text(told.read_text().replace("4.1", "NaN"))
    with pytest.raises(RuntimeError, match=r"wind\.json"):
        bpy.ops.seeing_wind.build_scene()
