"""Every test of the Blender side starts from a clean factory file."""

from __future__ import annotations

import importlib.util
import runpy
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent))

import extension  # noqa: E402

if importlib.util.find_spec("bpy") is None:
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture(autouse=True)
def clean_file() -> None:
    """An empty file with factory settings, so that no test sees another's objects.

    The preferences and Blender's own add-ons are made anew only after a test that changed them: that takes six times as long.
    """
    import bpy

    if bpy.context.preferences.is_dirty:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.context.preferences.is_dirty = False  # Blender's add-ons, which are switched on there, are a change to it
    else:
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


@pytest.fixture
def scene():
    """The scene of the clean file."""
    import bpy

    return bpy.context.scene


@pytest.fixture(scope="session")
def checks() -> dict[str, Any]:
    """The functions of tests/blender/field_object_check.py, which runs in a real Blender too."""
    return runpy.run_path(str(Path(__file__).resolve().parents[1] / "blender" / "field_object_check.py"), run_name="checks")


@pytest.fixture(scope="session")
def solvers() -> dict[str, Any]:
    """The functions of tests/blender/native_solvers_check.py, which measure what solvers feel."""
    return runpy.run_path(str(Path(__file__).resolve().parents[1] / "blender" / "native_solvers_check.py"), run_name="solvers")


@pytest.fixture(scope="module")
def workplace(tmp_path_factory) -> Path:
    """A folder that a careless program stumbles over, with a clip and a stand-in for the engine's Python."""
    folder = tmp_path_factory.mktemp("work") / "ein Wind è 风"
    folder.mkdir()
    extension.make_clip(folder / "clip.mp4")
    extension.fake_python(folder, warm=True)
    return folder


@pytest.fixture(scope="module")
def recovered_file(workplace) -> Path:
    """A .blend file with a recovered field, for tests that start from one: to open it is much quicker than another recovery."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    with pytest.MonkeyPatch.context() as patch, extension.switched_on(patch, workplace):
        bpy.ops.seeing_wind.recover(clip=str(workplace / "clip.mp4"), box=(20, 20, 44, 44), distance=2.0, take=str(workplace / "out.take"))
        bpy.ops.wm.save_as_mainfile(filepath=str(workplace / "recovered.blend"))
    return workplace / "recovered.blend"


@pytest.fixture
def stand_in(clean_file, workplace, monkeypatch):
    """The add-on switched on, the stand-in in the engine's place. What an earlier test's file has simulated is gone."""
    for take in workplace.glob("*.edit*.take"):
        shutil.rmtree(take)
    with extension.switched_on(monkeypatch, workplace):
        yield
