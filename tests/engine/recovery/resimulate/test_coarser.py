"""A preview of an edit: fewer particles, longer substeps and fewer frames, but nearly the motion of the full result."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from seeing_wind.engine.mpm.shell import substeps_for, surface_of
from seeing_wind.engine.recovery.resimulate import simulate
from seeing_wind.engine.recovery.resimulate.coarser import coarser_sheet, fill_coarser
from seeing_wind.engine.recovery.resimulate.coarser.solid import ALIKE
from seeing_wind.engine.settings import BodyEdit
from tests.engine.recovery.resimulate.edits import FPS, FRAMES, SOFT, run, waves

trimesh = pytest.importorskip("trimesh")

HELD = {"density": 500.0, "youngs_modulus": 2e5, "loss_factor": 0.1}


@pytest.fixture
def models(monkeypatch) -> list:
    """The models that the solver was given."""
    made, choose = [], simulate.model_for

    def seen(*arguments, **options):
        chosen = choose(*arguments, **options)
        made.append(chosen[0])
        return chosen

    monkeypatch.setattr(simulate, "model_for", seen)
    return made


def block(folder, name: str, *size: float) -> BodyEdit:
    """A block as a file, its upper end's vertices in another."""
    mesh = trimesh.creation.box(size).subdivide().subdivide()
    np.savez(folder / f"{name}.npz", vertices=mesh.vertices, triangles=mesh.faces)
    np.save(folder / f"{name}.npy", np.flatnonzero(mesh.vertices[:, 2] > 0.499 * size[2]))
    return BodyEdit(name, f"{name}.npz", **HELD)


def off(coarse, full) -> float:
    """Distance of a preview from the full result, relative to how far the full result moves; both are root mean squares."""
    return float(np.linalg.norm(coarse.vertices - full.vertices) / np.linalg.norm(full.vertices - full.vertices[0]))


def test_a_preview_takes_a_fraction_of_the_work_and_moves_alike(folder, models):
    box, rod = BodyEdit("box", "box.obj", **SOFT), block(folder, "rod", 0.04, 0.04, 0.4)
    plate = dataclasses.replace(block(folder, "plate", 0.3, 0.02, 0.2), pin="plate.npy")
    bodies = box, rod, dataclasses.replace(rod, name="held", pin="rod.npy"), plate
    full = run(folder, *bodies, field=waves(6))
    whole = sum(len(model.mass) * model.substeps for model in models)
    models.clear()
    coarse = run(folder, *bodies, field=waves(6), coarseness=2.0)
    assert sum(len(model.mass) * model.substeps for model in models) < 0.1 * whole
    assert all(coarse[name].particles < 0.3 * full[name].particles for name in full)
    assert off(coarse["box"], full["box"]) < 0.01 and off(coarse["rod"], full["rod"]) < 0.01
    assert off(coarse["held"], full["held"]) < 0.05 and off(coarse["plate"], full["plate"]) < 0.3
    assert not any("preview" in note for body in coarse.values() for note in body.notes)


def test_a_stiffness_that_full_substeps_cannot_carry_is_softened_as_much(folder, models):
    stiff = BodyEdit("box", "box.obj", density=500.0, youngs_modulus=1e9)
    for coarseness in (1.0, 2.0):
        run(folder, stiff, field=waves(2), coarseness=coarseness)
    assert models[-1].substeps < 0.6 * models[0].substeps
    assert models[-1].mu[0] == pytest.approx(models[0].mu[0], rel=0.15)


def test_what_is_too_thin_keeps_its_particles_and_says_so(folder):
    flag = BodyEdit("flag", "flag.npz", shell=False, **SOFT)
    thin, plate = block(folder, "thin", 0.3, 0.005, 0.2), block(folder, "plate", 0.3, 0.02, 0.2)
    full, coarse = (run(folder, flag, thin, plate, field=waves(1), coarseness=value) for value in (1.0, 2.0))
    for name in ("flag", "thin"):
        assert coarse[name].particles == full[name].particles
        assert "as many particles as in full" in coarse[name].notes[-1]
        np.testing.assert_allclose(coarse[name].vertices, full[name].vertices, atol=1e-9)
    assert coarse["plate"].particles < 0.4 * full["plate"].particles


def test_a_coarser_lattice_takes_up_as_much_room(folder):
    for size in ((0.2, 0.2, 0.2), (0.04, 0.04, 0.4), (0.3, 0.03, 0.2), (0.11, 0.07, 0.05)):
        mesh = trimesh.creation.box(size)
        rooms = []
        for coarseness in (1.0, 2.0):
            filling, reached = fill_coarser(mesh.vertices, mesh.faces, coarseness)
            rooms.append(len(filling.particles.x) * filling.particles.spacing**3)
            assert filling.particles.volume.sum() == pytest.approx(np.prod(size)), "as heavy as it is"
        assert 1.3 < reached <= 2.0 and abs(rooms[1] / rooms[0] - 1.0) <= ALIKE


