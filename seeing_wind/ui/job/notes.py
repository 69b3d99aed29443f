"""The notes of a job on its result, stored with that result: part of the file and of its undo history.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

from collections.abc import Sequence

import bpy
from bpy.props import StringProperty

from . import status

KEPT = {"recover": "recovered_notes", "resimulate": "simulated_notes", status.EDIT_PREVIEW: "coarse_notes"}
"""Step -> name of the collection of its notes in the scene's settings; for the steps of an edit, also in each stored edit."""


class SEEING_WIND_PG_note(bpy.types.PropertyGroup):
    """A note, the worst of a result first."""

    text: StringProperty(options={"HIDDEN"})


def keep(owner: bpy.types.PropertyGroup, step: str, texts: Sequence[str]) -> None:
    """Replace the notes of the former result by those of a new one.

    Args:
        owner: the scene's settings, or an edit.
        step: one of `KEPT`.
    """
    notes = getattr(owner, KEPT[step])
    notes.clear()
    for text in texts:
        notes.add().text = text


def kept(settings: bpy.types.PropertyGroup, step: str) -> list[str]:
    """The notes on the scene's result of a step; empty for a step whose notes are not stored."""
    return [note.text for note in getattr(settings, KEPT[step])] if step in KEPT else []


CLASSES = (SEEING_WIND_PG_note,)
