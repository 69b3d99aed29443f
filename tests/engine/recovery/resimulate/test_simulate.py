"""Inserted meshes move as physics and the edit require."""

from __future__ import annotations

import re

import numpy as np
import pytest

from seeing_wind.engine.errors import MaterialError, SimulationError, UsageError
from seeing_wind.engine.materials import find
from seeing_wind.engine.progress import Cancelled, Journal, NoProgress, Progress
from seeing_wind.engine.recovery import journal as journals
from seeing_wind.engine.recovery.journal import TakeJournal
from seeing_wind.engine.recovery.resimulate import simulate_bodies
from seeing_wind.engine.recovery.resimulate.in_field import extrapolate
from seeing_wind.engine.recovery.resimulate.mesh import load_mesh
from seeing_wind.engine.settings import BodyEdit, ColliderEdit, Edit
from seeing_wind.engine.take import Take
from tests.engine.fields import UniformField
from tests.engine.recovery.resimulate.edits import BOX, FPS, FRAMES, SOFT, WEIGHTLESS, run, uniform, waves

trimesh = pytest.importorskip("trimesh")


def centre_acceleration(vertices: np.ndarray, frames: int = 4) -> np.ndarray:
    """Constant acceleration of the mean vertex over the first frames, from x = a t² / 2."""
    t = np.arange(1, frames + 1) / FPS
    moved = vertices[1 : frames + 1].mean(1) - vertices[0].mean(0)
    return (moved * t[:, None] ** 2).sum(0) / (t**4).sum() * 2.0


def test_a_free_body_accelerates_by_force_over_density(folder):
    body = run(folder, BodyEdit("box", "box.obj", **SOFT))["box"]
    assert body.vertices.shape == (FRAMES + 1, 8, 3)
    assert body.triangles.shape == (12, 3)
    np.testing.assert_allclose(centre_acceleration(body.vertices), [1.2, 0.0, 0.6], atol=0.012)


def test_frame_zero_is_the_mesh_itself(folder):
    body = run(folder, BodyEdit("flag", "flag.npz", **SOFT))["flag"]
    np.testing.assert_allclose(body.vertices[0], np.load(folder / "flag.npz")["vertices"], atol=1e-12)


def test_a_vertex_of_no_face_is_carried_along_by_a_closed_mesh(folder):
    """Also by one of cotton, which is a solid all the same."""
    vertices, triangles = load_mesh(folder / "box.obj")
    np.savez(folder / "loose.npz", vertices=np.concatenate([vertices, [[0.05, 0.0, 0.0]]]), triangles=triangles)
    for material in ("rubber", "cotton"):
        body = run(folder, BodyEdit("box", "loose.npz", material=material))["box"]
        assert not body.shell
        moved = body.vertices[-1] - body.vertices[0]
        np.testing.assert_allclose(moved[-1], moved[:-1].mean(axis=0), atol=1e-4)


@pytest.mark.parametrize("field", [uniform(), waves()])
def test_doubled_mass_halves_the_acceleration(folder, field):
    one, two = BodyEdit("one", "flag.npz", **SOFT), BodyEdit("two", "flag.npz", mass_scale=2.0, **SOFT)
    bodies = run(folder, one, two, field=field)
    single, double = (centre_acceleration(bodies[name].vertices) for name in ("one", "two"))
    assert np.linalg.norm(single) > 0.5
    np.testing.assert_allclose(double, single / 2.0, atol=0.02 * np.linalg.norm(single) / 2.0)


def test_gravity_does_not_depend_on_mass(folder):
    body = run(folder, BodyEdit("box", "box.obj", mass_scale=3.0, **SOFT), gravity=(0, 0, -9.81), field_strength=0.0)["box"]
    np.testing.assert_allclose(centre_acceleration(body.vertices), [0, 0, -9.81], atol=0.1)


def test_field_strength_per_frame(folder):
    strength = (1.0,) * 4 + (0.0,) * 4
    body = run(folder, BodyEdit("box", "box.obj", **SOFT), field_strength=strength)["box"]
    velocity = np.diff(body.vertices.mean(1), axis=0) * FPS
    np.testing.assert_allclose(velocity[5:], np.tile([1.2 * 4 / FPS, 0.0, 0.6 * 4 / FPS], (3, 1)), atol=5e-3)


def test_the_mass_of_the_whole_body_and_a_factor_on_its_stiffness(folder):
    body = run(folder, BodyEdit("box", "box.obj", mass=0.2**3 * 250.0, youngs_modulus=2e4))["box"]
    np.testing.assert_allclose(centre_acceleration(body.vertices), [2.4, 0.0, 1.2], atol=0.024)
    same = BodyEdit("a", "flag.npz", density=500.0, youngs_modulus=4e4), BodyEdit("b", "flag.npz", youngs_modulus_scale=2.0, **SOFT)
    bodies = run(folder, *same, field=waves())
    np.testing.assert_allclose(bodies["a"].vertices, bodies["b"].vertices, atol=1e-12)


