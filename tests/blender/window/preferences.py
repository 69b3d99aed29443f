"""Opens Preferences > Add-ons in a Blender with a window: `blender --python preferences.py`, the extension installed from its zip.

Blender's list of add-ons walks all modules that are loaded and reads where each comes from, then draws the extension's own preferences.
Ends Blender with exit code 0, or 9 when something was written to stderr meanwhile or either was not drawn.
"""

from __future__ import annotations

import io
import os
import sys
import traceback
from collections.abc import Iterator

import addon_utils
import bpy

MODULE = "bl_ext.user_default.seeing_wind"
drawn: list[str] = []
said = io.StringIO()


def check(condition: bool, what: str) -> None:
    """An assertion that no optimisation switches off."""
    if not condition:
        raise AssertionError(what)
    print(f"ok  {what}", flush=True)


def watch(cls: type) -> None:
    """Note each draw of the extension's preferences."""
    draw = cls.draw

    def noted(self, context):
        draw(self, context)
        drawn.append(cls.__name__)

    cls.draw = noted


def story() -> Iterator[float]:
    """One thing after the other; yields the seconds to wait."""
    yield 2.0
    bpy.context.preferences.view.show_splash = False
    check(MODULE in bpy.context.preferences.addons, "the extension is installed and switched on")
    watch(type(bpy.context.preferences.addons[MODULE].preferences))
    sys.stderr = said
    bpy.ops.preferences.addon_show(module=MODULE)
    for _ in range(60):
        yield 0.5
        if drawn:
            break
    yield 2.0
    sys.stderr = sys.__stderr__
    check(not said.getvalue(), f"Preferences > Add-ons draws without a word of error {said.getvalue()}")
    check(addon_utils._extensions_warnings_get._is_first is False, "and has looked at all modules")
    check(bool(drawn), f"the extension's own preferences were drawn, {len(drawn)} times")


steps = story()


def advance() -> float:
    """Blender's timer: the next step, or the end."""
    try:
        return next(steps)
    except StopIteration:
        code = 0
    except Exception:
        traceback.print_exc(file=sys.__stderr__)
        code = 9
    sys.stdout.flush()
    os._exit(code)


bpy.app.timers.register(advance, first_interval=2.0)
