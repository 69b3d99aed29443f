"""One thread for OpenCV: the work here is many small calls, each of which would be several times slower with a pool of threads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import cv2


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit OpenCV to one thread inside the `with`, and restore the caller's number after it."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