def test_an_edit_may_damp_a_body(folder):
    """A box that stands on four held corners is pushed for four frames: without its material's damping it shakes on for longer."""
    vertices = trimesh.load(folder / "box.obj", process=False).vertices
    np.save(folder / "pins.npy", np.flatnonzero(vertices[:, 2] < vertices[:, 2].mean()))
    held = {"mesh": "box.obj", "pin": "pins.npy", "density": 500.0, "youngs_modulus": 4e3, "material": "rubber"}
    losses = {"own": None, "same": find("rubber").loss_factor, "none": 0.0}
    boxes = [BodyEdit(name, loss_factor=loss, **held) for name, loss in losses.items()]
    bodies = run(folder, *boxes, field=uniform((300.0, 0.0, 0.0), 14), field_strength=(1.0,) * 4 + (0.0,) * 10)
    np.testing.assert_array_equal(bodies["own"].vertices, bodies["same"].vertices)
    speed = {name: np.linalg.norm(np.diff(body.vertices[6:], axis=0), axis=-1).mean() for name, body in bodies.items()}
    assert speed["own"] < 0.97 * speed["none"]


def test_a_body_waits_for_its_start_frame(folder):
    late = run(folder, BodyEdit("late", "box.obj", start_frame=3, velocity=(0.5, 0.0, 0.0), **SOFT))["late"].vertices
    early = run(folder, BodyEdit("early", "box.obj", velocity=(0.5, 0.0, 0.0), **SOFT))["early"].vertices
    np.testing.assert_array_equal(late[:4], np.broadcast_to(late[0], (4, 8, 3)))
    np.testing.assert_allclose(late[3:], early[: FRAMES - 2], atol=1e-9)


def test_bodies_in_contact_push_each_other(folder):
    first = trimesh.creation.box((0.2,) * 3).apply_translation((-0.16, 0, 0))
    first.export(folder / "left.obj")
    bodies = (BodyEdit("left", "left.obj", velocity=(2.0, 0, 0), **SOFT), BodyEdit("right", "box.obj", **SOFT))
    bodies_apart = (bodies[0], BodyEdit("right", "moved.obj", **SOFT))
    trimesh.creation.box((0.2,) * 3).apply_translation((0.1, 0, 0)).export(folder / "moved.obj")
    alone = run(folder, *bodies_apart, field=uniform((0, 0, 0)))
    together = run(folder, *bodies_apart, field=uniform((0, 0, 0)), contact=True)
    assert np.abs(alone["right"].vertices[-1] - alone["right"].vertices[0]).max() < 1e-6
    assert (together["right"].vertices[-1] - together["right"].vertices[0])[:, 0].mean() > 0.05
    momentum = sum((body.vertices[-1] - body.vertices[-2]).mean(0)[0] * FPS for body in together.values())
    assert momentum == pytest.approx(2.0, rel=0.03)


def test_contact_with_a_body_that_has_not_started(folder):
    trimesh.creation.box((0.2,) * 3).apply_translation((0.4, 0, 0)).export(folder / "other.obj")
    bodies = (BodyEdit("now", "box.obj", **SOFT), BodyEdit("late", "other.obj", start_frame=5, **SOFT))
    result = run(folder, *bodies, contact=True)
    assert np.abs(result["late"].vertices[:6] - result["late"].vertices[0]).max() < 1e-12
    assert result["late"].vertices[-1, :, 0].mean() > result["late"].vertices[0, :, 0].mean() + 1e-3


def test_a_body_lands_on_a_floor_and_on_a_mesh(folder):
    trimesh.creation.box((1.0, 1.0, 0.2)).apply_translation((0, 0, -0.25)).export(folder / "table.obj")
    floor = ColliderEdit("floor", plane=(0.0, 0.0, -0.15, 0.0, 0.0, 1.0))
    table = ColliderEdit("table", mesh="table.obj", kind="sticky")
    for collider in (floor, table):
        body = BodyEdit("box", "box.obj", density=500.0, youngs_modulus=2e5)
        path = run(folder, body, field=uniform((0, 0, 0), 6), gravity=(0, 0, -9.81), collider=(collider,))["box"].vertices
        lowest = path[..., 2].min(axis=1)
        # falling freely it would be at -0.3 by now
        assert -0.17 < lowest.min() < -0.13 and lowest[-1] > -0.17, collider.name


