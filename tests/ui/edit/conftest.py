"""A recovered field, from which every test of an edit starts."""

from __future__ import annotations

import pytest


@pytest.fixture
def recovered(recovered_file, stand_in):
    """The scene of that file."""
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(recovered_file))
    return bpy.context.scene
