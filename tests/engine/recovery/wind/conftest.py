"""The plate of `blown_plate`."""

from __future__ import annotations

import pytest

from seeing_wind.engine.materials import Material
from seeing_wind.engine.records import Particles, Recovery
from tests.engine.recovery.wind.blown_plate import blown_plate


@pytest.fixture(scope="session")
def blown() -> tuple[Recovery, Particles, Material]:
    """Its recovery, particles and material."""
    return blown_plate()
