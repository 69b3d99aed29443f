"""Force fields and winds that act together: a free plate and a sheet against closed forms, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.field.analytic import ForceFieldAnalytic
from seeing_wind.engine.materials import SHEETS
from seeing_wind.engine.recovery.resimulate import simulate_bodies
from seeing_wind.engine.recovery.resimulate.fill import fill
from seeing_wind.engine.settings import BodyEdit, Edit, FieldEdit
from seeing_wind.engine.settings.tables import names_in, read_edit

FPS, FRAMES, SPEED, SIZE = 60.0, 10, 3.0, 0.2
BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 3.0]])
TIMES = np.arange(FRAMES + 1) / FPS
MASS = 0.4 * SIZE**2
PLATE = BodyEdit("plate", "square.npz", law="corotated", youngs_modulus=2e4, poisson_ratio=0.3, mass=MASS, shell=False)
COTTON = BodyEdit("plate", "square.npz", material="cotton")


def field(kind: str, along_z: float, frames: int = FRAMES, fps: float = FPS, box: np.ndarray = BOX) -> ForceFieldAnalytic:
    """Uniform along Z, in N/m³ or m/s."""
    uniform = np.tile([0.0, 0.0, along_z], (frames, 1))
    made = ForceFieldAnalytic(box, fps, frames, uniform, np.zeros((0, 3)), np.zeros(0), np.zeros((frames, 0, 3)))
    made.kind = kind
    return made


@pytest.fixture
def folder(tmp_path: Path, sheet) -> Path:
    """A square across Z."""
    vertices, triangles = sheet(SIZE, SIZE, 10, 10)
    np.savez(tmp_path / "square.npz", vertices=vertices[:, [0, 2, 1]] - [0.5 * SIZE, 0.5 * SIZE, 0.0], triangles=triangles)
    return tmp_path


def pushing(folder: Path, body: BodyEdit, acceleration: float) -> float:
    """The force density [N/m³] that gives a free body this acceleration [m/s²]."""
    if body is COTTON:
        return acceleration * SHEETS["cotton"].areal_density / SHEETS["cotton"].thickness
    with np.load(folder / "square.npz") as mesh:
        return acceleration * MASS / float(fill(mesh["vertices"], mesh["triangles"]).particles.volume.sum())


def slowing(body: BodyEdit) -> float:
    """k [1/m] of dv/dt = k (u - v)² across the wind."""
    return 1.2 * 1.17 / (2.0 * (SHEETS["cotton"].areal_density if body is COTTON else 0.4))


def moved(folder: Path, body: BodyEdit, main: ForceFieldAnalytic, *others: ForceFieldAnalytic, **more) -> np.ndarray:
    """Way (T+1,) [m] of the body's middle along Z."""
    further = []
    for number, other in enumerate(others):
        other.save(folder / f"{number}.safetensors")
        further.append(FieldEdit(f"{number}.safetensors", **more))
    edit = Edit((body,), gravity=(0.0, 0.0, 0.0), further_field=tuple(further))
    return simulate_bodies(edit, main, None, folder)["plate"].vertices[..., 2].mean(axis=1)


BOTH = pytest.mark.parametrize("body", [PLATE, COTTON], ids=["solid", "shell"])


@BOTH
@pytest.mark.parametrize("first", ["force", "wind"])
def test_a_force_and_a_wind_add_up(folder, body, first):
    """dw/dt = -a - k w² for w = u - v: w = sqrt(a / k) tan(p - sqrt(a k) t), and the way is the integral of u - w."""
    a, k = 2.0, slowing(body)
    both = [field("force", pushing(folder, body, a)), field("wind", SPEED)]
    way = moved(folder, body, *(both if first == "force" else both[::-1]))
    p, s = np.arctan(SPEED * np.sqrt(k / a)), np.sqrt(a * k)
    assert (p - s * TIMES > 0.0).all(), "it does not overtake the wind yet, where the closed form ends"
    expected = SPEED * TIMES - (np.log(np.cos(p - s * TIMES)) - np.log(np.cos(p))) / k
    alone = SPEED * TIMES - np.log1p(k * SPEED * TIMES) / k, 0.5 * a * TIMES**2
    assert min(abs(expected[-1] - one[-1]) for one in alone) > 0.05 * way[-1]
    np.testing.assert_allclose(way[-1], expected[-1], rtol=0.03)


