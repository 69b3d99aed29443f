"""What an edit says, and what has become of it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import bpy

from seeing_wind.engine.settings import BodyEdit, ColliderEdit, FieldEdit
from seeing_wind.ui.job import status


def written(workplace: Path, folder: str = "out.edit.take") -> dict:
    """The edit.toml that the last re-simulation read; every key is one that the engine knows."""
    edit = tomllib.loads((workplace / folder / "edit.toml").read_text())
    for table, cls in (("body", BodyEdit), ("collider", ColliderEdit), ("further_field", FieldEdit)):
        for entry in edit.get(table, []):
            assert set(entry) <= set(cls.__dataclass_fields__)
    return edit


def state(step: str) -> str:
    """Of a step of the scene, as the panel says it."""
    return status.of(bpy.context.scene.session_uid).steps[step].state
