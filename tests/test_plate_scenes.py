"""The sample scenes of held things build themselves from a seed. Small settings, no rendering."""

from __future__ import annotations

import json
import os
import runpy
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from seeing_wind.engine.field import load_field
from seeing_wind.engine.look.report.accuracy import uniform_errors

SCENES = Path(__file__).resolve().parents[1] / "sample_scenes"


@pytest.fixture(scope="module", params=["flag", "potted_plant"])
def built(request, tmp_path_factory) -> tuple[dict, Path]:
    """The script's names, and a folder with a clip of three intervals without its frames."""
    script = runpy.run_path(str(SCENES / request.param / "make.py"), run_name="make")
    out = tmp_path_factory.mktemp(request.param)
    assert script["main"](["--out", str(out), "--frames", "3", "--no-render", "--spacing", "0.016"]) == 0
    return script, out


@pytest.mark.parametrize("package", ["numpy", "taichi"])
@pytest.mark.parametrize("script", ["flag/make", "potted_plant/make", "falling_leaf/make"])
def test_a_missing_package_is_told_in_a_sentence(tmp_path: Path, script: str, package: str) -> None:
    (tmp_path / f"{package}.py").write_text(f'raise ModuleNotFoundError("No module named {package}", name="{package}")')
    call = [sys.executable, str(SCENES / f"{script}.py"), "--out", str(tmp_path / "out"), "--no-render", "--frames", "3"]
    ended = subprocess.run(call, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(tmp_path)}, timeout=300)
    assert ended.returncode == 1
    assert ended.stderr == f"The engine's Python lacks the package {package}. Run Install Engine, or `make setup`.\n"


def test_what_is_held_stays_and_the_rest_moves(built):
    truth = np.load(built[1] / "truth.npz", allow_pickle=False)
    moved = np.linalg.norm(truth["x"] - truth["x"][0], axis=-1).max(0)
    assert truth["fixed"].any() and not truth["fixed"].all()
    assert moved[truth["fixed"]].max() < 1e-6 and 1e-4 < moved.max() < 0.2


def test_the_known_wind_is_what_moved_it_and_is_not_uniform(built):
    truth, wind = np.load(built[1] / "truth.npz", allow_pickle=False), load_field(built[1] / "known_wind.safetensors")
    for t in range(3):
        np.testing.assert_allclose(wind.sample(truth["x"][t], t)[0], truth["rho"] * truth["acc"][t], rtol=1e-9, atol=1e-6)
    magnitude, direction = uniform_errors(truth["acc"], ~truth["fixed"])
    assert magnitude > 5.0 and direction > 3.0
    # free of divergence, as air is
    points = np.random.default_rng(0).uniform(*wind.box, (40, 3))
    gradient = wind.gradient(points, 1)
    assert np.abs(np.trace(gradient, axis1=1, axis2=2)).max() < 1e-9 * np.abs(gradient).max()


def test_masks_and_box_agree_with_the_body(built):
    mask, held = (cv2.imread(str(built[1] / f"{name}_0000.png"), cv2.IMREAD_GRAYSCALE) > 0 for name in ("mask", "held"))
    rows, columns = np.nonzero(mask)
    x0, y0, x1, y1 = json.loads((built[1] / "box.json").read_text())["box"]
    assert x0 < columns.min() and columns.max() < x1 and y0 < rows.min() and rows.max() < y1
    assert held.any() and not (held & ~mask).any() and held.sum() < 0.3 * mask.sum()
    scene = np.load(built[1] / "scene.npz", allow_pickle=False)
    assert scene["uv"].min() > 0.0 and scene["uv"].max() < 1.0 and "stand_vertices" in scene.files


def test_wrong_options_are_refused(built, tmp_path, capsys):
    for options in (("--size", "33x33"), ("--frames", "1"), ("--spacing", "3")):
        with pytest.raises(SystemExit) as raised:
            built[0]["main"](["--out", str(tmp_path / "x"), *options])
        assert raised.value.code == 2 and options[0] in capsys.readouterr().err
