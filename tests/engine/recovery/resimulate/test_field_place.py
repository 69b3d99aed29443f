"""A field that is moved away from where it was recovered, and what is left of it outside its box."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.field.confidence import ConfidenceMap
from seeing_wind.engine.recovery.resimulate.in_field import Blowing, Reach, extrapolate, read_place, rotation_of
from seeing_wind.engine.settings import BodyEdit
from tests.engine.recovery.resimulate.edits import FPS, FRAMES, SOFT, run, uniform, waves

trimesh = pytest.importorskip("trimesh")

QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter turn about Z: +X becomes +Y."""


def matrices(turn=np.eye(3), shift=(0.0, 0.0, 0.0)) -> np.ndarray:
    one = np.eye(4)
    one[:3, :3], one[:3, 3] = turn, shift
    return np.broadcast_to(one, (FRAMES, 4, 4)).copy()


def speed(body) -> np.ndarray:
    """Velocity (T, 3) [m/s] of the body's centre between frames."""
    return np.diff(body.vertices.mean(axis=1), axis=0) * FPS


def around(field, place=None, reach=Reach(), strength=1.0) -> Blowing:
    return Blowing(field, np.full(FRAMES, strength), place, reach)


def test_a_field_that_is_turned_pushes_the_other_way(folder):
    np.save(folder / "place.npy", matrices(QUARTER))
    v = speed(run(folder, BodyEdit("box", "box.obj", **SOFT), field=uniform((600.0, 0.0, 300.0)), field_place="place.npy")["box"])
    np.testing.assert_allclose((v[6] - v[0]) * FPS / 6.0, [0.0, 1.2, 0.6], atol=0.01)


def test_a_field_that_turns_while_it_blows_turns_the_way(folder):
    place = matrices()
    place[4:, :3, :3] = QUARTER
    np.save(folder / "place.npy", place)
    for preroll in (0, 2):
        edit = {"field": uniform((600.0, 0.0, 0.0)), "field_place": "place.npy", "preroll": preroll}
        v = speed(run(folder, BodyEdit("flag", "flag.npz", material="cotton", start_frame=0 if not preroll else 1), **edit)["flag"])
        assert np.abs(v[3, 1]) < 1e-6 and v[-1, 1] > 0.1 * v[3, 0] > 0.0


@pytest.mark.parametrize(
    ("at", "value", "says"),
    [((3, 0, 3), np.nan, r"\[3, 0, 3\], in frame 3, is nan"), ((2, 3, 0), 0.5, r"frame 2 has the last row \[0.5, 0.0, 0.0, 1.0\]"),
     ((4, 1, 1), 0.0, "the matrix of frame 4 is flat")],
)  # fmt: skip
def test_a_matrix_that_is_no_place_is_named(tmp_path, at, value, says):
    place = matrices()
    place[at] = value
    np.save(tmp_path / "place.npy", place)
    with pytest.raises(UsageError, match=says):
        read_place(tmp_path / "place.npy", FRAMES)


def test_a_place_in_a_moved_field_feels_what_was_there_before():
    """Moved, turned and twice as large: at M y it is the force at y, turned and as strong."""
    field, points = waves(), np.random.default_rng(0).uniform(-0.8, 0.8, (20, 3))
    place = matrices(2.0 * QUARTER, (0.3, -1.0, 0.2))
    force, gradient = around(field, place, strength=1.5).felt(points @ place[0, :3, :3].T + place[0, :3, 3], 2)
    there, slope = extrapolate(field, points, 2)
    np.testing.assert_allclose(force, 1.5 * there @ QUARTER.T, atol=1e-9)
    np.testing.assert_allclose(gradient, 1.5 * QUARTER @ slope @ QUARTER.T / 2.0, atol=1e-9)


def test_a_mirrored_field_is_taken_for_a_turned_one_as_blender_does():
    np.testing.assert_allclose(rotation_of(np.diag([-1.0, 1.0, 1.0])), np.diag([1.0, -1.0, -1.0]))
    np.testing.assert_allclose(rotation_of(3.0 * QUARTER), QUARTER, atol=1e-12)


@pytest.mark.parametrize("reach", [Reach(), Reach(fade=0.5), Reach(falloff=(1.5, 2.0))])
def test_the_gradient_beside_the_box_is_that_of_what_is_left(reach):
    field, points, h = waves(), np.array([[1.2, 0.1, 0.3], [1.1, -1.3, 0.2], [0.4, 0.1, 0.0], [2.0, 0.0, 0.0]]), 1e-6
    _, gradient = around(field, None, reach).felt(points, 1)
    for axis in range(3):
        step = h * np.eye(3)[axis]
        ends = [around(field, None, reach).felt(points + sign * step, 1)[0] for sign in (1.0, -1.0)]
        np.testing.assert_allclose(gradient[:, :, axis], (ends[0] - ends[1]) / (2.0 * h), rtol=1e-4, atol=1e-3)


