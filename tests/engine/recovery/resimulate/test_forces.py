"""Further forces on a lattice move bodies, in addition to the field."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.recovery.resimulate.forces import read_forces
from seeing_wind.engine.settings import BodyEdit
from seeing_wind.engine.settings.tables import names_in
from tests.engine.recovery.resimulate.edits import BOX, FPS, FRAMES, SOFT, run, uniform

pytest.importorskip("trimesh")

NOTHING = {"field": uniform((0.0, 0.0, 0.0)), "forces": "forces.npz"}
BOX_MASS = 0.2**3 * 500.0
"""Mass [kg] of `box.obj` with the material `SOFT`."""


def lattice(folder, force, frames=FRAMES, **more) -> None:
    """Write a lattice of 3 x 3 x 3 nodes with the same values at all nodes: `force` (3,) or (T, 3) [N], and others in `more`."""

    def everywhere(value, inner):
        value = np.asarray(value, dtype=np.float32)
        value = np.broadcast_to(value, (frames, *value.shape[value.ndim - inner :]))
        return np.broadcast_to(value[:, None, None, None], (frames, 3, 3, 3, *value.shape[1:])).copy()

    inner = {"linear": 2, "quadratic": 0}
    np.savez(folder / "forces.npz", box=BOX, force=everywhere(force, 1), **{k: everywhere(v, inner[k]) for k, v in more.items()})


def velocity(body) -> np.ndarray:
    """Velocity (T, 3) [m/s] of the body's centre between frames."""
    return np.diff(body.vertices.mean(axis=1), axis=0) * FPS


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_a_body_accelerates_by_force_over_its_whole_mass(folder, factor):
    """As a particle of Blender of that mass, whatever its size and its density."""
    lattice(folder, (3.0, 0.0, 1.5))
    v = velocity(run(folder, BodyEdit("box", "box.obj", mass_scale=factor, **SOFT), **NOTHING)["box"])
    np.testing.assert_allclose((v[5] - v[1]) * FPS / 4.0, np.array([3.0, 0.0, 1.5]) / (BOX_MASS * factor), rtol=0.01, atol=1e-3)


def test_a_shell_accelerates_by_force_over_its_whole_mass(folder):
    lattice(folder, (0.0, 0.0, 0.02))
    v = velocity(run(folder, BodyEdit("flag", "flag.npz", material="cotton", mass=0.01), **NOTHING)["flag"])
    np.testing.assert_allclose((v[5] - v[1]) * FPS / 4.0, [0.0, 0.0, 2.0], rtol=0.01, atol=1e-3)


def test_forces_act_beside_the_field_and_follow_their_frames(folder):
    lattice(folder, (0.0, 0.0, 0.0))
    arrays = dict(np.load(folder / "forces.npz"))
    arrays["force"][4:, ..., 1] = 4.0
    np.savez(folder / "forces.npz", **arrays)
    v = velocity(run(folder, BodyEdit("box", "box.obj", **SOFT), field=uniform((600.0, 0.0, 0.0)), forces="forces.npz")["box"])
    assert np.abs(v[:4, 1]).max() < 1e-6
    np.testing.assert_allclose((v[7] - v[5])[1] * FPS / 2.0, 4.0 / BOX_MASS, rtol=0.02)
    np.testing.assert_allclose((v[5] - v[1])[0] * FPS / 4.0, 1.2, rtol=0.02)


def test_before_the_clip_the_first_frame_s_forces_act(folder):
    lattice(folder, (0.0, 0.0, 4.0))
    rest = run(folder, BodyEdit("box", "box.obj", **SOFT), **NOTHING)["box"].vertices.mean(axis=1)
    early = run(folder, BodyEdit("box", "box.obj", **SOFT), preroll=3, **NOTHING)["box"].vertices.mean(axis=1)
    np.testing.assert_allclose(early[: FRAMES - 2], rest[3:], atol=1e-6)


