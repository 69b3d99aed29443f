"""Jobs as the tests of the operators start them, and what the panels say of them."""

from __future__ import annotations

from pathlib import Path

import bpy

from seeing_wind.ui.job import notes, status


def recover(workplace: Path, **more):
    options = {"clip": str(workplace / "clip.mp4"), "box": (20, 20, 44, 44), "distance": 2.0, "take": str(workplace / "out.take")}
    return bpy.ops.seeing_wind.recover(**{**options, **more})


def notes_of(scene, step: str = "recover") -> list[str]:
    """The notes that the panel shows of a step's result."""
    return notes.kept(scene.seeing_wind, step)


def now(scene) -> dict[str, status.Step]:
    return status.of(scene.session_uid).steps
