"""The benchmark of materials: its scores against hand-made answers, its own frames and truth, and a run against a server."""

from __future__ import annotations

import importlib.util
import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

PLACE = Path(__file__).resolve().parents[1] / "benchmarks" / "footage" / "materials.py"
spec = importlib.util.spec_from_file_location("materials_benchmark", PLACE)
assert spec and spec.loader
benchmark = importlib.util.module_from_spec(spec)
spec.loader.exec_module(benchmark)


def truth_as_answers() -> tuple[list[dict], dict[str, dict]]:
    objects = benchmark.read_truth(benchmark.HERE)
    return objects, {one["picture"]: {key: one[key] for key in ("type", "density", "youngs_modulus")} for one in objects}


def test_seventeen_objects_with_sources_and_images() -> None:
    objects, _ = truth_as_answers()
    counts = {kind: sum(one["type"] == kind for one in objects) for kind in benchmark.TYPES}
    assert counts == {"elastic": 6, "elastoplastic": 6, "viscoplastic": 5}
    for one in objects:
        assert one["source"]
        image = cv2.imread(str(benchmark.HERE / one["picture"]))
        assert image.shape == (256, 256, 3) and image.std() > 10, "an object on a table, no flat or black frame"
    images = np.stack([cv2.imread(str(benchmark.HERE / one["picture"])).astype(float) for one in objects])
    apart = [np.abs(a - b).mean() for i, a in enumerate(images) for b in images[:i]]
    assert min(apart) > 2.0, "no two of them are the same"


def test_the_truth_scores_full_and_known_errors_score_as_defined() -> None:
    objects, answers = truth_as_answers()
    overall = benchmark.score(objects, answers)[-1]
    assert (overall["f1"], overall["density_mape"], overall["log_mape"], overall["answered"]) == (1.0, 0.0, 0.0, 17)
    for found in answers.values():
        found["density"] *= 1.1
        found["youngs_modulus"] *= 10.0
    rows = benchmark.score(objects, answers)
    expected = np.mean([100.0 / math.log10(one["youngs_modulus"]) for one in objects])
    assert rows[-1]["density_mape"] == pytest.approx(10.0) and rows[-1]["log_mape"] == pytest.approx(expected)


def test_f1_counts_misses_and_false_claims() -> None:
    objects, answers = truth_as_answers()
    plastic = [one["picture"] for one in objects if one["type"] == "elastoplastic"]
    for name in plastic[:3]:
        answers[name] = {**answers[name], "type": "elastic"}
    del answers[plastic[5]]
    rows = {row["type"]: row for row in benchmark.score(objects, answers)}
    assert rows["elastic"]["f1"] == pytest.approx(2 * 6 / (9 + 6)) and rows["elastoplastic"]["f1"] == pytest.approx(2 * 2 / (2 + 6))
    assert rows["elastoplastic"]["answered"] == 5 and rows["viscoplastic"]["f1"] == 1.0


def steel(question: str) -> dict:
    """What a model answers that calls everything steel."""
    if "youngs_modulus" in question:
        return {"density": 7850.0, "youngs_modulus": 2e11, "poisson_ratio": 0.3, "yield_stress": 2.5e8, "viscosity": None}
    return {"object": "thing", "material": "steel", "type": "elastoplastic"}


def test_an_endpoint_is_asked_about_every_image(server, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    server.answers = [steel]
    assert benchmark.main(["--endpoint", server.url, "--model", "any", "--out", str(tmp_path / "a.json")]) == 0
    asked = capsys.readouterr().out
    assert len(json.loads((tmp_path / "a.json").read_text())) == 17
    assert benchmark.main(["--answers", str(tmp_path / "a.json")]) == 0
    assert capsys.readouterr().out == asked and "overall" in asked


@pytest.mark.parametrize("content", ["{", "[]", '{"a": {}}', '{"a": {"type": "elastic", "density": -1, "youngs_modulus": 1}}'])
def test_unusable_answers(tmp_path: Path, content: str, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "a.json").write_text(content)
    assert benchmark.main(["--answers", str(tmp_path / "a.json")]) == 2
    assert "cannot be used" in capsys.readouterr().err
    assert benchmark.main([str(tmp_path), "--answers", str(tmp_path / "a.json")]) == 2
