"""The sample scene builds itself from a seed. Small settings, no rendering: `make demo` renders."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.command.trajectories.bodies import read_trajectories
from seeing_wind.engine.field import load_field
from seeing_wind.engine.look.report.accuracy import uniform_errors

SCENE = Path(__file__).resolve().parents[1] / "sample_scenes" / "falling_leaf"
sys.path[:0] = [str(SCENE), str(SCENE.parent / "common")]

import demo  # noqa: E402
import in_blender  # noqa: E402
import leaf as leaves  # noqa: E402
import make  # noqa: E402
import motion  # noqa: E402


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A clip of four intervals without its frames."""
    out = tmp_path_factory.mktemp("leaf")
    assert make.main(["--out", str(out), "--frames", "4", "--no-render"]) == 0
    return out


def test_the_leaf_is_the_same_for_a_seed_and_another_for_another():
    first, again, other = leaves.make_leaf(3), leaves.make_leaf(3), leaves.make_leaf(4)
    np.testing.assert_array_equal(first.vertices, again.vertices)
    np.testing.assert_array_equal(first.triangles, again.triangles)
    assert first.outline.shape != other.outline.shape or not np.allclose(first.outline, other.outline)
    np.testing.assert_array_equal(leaves.make_texture(3, 128), leaves.make_texture(3, 128))
    assert (leaves.make_texture(3, 128) != leaves.make_texture(4, 128)).mean() > 0.3


def test_the_leaf_is_one_flat_piece_that_covers_its_outline():
    leaf = leaves.make_leaf(7)
    a, b, c = (leaf.vertices[leaf.triangles[:, k]] for k in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert (area > 0).all()
    x, y = leaf.outline.T
    outline = 0.5 * abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    assert area.sum() == pytest.approx(outline, rel=0.03)
    assert 0.25 < np.ptp(leaf.vertices[:, 1]) < 0.40
    assert leaf.uv.min() > 0.0 and leaf.uv.max() < 1.0
    from seeing_wind.engine.recovery.resimulate.fill import connected_parts

    assert connected_parts(leaf.triangles, len(leaf.vertices)).max() == 0


def test_the_texture_has_corners_to_track():
    grey = leaves.make_texture(7, 256).mean(-1)
    middle = grey[64:192, 96:160]
    assert middle.std() > 25.0
    assert np.abs(np.diff(middle, axis=1)).mean() > 8.0 and np.abs(np.diff(middle, axis=0)).mean() > 8.0


def test_the_flight_repeats_and_obeys_the_wind():
    leaf = leaves.make_leaf(2)
    first, again = (motion.fly(leaf, 2, 30.0, 4, spacing=0.012) for _ in range(2))
    np.testing.assert_array_equal(first.x, again.x)
    # The body's mean obeys x'' = mean of f / rho + g exactly, whatever happens inside.
    expected = first.acceleration.mean(1) + [0.0, 0.0, -9.81]
    found = np.diff(first.v.mean(1), axis=0) * 30.0
    np.testing.assert_allclose(found, expected, atol=0.05)


def test_the_wind_is_carried_with_the_leaf_and_known_everywhere():
    flight = motion.fly(leaves.make_leaf(2), 2, 30.0, 4, spacing=0.012)
    for t in range(4):
        np.testing.assert_allclose(flight.wind.sample(flight.x[t], t)[0], 400.0 * flight.acceleration[t], rtol=1e-9, atol=1e-6)
    # Free of divergence: the trace of the gradient vanishes at any place and time.
    points = np.random.default_rng(0).normal(size=(50, 3)) * 0.3 + flight.x[0].mean(0)
    gradient = flight.wind.gradient(points, 2)
    assert np.abs(np.trace(gradient, axis1=1, axis2=2)).max() < 1e-9 * np.abs(gradient).max()


@pytest.mark.slow  # .ci/run and .ci/nightly make the whole scene
@pytest.mark.parametrize("seed", [0, 7])
def test_a_whole_clip_stays_in_the_frame_and_is_no_uniform_wind(seed):
    flight = make.simulate(seed, 45, 30.0, (640, 360), spacing=0.012)
    pixels, depth = flight.camera.project(flight.surface)
    assert pixels.min() > 2 and pixels[..., 0].max() < 637 and pixels[..., 1].max() < 357
    assert depth.min() > 1.5
    assert motion.tilt(flight.x).max() < 50.0
    fall = flight.x[0].mean(0)[2] - flight.x[-1].mean(0)[2]
    assert 0.4 < fall < 0.8
    magnitude, direction = uniform_errors(flight.truth["acc"])
    assert magnitude > 20.0 and direction > 10.0


def test_files_agree_with_each_other(folder):
    camera, known = (json.loads((folder / name).read_text()) for name in ("camera.json", "box.json"))
    assert (camera["width"], camera["height"]) == (640, 360)
    import cv2

    mask = cv2.imread(str(folder / "mask_0000.png"), cv2.IMREAD_GRAYSCALE)
    rows, columns = np.nonzero(mask)
    x0, y0, x1, y1 = known["box"]
    assert x0 < columns.min() and columns.max() < x1 and y0 < rows.min() and rows.max() < y1
    assert 2000 < len(rows) < 12000
    truth = np.load(folder / "truth.npz", allow_pickle=False)
    assert truth["x"].shape[0] == 5 and truth["acc"].shape == (4, *truth["x"].shape[1:])
    wind = load_field(folder / "known_wind.safetensors")
    for t in range(4):
        np.testing.assert_allclose(wind.sample(truth["x"][t], t)[0], truth["rho"] * truth["acc"][t], rtol=1e-9, atol=1e-6)
    source = read_trajectories(folder / "truth.npz")
    assert source.material.density == known["density"] == 400.0
    assert source.fps == 30.0 and source.gravity == (0.0, 0.0, -9.81)


@pytest.mark.parametrize("options", [("--size", "640"), ("--size", "33x33"), ("--frames", "1"), ("--seed", "-1"), ("--fps", "0")])
def test_wrong_options_are_refused(tmp_path, options, capsys):
    with pytest.raises(SystemExit) as raised:
        make.main(["--out", str(tmp_path / "x"), *options])
    assert raised.value.code == 2
    assert "--" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_a_missing_blender_is_a_sentence(tmp_path, capsys):
    assert make.main(["--out", str(tmp_path), "--frames", "3", "--blender", "/no/such/blender"]) == 1
    assert "/no/such/blender" in capsys.readouterr().err


def test_a_script_that_fails_in_blender_tells_its_last_words(tmp_path, monkeypatch):
    script = tmp_path / "script.py"
    script.write_text("import sys\nprint('demo: hello')\nprint('what went wrong')\nsys.exit(3)\n")
    monkeypatch.setattr(in_blender, "command", lambda script, arguments, blender: [sys.executable, str(script)])
    with pytest.raises(in_blender.BlenderFailed, match="what went wrong"):
        in_blender.run(script, [], follow="demo:")


def test_first_acceleration_of_a_fall():
    t = np.arange(12) / 30.0
    vertices = np.zeros((12, 2, 3)) + 0.5 * np.array([1.0, 0.0, -9.81]) * t[:, None, None] ** 2
    np.testing.assert_allclose(demo.first_acceleration(vertices, 30.0), [1.0, 0.0, -9.81], rtol=1e-9)
