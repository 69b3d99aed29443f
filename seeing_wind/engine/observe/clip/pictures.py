"""Picture files read and written by Python: OpenCV opens a path that is not ASCII on Linux and macOS only."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np


def read_picture(path: str | Path, flags: int) -> np.ndarray | None:
    """A picture as `cv2.imread` with `flags` gives it; None where there is none that can be read."""
    try:
        content = np.fromfile(path, np.uint8)
    except OSError:
        return None
    return cv2.imdecode(content, flags) if content.size else None


def write_png(path: Path, picture: np.ndarray) -> None:
    """Write a picture (H, W) or (H, W, 3) BGR, uint8.

    Raises:
        OSError: when the file cannot be written.
    """
    path.write_bytes(cv2.imencode(".png", picture)[1].tobytes())
