"""3D trajectories from files: what is read, and what is refused in one sentence."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seeing_wind.engine.errors import SeeingWindError, UsageError
from seeing_wind.engine.trajectories import read_trajectories

LATTICE = 0.1 * np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
FALL = np.stack([LATTICE - [0, 0, 4.9 * (t / 24) ** 2] for t in range(6)])


def write(path: Path, **values: Any) -> Path:
    np.savez(path, **{"x": FALL, "fps": 24.0, **values})
    return path


def test_what_the_file_says(tmp_path: Path) -> None:
    source = read_trajectories(write(tmp_path / "t.npz", rho=500.0, E=1e4, nu=0.2, gravity=[0, 0, -1.6], v=np.zeros(1)))
    assert source.fps == 24.0 and source.gravity == (0.0, 0.0, -1.6) and source.particles.spacing == pytest.approx(0.1)
    assert (source.material.density, source.material.youngs_modulus, source.material.poisson_ratio) == (500.0, 1e4, 0.2)
    assert read_trajectories(write(tmp_path / "t.npz")).gravity == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"fps": 0.0},
        {"fps": float("nan")},
        {"fps": [24.0, 25.0]},
        {"fps": "fast"},
        {"gravity": [1.0, 2.0]},
        {"gravity": [0.0, 0.0, float("nan")]},
        {"gravity": 9.81},
        {"rho": np.ones(27)},
        {"rho": 0.0},
        {"yield_stress": -1.0},
        {"x": "abc"},
        {"x": FALL[:2]},
        {"x": np.where(np.arange(6)[:, None, None] == 2, np.nan, FALL)},
        {"x": np.zeros((6, 27, 3))},
        {"fixed": np.ones(3, bool)},
        {"fixed": ["False"] * 27},
        {"fixed": np.full(27, np.nan)},
    ],
)
def test_wrong_values_are_refused(tmp_path: Path, wrong: dict[str, Any]) -> None:
    with pytest.raises(SeeingWindError) as caught:
        read_trajectories(write(tmp_path / "t.npz", **wrong))
    assert caught.value.message and caught.value.hint


def test_what_is_assumed_or_contradicts_itself_is_told(tmp_path: Path) -> None:
    assert read_trajectories(write(tmp_path / "t.npz", rho=500.0, E=1e4, nu=0.2, gravity=np.zeros(3))).notes == ()
    lacking, weightless = read_trajectories(write(tmp_path / "t.npz", E=1e4)).notes
    assert "rho (300 kg/m³), nu (0.3)" in lacking and "no gravity" in weightless
    fixed = np.arange(27) < 5
    assert any("held move by up to 2.1e+02 mm" in note for note in read_trajectories(write(tmp_path / "t.npz", fixed=fixed)).notes)


@pytest.mark.parametrize("content", [b"", b"garbage", b"PK\x03\x04garbage"])
def test_files_that_are_no_archive_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "t.npz").write_bytes(content)
    with pytest.raises(UsageError, match="no NPZ"):
        read_trajectories(tmp_path / "t.npz")
    np.save(tmp_path / "t.npy", FALL)
    with pytest.raises(UsageError, match="no NPZ"):
        read_trajectories(tmp_path / "t.npy")
