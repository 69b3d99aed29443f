"""From a clip to an `Observation`: camera, masks, depth, tracks. OpenCV lives here."""

from .observation import observe

__all__ = ["observe"]
