"""Reading and writing image files through Python, as OpenCV can open paths that are not ASCII on Linux and macOS only."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np

from ...conventions import LARGEST_IMAGE
from ...reading import regular


def read_image(path: str | os.PathLike[str], flags: int = cv2.IMREAD_COLOR) -> np.ndarray:
    """The image at `path` as OpenCV decodes it with `flags`, by default (H, W, 3) uint8 BGR.

    Raises:
        OSError: not a regular file.
        ValueError: not an image, or one of more than `LARGEST_IMAGE` pixels. In the worker, OpenCV refuses such images by their header,
            whatever the format (see `engine/__main__.py`).
    """
    regular(path)
    try:
        image = cv2.imdecode(np.fromfile(path, np.uint8), flags)
    except cv2.error as error:
        raise ValueError(_too_large("its header states") if "CV_IO_MAX_IMAGE" in str(error) else "it is damaged") from error
    if image is None:
        raise ValueError("it is not an image, or is damaged")
    check_size(image.shape[1], image.shape[0])
    return image


def write_png(path: Path, image: np.ndarray) -> None:
    """Write an image (H, W) or (H, W, 3) BGR, uint8.

    Raises:
        OSError: the file cannot be written.
    """
    path.write_bytes(cv2.imencode(".png", image)[1].tobytes())


def check_size(width: float, height: float) -> None:
    """Raise ValueError for an image of more than `LARGEST_IMAGE` pixels."""
    if width * height > LARGEST_IMAGE:
        raise ValueError(_too_large(f"it has {width:.0f}x{height:.0f},"))


def _too_large(what: str) -> str:
    return f"{what} more than {LARGEST_IMAGE / 1e6:.0f} million pixels"
