"""Paths as the user writes them."""

from __future__ import annotations

import os

import bpy


def absolute(path: str, library: bpy.types.Library | None = None) -> str:
    """A path as the user wrote it (`//` beside the .blend, `~`) as an absolute one."""
    return os.path.abspath(os.path.expanduser(bpy.path.abspath(path, library=library)))
