"""Removes the installed extension again: `blender -b --python-exit-code 9 --python remove_extension.py`, after drive_extension.py.

What Install Engine makes lies in the extension's user folder; with the extension it has to go, and so has everything in this Blender.
"""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

MODULE = "bl_ext.user_default.seeing_wind"


def check(condition: bool, what: str) -> None:
    """An assertion that no optimisation switches off."""
    if not condition:
        raise AssertionError(what)
    print(f"ok  {what}", flush=True)


def main() -> None:
    """Uninstall, and look for what is left."""
    engine = Path(bpy.utils.extension_path_user(MODULE, path="engine", create=True))
    (engine / ".complete").write_text("stands for an environment of 2 GB")
    source = Path(sys.modules[MODULE].__file__).parent
    index = next(index for index, repo in enumerate(bpy.context.preferences.extensions.repos) if repo.module == "user_default")
    check(bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="seeing_wind") == {"FINISHED"}, "uninstalled")
    check(not source.exists(), "its files are gone")
    check(not engine.exists() and not engine.parent.exists(), "what Install Engine made is gone")
    check(not hasattr(bpy.types.Scene, "seeing_wind") and not dir(bpy.ops.seeing_wind), "no settings and no operators are left")
    ours = [h for name in dir(bpy.app.handlers) for h in _functions(name) if "seeing_wind" in (h.__module__ or "")]
    check(not ours, "no handlers are left")
    check(MODULE not in bpy.context.preferences.addons, "it is not in the preferences any more")


def _functions(name: str) -> list:
    handlers = getattr(bpy.app.handlers, name)
    return [each for each in handlers if callable(each)] if isinstance(handlers, list) else []


main()
