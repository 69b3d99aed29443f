"""Trajectory files of sheets: what is read, and what is refused in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.command.trajectories.sheets import is_sheet, read_sheet
from seeing_wind.engine.command.verbs import VERBS
from seeing_wind.engine.errors import SeeingWindError
from seeing_wind.engine.materials import SHEETS, find
from seeing_wind.engine.progress import NoProgress

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0.0]])
FACES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
FALL = np.stack([SQUARE - [0, 0, 4.9 * (t / 24) ** 2] for t in range(6)])
SHEET = {"areal_density": 0.1, "thickness": 4e-4, "E": 1e6}
WHOLE: dict[str, Any] = {"x": FALL, "faces": FACES, "fps": 24.0, "gravity": [0, 0, -9.81], **SHEET}


def write(path: Path, without: str = "", **values: Any) -> Path:
    np.savez(path, **{key: value for key, value in {**WHOLE, **values}.items() if key != without})
    return path


def test_what_the_file_says(tmp_path: Path) -> None:
    path = write(tmp_path / "t.npz", nu=0.2, damping=0.05, sigma=1e-3, wind=np.zeros((5, 5, 3)))
    source, gravity, notes = read_sheet(path)
    assert is_sheet(path) and gravity == (0.0, 0.0, -9.81) and notes == []
    assert (source.fps, source.sigma, source.sheet.areal_density, source.sheet.loss_factor) == (24.0, 1e-3, 0.1, 0.05)
    assert source.sheet.tensile_stiffness == pytest.approx(400.0)
    assert source.sheet.bending_stiffness == pytest.approx(1e6 * 6.4e-11 / 12.0)


def test_what_options_say_instead(tmp_path: Path) -> None:
    path = write(tmp_path / "t.npz")
    source, gravity, notes = read_sheet(path, gravity=[0.0, 0.0, 0.0], youngs_modulus=2e6, density=500.0)
    assert source.sheet.tensile_stiffness == pytest.approx(800.0) and source.sheet.areal_density == pytest.approx(0.2)
    assert gravity == (0.0, 0.0, 0.0) and any("nu" in note for note in notes)
    preset, _, notes = read_sheet(path, find("cotton"))
    assert preset.sheet.areal_density == SHEETS["cotton"].areal_density and "areal_density" in notes[0]


def test_a_file_without_faces_is_no_sheet(tmp_path: Path) -> None:
    assert not is_sheet(write(tmp_path / "t.npz", without="faces"))
    assert not is_sheet(tmp_path / "none.npz")


@pytest.mark.parametrize("missing", ["areal_density", "thickness", "E", "x", "fps"])
def test_a_missing_key_is_named(tmp_path: Path, missing: str) -> None:
    with pytest.raises(SeeingWindError, match=missing):
        read_sheet(write(tmp_path / "t.npz", without=missing))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"faces": FACES + 2}, "vertex 6"),
        ({"faces": FACES - 1}, "vertex -1"),
        ({"faces": FACES.astype(float)}, "faces"),
        ({"faces": FACES[:, :2]}, "faces"),
        ({"faces": np.zeros((0, 3), int)}, "faces"),
        ({"faces": np.concatenate([FACES, FACES[:1, ::-1]])}, "twice"),
        ({"areal_density": 0.0}, "areal_density is 0 kg/m²."),
        ({"areal_density": np.nan}, "areal_density"),
        ({"thickness": -1.0}, "thickness is -1 m."),
        ({"E": 0.0}, "E, Young's modulus, is 0 Pa."),
        ({"E": 1e20}, "t.npz: E, Young's modulus, is 1e+20 Pa."),
        ({"nu": 0.7}, "t.npz: nu, Poisson's ratio, is 0.7."),
        ({"damping": -1.0}, "t.npz: damping, the loss factor, is -1."),
        ({"x": FALL[:2]}, "frames"),
        ({"x": np.where(np.arange(6)[:, None, None] == 3, np.nan, FALL)}, "not finite"),
        ({"fixed": np.ones(5, bool)}, "fixed"),
        ({"visible": np.arange(30).reshape(6, 5) != 17}, "not visible"),
        ({"sigma": -1.0}, "sigma"),
    ],
)
def test_bad_input_is_refused(tmp_path: Path, wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(SeeingWindError) as refused:
        read_sheet(write(tmp_path / "t.npz", **wrong))
    assert said in refused.value.message and refused.value.hint


def test_plastic_options_and_solids_are_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "t.npz")
    with pytest.raises(SeeingWindError, match="plastic"):
        read_sheet(path, yield_stress=1e4)
    with pytest.raises(SeeingWindError, match="not known as a sheet"):
        read_sheet(path, find("foam"))


@pytest.mark.parametrize(
    ("wrong", "options"),
    [({"x": np.concatenate([FALL, FALL[:, :1]], axis=1)}, []), ({"faces": FACES[:, [0, 0, 2]]}, []), ({}, ["--schedule", "paper"])],
)
def test_the_verb_refuses_before_it_works(tmp_path: Path, wrong: dict[str, Any], options: list[str]) -> None:
    """A vertex without a face, faces without area, a schedule that shells do not have."""
    words = ["recover-trajectories", str(write(tmp_path / "t.npz", **wrong)), "--take", str(tmp_path / "take")]
    arguments = parser().parse_args([*words, *options])
    with pytest.raises(SeeingWindError):
        VERBS[arguments.verb](arguments, NoProgress())
    assert not (tmp_path / "take" / "field.safetensors").exists()