@pytest.mark.parametrize(
    ("mesh", "material"),
    [pytest.param("box.obj", {**SOFT, "youngs_modulus": 1e5}, marks=pytest.mark.slow), ("flag.npz", {"material": "cotton"})],
)
def test_a_hammer_that_moves_drives_bodies_before_it(folder, mesh, material):
    """At 2 m/s along +Y, from a tenth of a metre behind them; in the pre-roll it waits."""
    hammer = trimesh.creation.box((1.0, 0.2, 1.0)).apply_translation((0, -0.3, 0))
    hammer.export(folder / "hammer.obj")
    way = hammer.vertices + np.arange(FRAMES + 1)[:, None, None] / FPS * [0.0, 2.0, 0.0]
    np.save(folder / "way.npy", way)
    wall = ColliderEdit("hammer", mesh="hammer.obj", mesh_path="way.npy")
    for preroll in (0, 3):
        path = run(folder, BodyEdit("b", mesh, **material), field=uniform((0, 0, 0)), collider=(wall,), preroll=preroll)["b"].vertices
        back = path[..., 1].min(axis=1)
        face = -0.2 + np.arange(FRAMES + 1) / FPS * 2.0
        assert face[-1] > back[0] + 0.1, "it has met them"
        assert (back - face).min() > -0.02 and np.abs(path[1] - path[0]).max() < 1e-6


def test_pins_and_colliders_go_their_way_once_in_a_wind_too(folder):
    """A light body loses its speed within a frame, which is therefore simulated in parts."""
    vertices = np.load(folder / "flag.npz")["vertices"]
    pins = np.flatnonzero(vertices[:, 0] < 1e-6)
    np.save(folder / "pins.npy", pins)
    away = np.linspace(0.0, 0.16, FRAMES + 1)[:, None, None] * [0.0, 1.0, 0.0]
    np.save(folder / "way.npy", vertices[pins] + away)
    wind = uniform((0.0, 8.0, 0.0))
    wind.kind = "wind"
    flag = BodyEdit("flag", "flag.npz", pin="pins.npy", pin_path="way.npy", density=40.0, youngs_modulus=2e4, shell=False)
    path = run(folder, flag, field=wind)["flag"].vertices
    np.testing.assert_allclose(path[:, pins], vertices[pins] + away, atol=1e-3)


def test_beyond_its_box_the_field_goes_on_from_the_edge():
    field = waves()
    points = np.array([[0.5, 0.0, 0.0], [1.5, 0.2, 0.0]])
    force, gradient = extrapolate(field, points, 0)
    np.testing.assert_allclose(force[1], field.sample(np.array([[1.0, 0.2, 0.0]]), 0)[0][0])
    assert np.abs(gradient[0, :, 0]).max() > 0.0
    np.testing.assert_array_equal(gradient[1, :, 0], 0.0)


def test_leaving_the_box_is_said(folder):
    small = UniformField(BOX * 0.3, FPS, FRAMES, np.zeros(3))
    body = run(folder, BodyEdit("box", "box.obj", velocity=(4.0, 0, 0), **SOFT), field=small)
    assert any("outside the field's box" in note for note in body["box"].notes)


def test_a_body_that_tears_is_said(folder):
    np.save(folder / "corner.npy", np.array([0]))
    soft = {"density": 500.0, "youngs_modulus": 300.0}
    body = run(folder, BodyEdit("flag", "flag.npz", pin="corner.npy", **soft), field=uniform((30000.0, 0, 0)))["flag"]
    assert any("may have torn" in note for note in body.notes)
    whole = run(folder, BodyEdit("flag", "flag.npz", **soft))["flag"]
    assert not any("torn" in note for note in whole.notes)


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"mesh": "none.obj"}, UsageError, "no mesh"),
        ({"material": "unobtainium"}, MaterialError, "^box: There is no material 'unobtainium'"),
        ({"mass_scale": 0.0}, UsageError, "mass_scale"),
        ({"mass_scale": float("nan")}, UsageError, "mass_scale"),
        ({"start_frame": 99}, UsageError, "start_frame"),
        ({"velocity": (1.0, 2.0)}, UsageError, "velocity"),
        ({"pin": "none.npy"}, UsageError, "pins"),
        ({"pin": "float.npy"}, UsageError, "float64"),
        ({"pin": "far.npy"}, UsageError, "name 800"),
        ({"pin": "empty.npy"}, UsageError, "at least one|index"),
        ({"mesh": "recovered"}, UsageError, "no recovered object"),
        ({"density": -1.0}, MaterialError, "^box: .*density"),
        ({"mass": -1.0, "density": None}, UsageError, "mass is -1"),
        ({"mass": 1.0}, UsageError, "mass and density"),
        ({"youngs_modulus_scale": 0.0}, UsageError, "youngs_modulus_scale"),
        ({"pin_weights": "weights.npy"}, UsageError, "without pin"),
        ({"pin": "corner.npy", "pin_weights": "none.npy"}, UsageError, "no file of weights"),
        ({"pin": "corner.npy", "pin_weights": "weights.npy"}, UsageError, "for 1 indices"),
        ({"pin": "corner.npy", "pin_weights": "two.npy"}, UsageError, "from 0 to 1"),
        ({"free": "corner.npy"}, UsageError, "free"),
        ({"mesh": "tiny.obj"}, SimulationError, r"the unit of a mesh \(metres\)"),
        ({"mesh": "huge.obj"}, UsageError, "box measures 100 km. A body has at most 10 km"),
    ],
)
def test_bad_edits_are_refused_with_a_sentence(folder, change, error, says):
    np.save(folder / "float.npy", np.array([0.5]))
    np.save(folder / "far.npy", np.array([800]))
    np.save(folder / "empty.npy", np.zeros(0, dtype=int))
    np.save(folder / "corner.npy", np.array([0]))
    np.save(folder / "weights.npy", np.array([0.5, 0.5]))
    np.save(folder / "two.npy", np.array([2.0]))
    trimesh.creation.box((1e5, 1e5, 1e5)).export(folder / "huge.obj")
    trimesh.creation.box((2e-5, 2e-5, 2e-5)).export(folder / "tiny.obj")
    with pytest.raises(error) as raised:
        run(folder, BodyEdit(**({"name": "box", "mesh": "box.obj", **SOFT} | change)))
    assert re.search(says, str(raised.value))