def test_bodies_that_push_each_other_are_all_as_fine_as_the_finest(folder):
    thin = dataclasses.replace(block(folder, "thin", 0.3, 0.005, 0.2), velocity=(0.0, 0.0, 0.0))
    bodies = BodyEdit("box", "box.obj", **SOFT), thin
    alone = run(folder, *bodies, field=waves(1), coarseness=2.0)
    together = run(folder, *bodies, field=waves(1), coarseness=2.0, contact=True)
    assert together["box"].particles > 4 * alone["box"].particles and together["thin"].particles == alone["thin"].particles


def sheet(folder, name: str, cells: int) -> BodyEdit:
    """A square of cotton that hangs from its upper edge as a file, level at first."""
    u, v = (each.ravel() for each in np.meshgrid(np.linspace(0.0, 0.4, cells + 1), np.linspace(-0.2, 0.2, cells + 1)))
    rows = np.arange(len(u)).reshape(cells + 1, cells + 1)
    a, b, c, d = (part.ravel() for part in (rows[:-1, :-1], rows[:-1, 1:], rows[1:, 1:], rows[1:, :-1]))
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    np.savez(folder / f"{name}.npz", vertices=np.stack([u, v, 0.0 * u], 1), triangles=triangles)
    np.save(folder / f"{name}.npy", np.flatnonzero(u == 0.0))
    return BodyEdit(name, f"{name}.npz", material="cotton", pin=f"{name}.npy")


def test_a_sheet_has_a_quarter_of_the_vertices_and_moves_alike(folder):
    body = sheet(folder, "sheet", 30)
    full, coarse = (run(folder, body, field=waves(16), coarseness=value)["sheet"] for value in (1.0, 2.0))
    assert full.shell and coarse.shell and substeps_for(FPS, 2.0) == substeps_for(FPS) / 2
    assert full.particles == 961 and coarse.particles < 300 and coarse.vertices.shape == full.vertices.shape
    assert 0.0 < off(coarse, full) < 0.1
    assert full.notes[0] == "simulated as a shell of 120 g/m², 19.2 g in all", "as the panel said before"
    assert f"with {coarse.particles} of its 961 vertices" in coarse.notes[1] and not any("preview" in note for note in full.notes)
    held = np.load(folder / "sheet.npy")
    assert np.abs(coarse.vertices[:, held] - full.vertices[:, held]).max() < 1e-9, "what is held stays where it is"
    assert np.abs(coarse.vertices[0] - full.vertices[0]).max() < 1e-9


def test_a_thinned_sheet_is_still_one(folder):
    shape = np.load(folder / sheet(folder, "sheet", 24).mesh)
    for bent in (0.0, 0.05):
        x, held = shape["vertices"].copy(), np.load(folder / "sheet.npy")
        x[:, 2] = bent * np.sin(12.0 * x[:, 0])
        full = surface_of(x, shape["triangles"])
        ridden = coarser_sheet(x, full.faces, np.isin(np.arange(len(x)), held), 2.0)
        left = surface_of(x[ridden.used], ridden.faces)
        assert len(left.x) < 0.33 * len(x) and left.area.sum() == pytest.approx(full.area.sum(), rel=0.01)
        assert {*np.flatnonzero((np.abs(x[:, 1]) > 0.199) & ((x[:, 0] < 1e-9) | (x[:, 0] > 0.399)))} <= {*ridden.used}, "its corners"
        turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
        np.testing.assert_allclose(ridden.follow(left.x[None] @ turn.T + 3.0)[0], x @ turn.T + 3.0, atol=1e-6)
    assert coarser_sheet(x[:40], shape["triangles"][:1], np.zeros(40, bool), 2.0) is None, "it has few vertices as it is"


def test_only_the_frames_that_are_asked_for(folder):
    box, flag = BodyEdit("box", "box.obj", **SOFT), BodyEdit("flag", "flag.npz", material="cotton")
    full, some = run(folder, box, flag), run(folder, box, flag, frames=3)
    more = run(folder, box, flag, frames=FRAMES + 5)
    for name in full:
        np.testing.assert_array_equal(some[name].vertices, full[name].vertices[:4])
        assert len(more[name].vertices) == FRAMES + 1
        said = f"frames is {FRAMES + 5}, but the field has {FRAMES}: only these are simulated"
        assert said in more[name].notes and said not in full[name].notes
    np.testing.assert_array_equal(run(folder, box, frames=3, preroll=2)["box"].vertices, run(folder, box, preroll=2)["box"].vertices[:4])
