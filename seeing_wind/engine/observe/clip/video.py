"""Writing videos with whatever codec this OpenCV has."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2

from ...errors import MissingPackage, TakeError

CODECS = ("avc1", "mp4v", "vp09")
"""H.264 if OpenCV's FFmpeg has an encoder for it, else MPEG-4 part 2 (Blender and players play it, browsers do not), else VP9, which OpenCV
only encodes at its slowest: 0.22 processor seconds for a frame of 720x1280, thirteen times as long as MPEG-4, and half of a job."""
LEAST_SPACE = 100_000
"""Free space needed to begin a video [bytes]."""


@contextlib.contextmanager
def video_writer(path: Path, fps: float, size: tuple[int, int]) -> Iterator[cv2.VideoWriter]:
    """A video writer with the first codec that this OpenCV has.

    Raises:
        MissingPackage: OpenCV has none of the codecs.
        TakeError: the written video cannot be read.
        OSError: the disk is full.
    """
    with _quiet():
        for codec in CODECS:
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), fps, size)  # type: ignore[attr-defined]
            if writer.isOpened():
                break
        else:
            if shutil.disk_usage(path.parent).free < LEAST_SPACE:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
            message = f"This OpenCV can write none of the video codecs {', '.join(CODECS)}."
            raise MissingPackage(message, "Install opencv-python-headless from PyPI.")
    try:
        yield writer
    finally:
        writer.release()
    # OpenCV does not report a disk that fills up while it writes: such a video lacks its table of contents, and no player opens it.
    if not cv2.VideoCapture(str(path)).read()[0]:
        if shutil.disk_usage(path.parent).free < LEAST_SPACE:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        raise TakeError("The video that the encoder wrote cannot be read.", "Free some space or choose another folder.")


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence OpenCV, which logs an error for every codec that it lacks.

    The logging functions moved to `cv2.utils.logging` in 4.12; 4.11 has them in `cv2` only.
    """
    log = getattr(getattr(cv2, "utils", None), "logging", cv2)
    level = log.getLogLevel()
    log.setLogLevel(0)
    try:
        yield
    finally:
        log.setLogLevel(level)
