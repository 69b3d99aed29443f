"""What is to be done when the process ends.

A module of its own, without bpy: Python holds on to exit functions until after Blender as a Python module (4.5.15) has to be taken down,
and an exit function whose globals hold bpy keeps it from that; the process then hangs.
"""

from __future__ import annotations

import atexit
from collections.abc import Callable

actions: list[Callable[[], None]] = []


def _leave() -> None:
    while actions:
        actions.pop()()


atexit.register(_leave)
