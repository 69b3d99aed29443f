"""What a job has said of its result, kept with that result: part of the file and of its undo.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

from collections.abc import Sequence

import bpy
from bpy.props import StringProperty

from . import status

KEPT = {"recover": "recovered_notes", "resimulate": "simulated_notes", status.EDIT_PREVIEW: "coarse_notes"}
"""Step -> collection of its notes: in the scene's settings, and those of an edit in the edit, too."""


class SEEING_WIND_PG_note(bpy.types.PropertyGroup):
    """A note, the worst of a result first."""

    text: StringProperty(options={"HIDDEN"})


def keep(owner: bpy.types.PropertyGroup, step: str, texts: Sequence[str]) -> None:
    """Put the notes of a new result in the place of those of a former one.

    Args:
        owner: the scene's settings, or an edit.
        step: one of `KEPT`.
    """
    notes = getattr(owner, KEPT[step])
    notes.clear()
    for text in texts:
        notes.add().text = text


def kept(settings: bpy.types.PropertyGroup, step: str) -> list[str]:
    """The notes of the result that the scene has of a step; empty for a step whose result is nothing but what the scene shows."""
    return [note.text for note in getattr(settings, KEPT[step])] if step in KEPT else []


CLASSES = (SEEING_WIND_PG_note,)
