"""A sample scene from nothing to a file that plays without the extension: real engine, real Blender, operators only; small and short.

Half a minute for one scene; `make scenes SHORT=1` does the same with all three, `make scenes` at full size.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

SCENES = Path(__file__).resolve().parents[1] / "sample_scenes"
sys.path[:0] = [str(SCENES), str(SCENES / "common")]

import whole_jobs  # noqa: E402

pytestmark = [
    pytest.mark.slow,  # half a minute; .ci/run does the same, .ci/nightly with all three scenes
    pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="needs the bpy wheel"),
]


def test_the_whole_job_plays_on_in_a_blender_without_the_extension(tmp_path) -> None:
    name = "flag"
    figures = whole_jobs.whole_job(name, tmp_path / name, quick=True)
    assert max(figures["differs_m"].values()) < 1e-5 and set(figures["differs_m"]) > {"Ribbon", "Recovered Object"}
    assert min(figures["moved_m"].values()) > 1e-3 and figures["pinned_moved_mm"] < 0.1
    assert figures["frames"] == 5 and (tmp_path / name / "job.json").is_file()
    assert "without the extension" in whole_jobs.summary(name, figures)
