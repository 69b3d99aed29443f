"""Open meshes of thin materials become shells: their mass, their motion, and which edits are refused."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from seeing_wind.engine.errors import MaterialError, SimulationError, UsageError
from seeing_wind.engine.materials import SHEETS
from seeing_wind.engine.progress import Cancelled, NoProgress, Progress
from seeing_wind.engine.recovery import journal as journals
from seeing_wind.engine.recovery.journal import TakeJournal
from seeing_wind.engine.recovery.resimulate import simulate_bodies
from seeing_wind.engine.recovery.resimulate.sheets import enter, is_shell, sheet_of
from seeing_wind.engine.settings import BodyEdit, ColliderEdit, Edit
from seeing_wind.engine.take import Take
from tests.engine.fields import UniformField

trimesh = pytest.importorskip("trimesh")
BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


@pytest.fixture
def folder(tmp_path, sheet):
    vertices, triangles = sheet(0.4, 0.4, 6, 6)
    np.savez(tmp_path / "curtain.npz", vertices=vertices, triangles=triangles)
    np.save(tmp_path / "rail.npy", np.flatnonzero(vertices[:, 2] > 0.399))
    np.save(tmp_path / "side.npy", np.flatnonzero(vertices[:, 0] < 1e-6))
    trimesh.creation.box((0.2, 0.2, 0.2)).export(tmp_path / "box.obj")
    return tmp_path


def run(folder, *bodies, force=(0.0, 0.0, 0.0), frames=6, gravity=(0.0, 0.0, -9.81), progress=NoProgress(), **edit):
    field = UniformField(BOX, 24.0, frames, np.array(force))
    return simulate_bodies(Edit(body=bodies, gravity=gravity, **edit), field, None, folder, progress)


def edges(vertices, triangles):
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return np.linalg.norm(vertices[..., ends[:, 0], :] - vertices[..., ends[:, 1], :], axis=-1)


def test_cotton_weighs_what_cotton_weighs_and_hangs(folder):
    """A curtain on its rail: a straight fall of the cloth, no edge longer by a thousandth, and its mass said."""
    body = run(folder, BodyEdit("curtain", "curtain.npz", material="cotton", pin="rail.npy"))["curtain"]
    rest = np.load(folder / "curtain.npz")["vertices"]
    assert re.search(r"120 g/m², 19\.2 g", body.notes[0])
    assert body.vertices.shape == (7, 49, 3) and body.particles == 49
    np.testing.assert_array_equal(body.vertices[0], rest)
    np.testing.assert_allclose(body.vertices[-1], rest, atol=1e-3)
    np.testing.assert_allclose(edges(body.vertices, body.triangles), np.broadcast_to(edges(rest, body.triangles), (7, 216)), rtol=1e-3)


def test_a_flag_held_at_its_side_falls_together_without_tearing(folder):
    body = run(folder, BodyEdit("flag", "curtain.npz", material="silk", pin="side.npy"), force=(100.0, 60.0, 0.0), frames=8)["flag"]
    rest = np.load(folder / "curtain.npz")["vertices"]
    grown = edges(body.vertices, body.triangles) / edges(rest, body.triangles)
    assert grown.max() < 1.01
    assert np.abs(body.vertices[-1] - rest).max() > 0.05
    assert not any("torn" in note for note in body.notes)


def test_a_free_sheet_accelerates_by_force_thickness_over_areal_density(folder):
    edit = BodyEdit("sheet", "curtain.npz", material="wool")
    body = run(folder, edit, force=(300.0, 0.0, 0.0), frames=4, gravity=(0.0, 0.0, 0.0))["sheet"]
    rate = 300.0 * SHEETS["wool"].thickness / SHEETS["wool"].areal_density
    t = np.arange(5) / 24.0
    np.testing.assert_allclose((body.vertices - body.vertices[0]).mean(axis=1), np.outer(0.5 * rate * t**2, [1.0, 0.0, 0.0]), atol=1e-6)


def test_what_becomes_a_shell(folder):
    curtain, box = np.load(folder / "curtain.npz"), trimesh.load_mesh(folder / "box.obj")
    open_mesh, closed = (curtain["vertices"], curtain["triangles"]), (np.asarray(box.vertices), np.asarray(box.faces))
    body = BodyEdit("b", "x.obj", material="cotton")
    assert is_shell(body, *open_mesh) and not is_shell(body, *closed)
    assert not is_shell(dataclasses.replace(body, material="rubber"), *open_mesh)
    assert not is_shell(dataclasses.replace(body, shell=False), *open_mesh)
    assert is_shell(dataclasses.replace(body, shell=True), *closed)
    with pytest.raises(UsageError, match="thickness is given, but it is no shell"):
        is_shell(dataclasses.replace(body, material="rubber", thickness=1e-3), *open_mesh)


def test_own_numbers_replace_the_materials(folder):
    body = BodyEdit("b", "x.obj", material="cotton")
    assert sheet_of(body, 1.0) == SHEETS["cotton"]
    own = dataclasses.replace(body, areal_density=0.5, thickness=1e-3, tensile_stiffness=2e3, bending_stiffness=1e-4, loss_factor=0.4)
    found = sheet_of(own, 1.0)
    assert (found.areal_density, found.thickness, found.tensile_stiffness) == (0.5, 1e-3, 2e3)
    assert (found.bending_stiffness, found.loss_factor) == (1e-4, 0.4)
    assert sheet_of(dataclasses.replace(body, mass=0.3, mass_scale=2.0), 1.5).areal_density == pytest.approx(0.4)
    assert sheet_of(dataclasses.replace(body, density=1000.0), 1.0).areal_density == pytest.approx(1000.0 * SHEETS["cotton"].thickness)
    plate = sheet_of(dataclasses.replace(body, youngs_modulus=1e6, youngs_modulus_scale=3.0, thickness=1e-3), 1.0)
    assert plate.tensile_stiffness == pytest.approx(3e3) and plate.bending_stiffness == pytest.approx(3.0 * 1e6 * 1e-9 / 12.0)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"youngs_modulus": 1e20}, MaterialError, "Young's modulus of cotton is 100,000,000,000 GPa"),
        ({"tensile_stiffness": 1e25}, SimulationError, "Check that its weight and stiffness are those of a sheet"),
        ({"material": "rubber", "shell": True}, UsageError, "^b: rubber is not known .* areal_density, .* bending_stiffness are missing"),
        ({"law": "von_mises", "yield_stress": 10.0}, UsageError, "no plastic law"),
        ({"areal_density": -1.0}, MaterialError, "areal density"),
        ({"mesh": "recovered", "shell": True}, UsageError, "there is no recovered object"),
    ],
)
def test_what_does_not_fit_is_refused(folder, change, error, words):
    body = dataclasses.replace(BodyEdit("b", "curtain.npz", material="cotton"), **change)
    with pytest.raises(error, match=words):
        run(folder, body)


def test_a_mesh_that_is_no_sheet_is_refused_with_its_name(folder, sheet):
    vertices, triangles = sheet(0.4, 0.4, 2, 2)
    np.savez(folder / "loose.npz", vertices=np.vstack([vertices, [[2.0, 2.0, 2.0]]]), triangles=triangles)
    with pytest.raises(UsageError, match="rag: Vertex 9 of the sheet belongs to no face"):
        run(folder, BodyEdit("rag", "loose.npz", material="cotton"))


def test_vertices_repeated_at_a_seam_move_as_one(folder, sheet):
    vertices, triangles = sheet(0.4, 0.4, 2, 2)
    split = np.vstack([vertices, vertices])
    faces = np.concatenate([triangles[:4], triangles[4:] + len(vertices)])
    keep = np.unique(faces)
    np.savez(folder / "split.npz", vertices=split[keep], triangles=np.searchsorted(keep, faces))
    hanging = enter(BodyEdit("b", "split.npz", material="cotton"), split[keep], np.searchsorted(keep, faces), folder, 6)
    assert len(hanging.shell.mass) == 9 < len(keep) == len(hanging.vertex)
    body = run(folder, BodyEdit("b", "split.npz", material="cotton"), frames=2)["b"]
    assert body.vertices.shape == (3, len(keep), 3)


def test_a_soft_pin_is_a_spring(folder):
    """A free sheet held everywhere with weight 1/2 under gravity swings about g / 24² lower."""
    np.save(folder / "all.npy", np.arange(49))
    np.save(folder / "half.npy", np.full(49, 0.5))
    body = run(folder, BodyEdit("b", "curtain.npz", material="cotton", pin="all.npy", pin_weights="half.npy"), frames=13)["b"]
    drop = body.vertices[0, :, 2].mean() - body.vertices[:, :, 2].mean(axis=1)
    t = np.arange(14) / 24.0
    np.testing.assert_allclose(drop, 9.81 / 24.0**2 * (1.0 - np.cos(24.0 * t)), atol=2e-3)


def test_a_sheet_stays_where_it_is_until_its_frame_and_falls_on_the_floor(folder):
    floor = ColliderEdit("floor", plane=(0.0, 0.0, -0.05, 0.0, 0.0, 1.0))
    body = run(folder, BodyEdit("b", "curtain.npz", material="paper", start_frame=2), frames=8, collider=(floor,))["b"]
    np.testing.assert_array_equal(body.vertices[2], body.vertices[0])
    assert body.vertices[-1, :, 2].min() == pytest.approx(-0.05, abs=1e-3)


def test_a_cancelled_run_goes_on_to_the_same_end(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(journals, "SOONEST", 0.0)
    monkeypatch.setattr(journals, "COST", 0.0)
    edit = Edit(body=(BodyEdit("b", "curtain.npz", material="cotton", pin="side.npy"),))
    field = UniformField(BOX, 24.0, 5, np.array([50.0, 20.0, 0.0]))
    whole = simulate_bodies(edit, field, None, folder)["b"].vertices
    seen: list[str] = []
    progress = Progress(lambda message: seen.append(message.get("message", "")), lambda: len(seen) > 2)
    take = Take(tmp_path / "out.take")
    take.path.mkdir()
    with pytest.raises(Cancelled), TakeJournal(take, "stamp", progress) as journal:
        simulate_bodies(edit, field, None, folder, progress, journal=journal)
    assert seen[0] == "frame 1 of 5: b"
    again: list[str] = []
    watching = Progress(lambda message: again.append(message.get("message", "")))
    with TakeJournal(take, "stamp", watching) as journal:
        resumed = simulate_bodies(edit, field, None, folder, watching, journal=journal)["b"].vertices
    assert again[0] != "frame 1 of 5: b"
    np.testing.assert_array_equal(resumed, whole)


def test_a_shell_says_that_it_touches_no_other_body(folder):
    bodies = BodyEdit("cloth", "curtain.npz", material="cotton"), BodyEdit("rag", "curtain.npz", material="silk", velocity=(0.0, 1.0, 0.0))
    done = run(folder, *bodies, frames=1, contact=True)
    assert list(done) == ["cloth", "rag"]
    assert any("does not push other bodies" in note for note in done["cloth"].notes)


def swing(rest: np.ndarray, frames: int) -> np.ndarray:
    """Positions (T+1, P, 3) of points that are turned by half a radian about the vertical through the origin and lifted by 0.2 m."""
    way = []
    for share in np.linspace(0.0, 1.0, frames + 1):
        c, s = np.cos(0.5 * share), np.sin(0.5 * share)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        way.append(rest @ turn.T + [0.0, 0.0, 0.2 * share])
    return np.stack(way)


def test_a_curtain_follows_its_rail(folder):
    rest, rail = np.load(folder / "curtain.npz")["vertices"], np.load(folder / "rail.npy")
    way = swing(rest[rail], 24)
    shuffled = np.random.default_rng(0).permutation(len(rail))
    np.save(folder / "order.npy", rail[shuffled])
    np.save(folder / "way.npy", way[:, shuffled])
    body = run(folder, BodyEdit("b", "curtain.npz", material="cotton", pin="order.npy", pin_path="way.npy"), frames=24)["b"]
    np.testing.assert_allclose(body.vertices[:, rail], way, atol=1e-9)
    assert np.abs(edges(body.vertices, body.triangles) / edges(rest, body.triangles) - 1.0).max() < 0.02, "the cloth comes along"


def test_cloth_has_settled_when_the_clip_begins(folder):
    """Held along a side, it falls; after two seconds of preroll it hangs, and the clip begins there."""
    body = BodyEdit("b", "curtain.npz", material="wool", loss_factor=1.0, pin="side.npy")
    falls = run(folder, body, frames=8)["b"].vertices
    hangs = run(folder, body, frames=8, preroll=48)["b"].vertices
    assert len(hangs) == len(falls) == 9
    way = [np.linalg.norm(each[1:] - each[:-1], axis=-1).max() for each in (falls, hangs)]
    assert way[1] < 0.2 * way[0]
    assert np.linalg.norm(hangs[0] - falls[0], axis=-1).max() > 0.005, "it has sagged"
    with pytest.raises(UsageError, match="preroll"):
        run(folder, body, preroll=-1)


def test_a_body_that_starts_later_does_not_settle(folder):
    waits = BodyEdit("b", "curtain.npz", material="cotton", pin="side.npy", start_frame=3)
    np.testing.assert_allclose(run(folder, waits, preroll=5)["b"].vertices, run(folder, waits)["b"].vertices, atol=1e-9)


@pytest.mark.parametrize(
    "way, says",
    [
        (np.zeros((7, 3, 3)), "shape"), (np.zeros((6, 7, 3)), "shape"), (np.full((7, 7, 3), np.nan), "frame 0, is nan"),
        (np.zeros((7, 7, 3), int), "int"),
    ],
)
def test_ways_of_pins_that_are_refused(folder, way, says):
    np.save(folder / "way.npy", way)
    with pytest.raises(UsageError, match=says):
        run(folder, BodyEdit("b", "curtain.npz", material="cotton", pin="rail.npy", pin_path="way.npy"))
    with pytest.raises(UsageError, match="pin_path needs"):
        run(folder, BodyEdit("b", "curtain.npz", material="cotton", pin_path="way.npy"))
    with pytest.raises(UsageError, match="start_frame"):
        run(folder, BodyEdit("b", "curtain.npz", material="cotton", pin="rail.npy", pin_path="way.npy", start_frame=1))