@pytest.mark.parametrize(
    ("collider", "says"),
    [
        ({}, "needs a mesh or a plane"),
        ({"mesh": "box.obj", "plane": (0.0,) * 5 + (1.0,)}, "needs a mesh or a plane"),
        ({"mesh": "none.obj"}, "Collider wall: There is no mesh"),
        ({"mesh": "flag.npz"}, "Collider wall"),
        ({"mesh": "box.obj", "kind": "glue"}, "glue"),
        ({"plane": (0.0,) * 6}, "Collider wall"),
        ({"plane": (0.0,) * 5 + (1.0,), "mesh_path": "way.npy"}, "a mesh_path, but no mesh"),
        ({"mesh": "box.obj", "mesh_path": "none.npy"}, "There is no file .*none.npy of the mesh's way"),
        ({"mesh": "box.obj", "mesh_path": "way.npy"}, "is float64 of shape"),
        ({"mesh": "box.obj", "friction": -1.0}, "friction"),
    ],
)
def test_bad_colliders_are_refused_by_name(folder, collider, says):
    np.save(folder / "way.npy", np.zeros((3, 8, 3)))
    with pytest.raises(UsageError, match=says):
        run(folder, BodyEdit("box", "box.obj", **SOFT), collider=(ColliderEdit("wall", **collider),))


def test_a_list_of_strengths_must_fit_the_clip(folder):
    with pytest.raises(UsageError, match="3 values for 8 frames"):
        run(folder, BodyEdit("box", "box.obj"), field_strength=(1.0, 2.0, 3.0))


def test_cancel_stops_between_frames(folder):
    calls = []

    def cancelled() -> bool:
        calls.append(1)
        return len(calls) > 3

    with pytest.raises(Cancelled):
        simulate_bodies(Edit((BodyEdit("box", "box.obj", **SOFT),)), uniform(), None, folder, Progress(cancelled=cancelled))


def test_a_simulation_that_is_killed_goes_on_where_it_was(folder, tmp_path, monkeypatch):
    """Through the start of the second body, too."""
    monkeypatch.setattr(journals, "LATEST", 0.0)
    bodies = [BodyEdit(name="a", mesh="box.obj", **SOFT), BodyEdit(name="b", mesh="flag.npz", start_frame=4, **SOFT)]
    edit, seen = Edit(body=tuple(bodies), gravity=WEIGHTLESS), []

    def simulated(journal, dies_at=None):
        def tell(message):
            seen.append(message["message"])
            if message["message"] == dies_at:
                raise KeyboardInterrupt

        return simulate_bodies(edit, waves(), None, folder, Progress(tell), journal=journal)

    for dies_at in ("frame 3 of 8: a", "frame 7 of 8: a", "frame 6 of 8: b"):
        with pytest.raises(KeyboardInterrupt):
            simulated(TakeJournal(Take(tmp_path), "stamp", NoProgress()), dies_at)
    seen.clear()
    got = simulated(TakeJournal(Take(tmp_path), "stamp", NoProgress()))
    assert [message for message in seen if message.startswith("frame")] == [f"frame {number} of 8: b" for number in (6, 7, 8)]
    want = simulated(Journal())
    for name in ("a", "b"):
        np.testing.assert_array_equal(got[name].vertices, want[name].vertices)
