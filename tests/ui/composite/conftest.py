"""Every test of the composite starts from a recovered field."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def recovered(stand_in, workplace) -> None:
    """A field recovered."""

    from tests.ui.jobs import recover  # needs bpy

    assert recover(workplace) == {"FINISHED"}
