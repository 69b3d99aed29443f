"""Every test of the Blender side starts from a clean factory file."""

from __future__ import annotations

import importlib.util
import runpy
from pathlib import Path
from typing import Any

import pytest

if importlib.util.find_spec("bpy") is None:
    collect_ignore_glob = ["test_*.py"]


@pytest.fixture(autouse=True)
def clean_file() -> None:
    """An empty file with factory settings, so that no test sees another's objects."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.fixture
def scene():
    """The scene of the clean file."""
    import bpy

    return bpy.context.scene


@pytest.fixture(scope="session")
def checks() -> dict[str, Any]:
    """The functions of tests/blender/field_object_check.py, which runs in a real Blender too."""
    return runpy.run_path(str(Path(__file__).resolve().parents[1] / "blender" / "field_object_check.py"), run_name="checks")