def test_what_is_left_beside_the_box():
    distance = np.array([0.0, 0.25, 0.5, 3.0])
    np.testing.assert_allclose(Reach(fade=0.5).left(distance)[0], [1.0, 0.5, 0.0, 0.0])
    np.testing.assert_allclose(Reach(falloff=(1.5, 2.0)).left(distance)[0], (1.5 / (1.5 + distance)) ** 2.0)
    np.testing.assert_allclose(Reach().left(distance)[0], 1.0)


def test_a_body_beside_a_field_that_fades_is_left_alone(folder):
    np.save(folder / "place.npy", matrices(shift=(-3.0, 0.0, 0.0)))
    for field in (uniform((600.0, 0.0, 0.0)), windy()):
        body = run(folder, BodyEdit("box", "box.obj", **SOFT), field=field, field_place="place.npy", fade=0.5)["box"]
        assert np.abs(body.vertices - body.vertices[0]).max() < 1e-9 and any("weakens there" in note for note in body.notes)


def seen(field, step=0.0):
    """A field that was recovered from a cube of particles around the origin, which moves along X by `step` [m] per frame."""
    side = np.linspace(-0.15, 0.15, 7)
    cube = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
    at = cube + np.arange(FRAMES)[:, None, None] * np.array([step, 0.0, 0.0])
    field.away = ConfidenceMap(at, np.ones(at.shape[:2]), 0.1).away
    return field


def test_a_field_that_fades_does_so_away_from_the_clips_object_wherever_that_is():
    """By the definition of docs/reference/edit.md, and its gradient by differences; without a fade nothing is weakened in the box."""
    rng, h = np.random.default_rng(1), 1e-6
    field, points = seen(waves(), 0.05), np.concatenate([rng.uniform(-each, each, (40, 3)) for each in (0.4, 1.2)])
    for frame in (0, 6):
        nearest = np.clip(points, *field.box)
        whole, _ = extrapolate(field, points, frame)
        force, gradient = extrapolate(field, points, frame, Reach(fade=0.8))
        left = 1.0
        for distance in (field.away(nearest, frame)[0], np.linalg.norm(points - nearest, axis=1)):
            s = np.clip(distance / 0.8, 0.0, 1.0)
            left = left * (1.0 - s**2 * (3.0 - 2.0 * s))
        np.testing.assert_allclose(force, left[:, None] * whole, atol=1e-9)
        assert (left < 0.01).any() and (left > 0.9).any()
        ends = [np.stack([extrapolate(field, points + sign * h * axis, frame, Reach(fade=0.8))[0] for axis in np.eye(3)], axis=-1)
                for sign in (1.0, -1.0)]  # fmt: skip
        np.testing.assert_allclose(gradient, (ends[0] - ends[1]) / (2.0 * h), atol=1e-4 * np.abs(gradient).max())
        inside = (nearest == points).all(axis=1)
        np.testing.assert_array_equal(extrapolate(field, points, frame, Reach(falloff=(1.5, 2.0)))[0][inside], whole[inside])


def test_bodies_feel_the_less_the_farther_they_are_from_the_clips_object(folder):
    """One in its place as if nothing faded, one right beside it nearly so, one in a corner of the box nothing; the user is told."""
    boxes = {"in its place": 0.0, "beside it": 0.3, "far": 0.8}
    for name, y in boxes.items():
        trimesh.creation.box((0.1,) * 3).apply_translation((0.0, y, -y)).export(folder / f"{name}.obj")
    bodies = [BodyEdit(name, f"{name}.obj", **SOFT) for name in boxes]
    whole, faded = (run(folder, *bodies, field=seen(uniform()), **edit) for edit in ({}, {"fade": 0.8}))
    moved = {name: np.linalg.norm(faded[name].vertices[-1] - faded[name].vertices[0], axis=1).mean() for name in boxes}
    as_far = np.linalg.norm(whole["far"].vertices[-1] - whole["far"].vertices[0], axis=1).mean()
    np.testing.assert_allclose(faded["in its place"].vertices, whole["in its place"].vertices, atol=1e-12)
    assert 0.7 * as_far < moved["beside it"] < 0.98 * as_far and moved["far"] < 1e-9
    assert [any("fades to 0 %" in note for note in faded[name].notes) for name in boxes] == [False, False, True]
    assert not any("fades" in note for body in whole.values() for note in body.notes)


def windy():
    field = uniform((5.0, 0.0, 0.0))
    field.kind = "wind"
    return field


@pytest.mark.parametrize(("edit", "says"), [
    ({"field_place": "none.npy"}, "There is no file"), ({"field_place": "flat.npy"}, "flat"), ({"field_place": "short.npy"}, "shape"),
    ({"fade": 0.5, "falloff": (1.0, 2.0)}, "both fade and falloff"), ({"falloff": (1.0, 0.0)}, "falloff is"),
])  # fmt: skip
def test_places_and_ends_that_make_no_sense_are_refused(folder, edit, says):
    np.save(folder / "flat.npy", matrices(np.diag([1.0, 1.0, 0.0])))
    np.save(folder / "short.npy", matrices()[:3])
    with pytest.raises(UsageError, match=says):
        run(folder, BodyEdit("box", "box.obj", **SOFT), **edit)
