"""Clean-up when the process ends.

Blender as a Python module (4.5.15) shuts down when Python releases `bpy`. It hangs if that happens after its handlers' functions or the
last modules are gone, so at exit this package releases everything first. It is a module of its own, without bpy, for the same reason.
"""

from __future__ import annotations

import atexit
import gc
import sys
from collections.abc import Callable

actions: list[Callable[[], None]] = []
let_go = False
"""Whether Blender runs as a module of this process, so that all modules must be released."""


def _leave() -> None:
    if not actions:
        return
    while actions:
        actions.pop()()
    if not let_go:
        return
    for name in [name for name in sys.modules if name == __package__ or name.startswith(f"{__package__}.")]:
        if name == __name__:
            continue
        vars(sys.modules.pop(name)).clear()
    gc.collect()


atexit.register(_leave)
