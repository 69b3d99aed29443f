"""Field objects that act beside the scene's own, as files that `resimulate` reads: each with the values that it carries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ....engine.errors import UsageError
from ....engine.take import Take
from ...field.samples import samples_of
from ...scene_units import refuse_other_units
from .edit_files import write_array
from .field_place import further_fields, standing
from .lone_wind import field_files

FOLDER = "further_fields"
"""Folder of these files, in that of the edit."""


def export_further_fields(scene: bpy.types.Scene, folder: Path, frames: list[float], fps: float, metres: float) -> list[dict[str, Any]]:
    """Write the scene's further fields into `folder`. Returns an entry for each, for `[[further_field]]` of the edit.

    Args:
        frames: scene frames of the T + 1 clip frames; the scene is left at the first.
        fps: clip frames per second.
        metres: length of one scene unit [m].

    Raises:
        UsageError: for a field whose values are gone, or that was made for another unit of length.
    """
    entries, times = [], 0.5 * (np.array(frames[:-1]) + np.array(frames[1:]))
    for number, obj in enumerate(further_fields(scene), start=1):
        refuse_other_units(obj, scene)
        samples, path = samples_of(obj), folder / FOLDER / f"{number}.safetensors"
        if samples is None:
            raise UsageError(f"The values under {obj.name} are gone.", "Append or add it again, or disable it in viewports.")
        box, files = field_files(obj, samples, times, metres, fps)
        with Take(path.parent).writing(path.name) as aside:
            aside.write_bytes(list(files.values())[-1])
        stands = standing(obj, scene, box, frames, metres)
        if not np.isfinite(stands.share).all():
            raise UsageError(f"The strength of {obj.name} is no number.", "Correct it, with its keyframes and drivers.")
        strength = stands.share[0] if len(set(stands.share)) == 1 else stands.share
        entry = {"file": path.relative_to(folder), "name": obj.name, "strength": strength}
        if stands.place is not None:
            write_array(path.with_suffix(".npy"), stands.place)
            entry["place"] = path.with_suffix(".npy").relative_to(folder)
        entries.append(entry | stands.ends)
    return entries
