"""The synthetic observations as fixtures."""

from tests.engine.observations import ball, plate

__all__ = ["ball", "plate"]