@BOTH
def test_a_force_that_balances_the_wind_holds_a_body_where_it_is(folder, body):
    balance = field("force", pushing(folder, body, -slowing(body) * SPEED**2))
    alone = moved(folder, body, field("wind", SPEED))[-1]
    assert abs(moved(folder, body, field("wind", SPEED), balance)[-1]) < 0.01 * alone


@BOTH
def test_forces_add_up_as_forces_and_winds_as_velocities(folder, body):
    force, half = pushing(folder, body, 4.0), pushing(folder, body, 2.0)
    together = moved(folder, body, field("force", half), field("force", half))
    np.testing.assert_allclose(together, moved(folder, body, field("force", force)), rtol=1e-6, atol=1e-9)
    together = moved(folder, body, field("wind", 0.25 * SPEED), field("wind", 1.5 * SPEED), strength=0.5)
    np.testing.assert_allclose(together, moved(folder, body, field("wind", SPEED)), rtol=1e-6, atol=1e-9)


def test_a_further_field_stands_and_fades_by_itself(folder):
    """Turned upside down, it pushes the other way; far away, it fades to nothing."""
    force = pushing(folder, PLATE, 4.0)
    np.save(folder / "place.npy", np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (FRAMES, 1, 1)))
    turned = moved(folder, PLATE, field("force", force), field("force", force), place="place.npy")
    assert np.abs(turned).max() < 1e-6
    far = field("force", force, box=BOX + [50.0, 0.0, 0.0])
    np.testing.assert_allclose(moved(folder, PLATE, field("force", force), far, fade=1.0), moved(folder, PLATE, field("force", force)))


def test_notes_name_the_field_that_they_are_about(folder):
    far = field("force", 1.0, box=BOX + [50.0, 0.0, 0.0])
    far.save(folder / "far.safetensors")
    for name, called in ((None, "far.safetensors"), ("Breeze", "Breeze")):
        edit = Edit((PLATE,), gravity=(0.0, 0.0, 0.0), further_field=(FieldEdit("far.safetensors", name),))
        notes = simulate_bodies(edit, field("force", 1.0), None, folder)["plate"].notes
        assert [note for note in notes if "box" in note] == [
            f"up to 100 % of it lies outside {called}'s box, first in frame 0; the force there is that of the box's edge"
        ]


@pytest.mark.parametrize(
    ("other", "more", "says"),
    [
        (field("wind", 1.0, fps=24.0), {}, "has 10 frames, 24 a second, and the take's field 10 frames, 60 a second.*same frame rate"),
        (field("wind", 1.0, frames=9), {}, "has 9 frames.*at least as many frames"),
        (field("wind", 1.0), {"strength": (1.0, 2.0)}, "The strength of 0.safetensors has 2 values for 10 frames"),
        (field("wind", 1.0), {"fade": 1.0, "falloff": (1.0, 2.0)}, "both fade and falloff for 0.safetensors"),
        (field("wind", 1.0), {"place": "none.npy"}, "There is no file .*none.npy"),
    ],
)  # fmt: skip
def test_further_fields_that_do_not_fit_are_refused(folder, other, more, says):
    with pytest.raises(UsageError, match=says) as raised:
        moved(folder, PLATE, field("force", 1.0), other, **more)
    assert raised.value.hint


def test_an_edit_names_its_further_fields(tmp_path):
    path = tmp_path / "edit.toml"
    path.write_text('[[body]]\nname = "a"\nmesh = "a.obj"\n[[further_field]]\nfile = "b.take/wind.safetensors"\nplace = "b.npy"\n')
    assert read_edit(path).further_field == (FieldEdit("b.take/wind.safetensors", place="b.npy"),)
    assert set(names_in(path)) == {"a.obj", "b.take/wind.safetensors", "b.npy"}


def test_two_further_fields_of_one_name_are_refused(tmp_path):
    path, field_of = tmp_path / "edit.toml", '[[further_field]]\nfile = "{}"\nname = "Breeze"\n'.format
    path.write_text('[[body]]\nname = "a"\nmesh = "a.obj"\n' + field_of("b.safetensors") + field_of("c.safetensors"))
    with pytest.raises(UsageError, match=r"Two further fields of .* are named Breeze\."):
        read_edit(path)
