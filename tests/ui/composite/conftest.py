"""Every test of the composite starts from a recovered field."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def kept_take(recovered_file, workplace) -> Path:
    """A copy of its take: what a test writes there is not the next one's."""
    return Path(shutil.copytree(workplace / "out.take", workplace / "kept"))


@pytest.fixture(autouse=True)
def recovered(recovered_file, kept_take, stand_in, workplace) -> None:
    """A field recovered: the file that has it, which takes a twentieth of the time of another recovery."""
    import bpy

    shutil.rmtree(workplace / "out.take")
    shutil.copytree(kept_take, workplace / "out.take")
    bpy.ops.wm.open_mainfile(filepath=str(recovered_file))