@pytest.mark.parametrize(("mesh", "material"), [("box.obj", SOFT), ("flag.npz", {"material": "cotton"})])
def test_a_drag_slows_what_moves_and_never_turns_it_round(folder, mesh, material):
    """m v' = -c v - q v²: after t, v = v0 e / (1 + q v0 (1 - e) / c) with e = exp(-c t / m). A hundred times that stops it."""
    mass, v0 = 2.0, 1.5
    for much, rtol in ((1.0, 0.06), (1000.0, None)):
        c, q = 4.0 * much, 2.0 * much
        lattice(folder, (0.0, 0.0, 0.0), linear=-c * np.eye(3), quadratic=q)
        v = velocity(run(folder, BodyEdit("b", mesh, mass=mass, velocity=(v0, 0.0, 0.0), **{**material, "density": None}), **NOTHING)["b"])
        e = np.exp(-c * (np.arange(FRAMES) + 0.5) / FPS / mass)
        truth = v0 * e / (1.0 + q * v0 * (1.0 - e) / c)
        if rtol is None:
            assert v[2:, 0].min() > -1e-3 and np.abs(v[2:, 0]).max() < 0.02
        else:
            np.testing.assert_allclose(v[:, 0], truth, rtol=rtol)


def test_a_magnet_turns_the_way_of_a_body_and_adds_no_speed(folder):
    lattice(folder, (0.0, 0.0, 0.0), linear=200.0 * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    v = velocity(run(folder, BodyEdit("box", "box.obj", velocity=(1.0, 0.0, 0.0), **SOFT), **NOTHING)["box"])
    assert np.linalg.norm(v, axis=1).max() < 1.02 and v[:, 1].min() < -0.1


def test_forces_are_linear_between_the_nodes_and_beside_the_box_those_of_its_edge(folder):
    x = np.linspace(-1.0, 1.0, 5)
    grid = np.stack(np.meshgrid(x, x, x, indexing="ij"), -1)
    np.savez(folder / "forces.npz", box=BOX, force=np.broadcast_to(grid @ np.diag([1.0, 2.0, 3.0]), (FRAMES, 5, 5, 5, 3)))
    forces = read_forces(folder / "forces.npz", FRAMES)
    points = np.array([[0.1, -0.3, 0.77], [5.0, 0.2, 0.0]])
    np.testing.assert_allclose(forces.at(points, 3).force, [[0.1, -0.6, 2.31], [1.0, 0.4, 0.0]], atol=1e-12)
    lattice(folder, (50.0, 0.0, 0.0))
    notes = run(folder, BodyEdit("box", "box.obj", velocity=(4.0, 0.0, 0.0), **SOFT), **NOTHING)["box"].notes
    assert any("leaves the box of the further forces in frame" in note for note in notes)


@pytest.mark.parametrize(("arrays", "said"), [
    ({"box": BOX}, "hold box"), ({"box": BOX, "force": np.zeros((2, 3, 3, 3, 3))}, r"force is float64 of shape \(2, 3"),
    ({"box": BOX, "force": np.zeros((FRAMES, 1, 3, 3, 3))}, "shape"), ({"box": BOX, "force": np.zeros((FRAMES, 3, 3, 3, 3), int)}, "int"),
    ({"box": BOX[::-1].copy(), "force": np.zeros((FRAMES, 3, 3, 3, 3))}, "The box"),
    ({"box": BOX, "force": np.full((FRAMES, 3, 3, 3, 3), np.nan)}, r"force\[0, 0, 0, 0, 0\] is nan"),
    ({"box": BOX, "force": np.zeros((FRAMES, 3, 3, 3, 3)), "quadratic": np.zeros((FRAMES, 3, 3, 3, 1))}, "quadratic is"),
])  # fmt: skip
def test_forces_that_do_not_fit_are_refused(folder, arrays, said):
    np.savez(folder / "forces.npz", **arrays)
    with pytest.raises(UsageError, match=said):
        run(folder, BodyEdit("box", "box.obj", **SOFT), **NOTHING)


def test_a_file_of_forces_that_is_not_there_is_named(folder):
    with pytest.raises(UsageError, match=r"forces.npz cannot be read"):
        run(folder, BodyEdit("box", "box.obj", **SOFT), **NOTHING)
    (folder / "edit.toml").write_text('forces = "forces.npz"\n[[body]]\nname = "b"\nmesh = "box.obj"\n')
    assert names_in(folder / "edit.toml") == ["forces.npz", "box.obj"], "a farm must take it along"
