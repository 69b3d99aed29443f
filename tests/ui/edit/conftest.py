"""A recovered field, from which every test of an edit starts."""

from __future__ import annotations

from pathlib import Path

import extension
import pytest


@pytest.fixture(scope="module")
def recovered_file(workplace) -> Path:
    """A .blend file with a recovered field."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    with pytest.MonkeyPatch.context() as patch, extension.switched_on(patch, workplace):
        bpy.ops.seeing_wind.recover(clip=str(workplace / "clip.mp4"), box=(20, 20, 44, 44), distance=2.0, take=str(workplace / "out.take"))
        bpy.ops.wm.save_as_mainfile(filepath=str(workplace / "recovered.blend"))
    return workplace / "recovered.blend"


@pytest.fixture
def recovered(recovered_file, stand_in):
    """The scene of that file."""
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(recovered_file))
    return bpy.context.scene
