"""Every script of the benchmarks still finds what it imports, and says how it is called."""

from __future__ import annotations

import importlib.util
import os
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
BENCHMARKS = ROOT / "benchmarks"
SCRIPTS = [path for path in sorted(BENCHMARKS.rglob("*.py")) if '__name__ == "__main__"' in path.read_text(encoding="utf-8")]
ELSEWHERE = {"bpy": "runs in Blender", "skimage": "the benchmarks' extra is not installed"}
"""Packages that some scripts need and not every environment has."""


def taken_out() -> dict[str, ModuleType]:
    """The modules of the scripts of benchmarks and sample scenes, which are no longer imported."""
    places = [str(BENCHMARKS), str(ROOT / "sample_scenes")]
    names = [name for name, module in sys.modules.items() if str(getattr(module, "__file__", None)).startswith(tuple(places))]
    return {name: sys.modules.pop(name) for name in names}


@pytest.fixture
def as_a_process(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    """A script finds no modules of other scripts, as some of two folders have the same name; afterwards all is as before."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    before, environment = taken_out(), dict(os.environ)
    yield monkeypatch
    taken_out()
    sys.modules.update(before)
    os.environ.clear()
    os.environ.update(environment)


def test_there_are_scripts() -> None:
    assert len(SCRIPTS) > 30


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: str(path.relative_to(BENCHMARKS)))
def test_a_script_imports_and_helps(script: Path, as_a_process: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    as_a_process.setattr(sys, "argv", [str(script), "--help"])
    sys.path.insert(0, str(script.parent))
    in_blender = "import bpy" in script.read_text(encoding="utf-8")
    try:
        if in_blender:  # its arguments come from Blender's command line
            runpy.run_path(str(script), run_name="imported")
            return
        with pytest.raises(SystemExit) as end:
            runpy.run_path(str(script), run_name="__main__")
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in ELSEWHERE or importlib.util.find_spec(package) is not None:
            raise
        pytest.skip(ELSEWHERE[package])
    assert end.value.code == 0
    assert "usage:" in capsys.readouterr().out
