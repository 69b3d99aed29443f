"""The parts of `make tables` that can be checked without running a row: rows, objects, frames, and that no bad row is hidden."""

import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("skimage", reason="the benchmarks' extra is not installed")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from paper_tables import tables  # noqa: E402
from paper_tables.fields import FIELDS, gradient  # noqa: E402
from paper_tables.metrics import psnr, ssim  # noqa: E402
from paper_tables.objects import THINGS  # noqa: E402
from paper_tables.painter import depth_of, look_at, paint  # noqa: E402
from paper_tables.report import compare, markdown  # noqa: E402
from paper_tables.rows import VERSION, all_rows, short_rows  # noqa: E402

from seeing_wind.engine.command.arguments import parser  # noqa: E402
from seeing_wind.engine.records import Camera  # noqa: E402
from seeing_wind.engine.take import VERSION as ENGINE  # noqa: E402


def test_every_table_and_kind_of_object_has_its_rows():
    rows = all_rows()
    assert len({row.key for row in (*rows, *short_rows())}) == len(rows) + len(short_rows())
    assert {row.table for row in rows} == {1, 2, 3} and {row.thing for row in rows if row.table == 1} == set(THINGS)
    things = [make() for make in THINGS.values()]
    assert len({thing.field for thing in things}) == len(things) == 6
    assert {thing.kind for thing in things} == {"elastic", "elastoplastic", "viscoplastic"}


def test_the_engine_knows_the_options_of_every_row():
    for row in (*all_rows(), *short_rows()):
        verb = ["recover", "clip", "--take", "t"] if row.views else ["recover-trajectories", "t.npz", "--take", "t"]
        options = [option for option in row.options if row.views or option not in ("--particles", "150")]
        assert parser().parse_args([*verb, *options]).verb == verb[0]


@pytest.mark.parametrize("name", ["Lego", "Hotdog"])
def test_surface_and_filling_of_an_object_agree(name):
    solid = THINGS[name]().solid
    vertices, triangles, colours = solid.mesh(0.012)
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    volume = (a * np.cross(b, c)).sum() / 6.0  # positive: normals outward
    assert volume == pytest.approx(len(solid.fill(0.012)) * 0.012**3, rel=0.1)
    assert colours.min() >= 0.0 and colours.max() <= 1.0 and len(colours) == len(vertices)


def test_fields_are_curved_and_their_gradients_are_derivatives():
    x = np.random.default_rng(0).uniform(-0.2, 0.2, (200, 3))
    for field in FIELDS.values():
        values, slope = field(x, 0.3), gradient(field, x, 0.3)
        assert np.linalg.norm(values - values.mean(axis=0), axis=1).mean() > 0.1 * np.linalg.norm(values, axis=1).mean()
        step = 1e-4 * np.array([1.0, -2.0, 0.5])
        np.testing.assert_allclose(field(x + step, 0.3) - values, slope @ step, atol=1e-4 * np.abs(values).max())


def test_the_painter_sees_the_near_side_of_a_box_where_it_is():
    corners = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.1, 0.1) for z in (-0.15, 0.15)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    camera = Camera(80, 60, 100.0, 100.0, 39.5, 29.5, look_at(np.array([0.0, -1.1, 0.0]), np.zeros(3)))
    depth = depth_of(corners, triangles, camera)
    seen = np.isfinite(depth)
    assert depth[30, 40] == pytest.approx(1.0, abs=1e-5)
    assert seen.sum() == pytest.approx(40 * 30, rel=0.06)  # 0.4 m by 0.3 m at 1 m
    colour, alpha = paint(corners, triangles, np.tile([1.0, 0.0, 0.0], (8, 1)), camera)
    assert alpha[30, 40] == 1.0 and alpha[0, 0] == 0.0 and colour[30, 40, 0] > 0.3 and colour[30, 40, 1] == 0.0


def test_like_clips_score_best():
    clip = np.random.default_rng(0).integers(0, 255, (2, 32, 32, 3), dtype=np.uint8)
    noisy = np.clip(clip.astype(int) + 8, 0, 255).astype(np.uint8)
    assert psnr(clip, clip) == 100.0 and ssim(clip, clip) == pytest.approx(1.0)
    assert psnr(clip, noisy) == pytest.approx(20 * np.log10(255 / 8), abs=0.5) and ssim(clip, noisy) < 1.0


def test_a_row_above_the_paper_is_named():
    row = {"row": {"table": 1, "name": "Lego, one view", "thing": "Lego", "paper": [33.7, 0.98, 0.01, 19.53, 7.02]}, "kind": "elastic"}
    row |= {"psnr": 30.0, "ssim": 0.9, "lpips": None, "uniform_magnitude": 20.0, "uniform_direction": 9.0, "engine_seconds": 5.0}
    good, bad = row | {"magnitude": 5.0, "direction": 6.0}, row | {"magnitude": 5.0, "direction": 8.0}
    assert "None of the 1" in compare([good])
    assert "Lego, one view: direction 8.0 against 7.0" in compare([good, bad]) and "magnitude" not in compare([good, bad])
    assert "5.0 (19.53)" in markdown([good]) and "20 / 9" in markdown([good])


def test_a_row_of_an_earlier_engine_is_marked():
    row = {"row": {"table": 1, "name": "Lego, one view", "thing": "Lego", "paper": [33.7, 0.98, 0.01, 19.53, 7.02]}, "kind": "elastic"}
    row |= {"psnr": 30.0, "ssim": 0.9, "lpips": None, "magnitude": 5.0, "direction": 6.0}
    row |= {"uniform_magnitude": 20.0, "uniform_direction": 9.0, "engine_seconds": 5.0}
    assert "| Lego, one view |" in markdown([row | {"engine": ENGINE}])
    assert "| Lego, one view * |" in markdown([row | {"engine": ENGINE - 1}])


def test_rows_published_before_stand_where_a_run_lacks_them(tmp_path, monkeypatch):
    rows = [row for row in all_rows() if row.thing == "Lego" and row.table == 1]
    figures = {"version": VERSION, "engine": ENGINE, "kind": "elastic", "psnr": 30.0, "ssim": 0.9, "lpips": None, "direction": 6.0}
    figures |= {"uniform_magnitude": 20.0, "uniform_direction": 9.0, "engine_seconds": 5.0, "seconds": 6.0}
    results = tmp_path / "tables.json"
    results.write_text(json.dumps([figures | {"row": asdict(row), "magnitude": 5.0} for row in rows]))
    monkeypatch.setattr(tables, "RESULTS", results)
    monkeypatch.setattr(tables, "DOCS", tmp_path / "docs")
    monkeypatch.setattr(tables, "run_row", lambda row, out, say: figures | {"row": asdict(row), "magnitude": 7.0})
    assert tables.main(["--out", str(tmp_path / "out"), "--row", rows[0].key, "--docs"]) == 0
    text = (tmp_path / "docs" / "notebook" / "tables.md").read_text()
    assert f"| {rows[0].name} | elastic | 30.00 (33.7) | 0.900 (0.98) | – (0.01) | 7.0" in text
    assert f"| {rows[1].name} | elastic | 30.00 (33.7) | 0.900 (0.98) | – (0.01) | 5.0" in text
    assert [one["magnitude"] for one in json.loads(results.read_text())] == [7.0, 5.0]
