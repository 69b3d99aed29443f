"""A wind without its take (appended, linked or from the library): a take for simulating in it is made from the values it carries."""

from __future__ import annotations

import json
import math

import bpy
import numpy as np

from ....engine.errors import UsageError
from ....engine.take import Take, stamp_of
from ...field.conform import begin_with_scene
from ...field.display import KIND, field_at_hand, frames_per_second, is_field, stride_of
from ...field.samples import read_samples, rows_at, samples_of
from ...field.texture.reach import reach_of
from ...job import takes
from ...scene_units import metres_per_unit

LONE = "lone wind"
"""Stage named in the description of such a take, whose contents are made anew before each re-simulation."""

MOST = 5000
"""Largest number of clip frames in such a take."""
UNITS = {"force": "N/m3", "wind": "m/s"}
"""Units as written in the engine's field files."""


def lone_wind(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The field object of a scene that shows no take, or only one made here; None if there is no field, or the scene shows another take.

    Of several, it is the selected one, else the one used last.

    Raises:
        UsageError: when there are several, none is selected, and they do not all act.
    """
    settings = scene.seeing_wind
    if settings.recovered_take and not takes.shows_lone(settings):
        return None
    there = sorted((obj for obj in scene.objects if is_field(obj)), key=lambda obj: obj.name)
    meant = field_at_hand(bpy.context) if bpy.context.scene == scene else settings.field_object
    if meant in there:
        return meant
    if len(there) > 1 and not settings.use_further_fields:
        names = ", ".join(obj.name for obj in there[:4])
        raise UsageError(f"There are several winds: {names}.", "Select the one in which the bodies are to move, too.")
    return there[0] if there else None


def adopt(scene: bpy.types.Scene, field: bpy.types.Object) -> list[str]:
    """Make a take from the values of a field object and let the scene show it. It starts at the scene's or the field's first frame,
    whichever is later, and lasts to the end of the scene.

    In each frame it holds what solvers feel in that frame. Returns notes for the user: whether the wind was moved in time to begin with the
    scene, because it would not have blown during the scene otherwise.

    Raises:
        UsageError: when the field's values are gone, it is linked and does not blow in the scene, or the scene has no or too many frames.
    """
    settings, samples = scene.seeing_wind, samples_of(field)
    if samples is None:
        raise UsageError(f"The values under {field.name} are gone.", "Append or add it again.")
    moved, stride = begin_with_scene(scene, field), stride_of(field)
    first = max(int(field["seeing_wind_frame_start"]), scene.frame_start)
    count = math.ceil((scene.frame_end - first) / stride)
    if not 0 < count <= MOST:
        begins = f"{field.name} blows here from frame {first} on, and the scene ends at {scene.frame_end}."
        raise UsageError(begins, f"Let the scene last for 1 to {MOST} frames of the wind.")
    fps = frames_per_second(scene) / stride
    box, fields = field_files(field, samples, first + stride * (np.arange(count) + 0.5), metres_per_unit(scene), fps)
    parts = list(fields.values())
    take = Take(takes.home_of(scene, field.name))
    stamp = stamp_of(*parts)
    if take.description().get("stages", {}).get("recover", {}).get("stamp") != stamp:
        take.path.mkdir(parents=True, exist_ok=True)
        take.withdraw("recover")
        take.file("wind.safetensors").unlink(missing_ok=True)
        for name, content in zip(fields, parts, strict=True):
            with take.writing(name) as path:
                path.write_bytes(content)
        density = float(field["seeing_wind_density"])
        take.write_json("report.json", {"box": box.tolist(), "fps": fps, "frames": count, "material": {"density": density}})
        take.finish(LONE, stamp, {"field": field.name})
        take.finish("recover", stamp, {})
    takes.show(settings, take.path, takes.NOT_RECOVERED)
    settings.field_object, settings.frame_start, settings.real_time = field, first, True
    return [moved] if moved else []


def field_files(
    field: bpy.types.Object, samples: bpy.types.Object, times: np.ndarray, metres: float, fps: float
) -> tuple[np.ndarray, dict[str, bytes]]:
    """What solvers feel of a field object, from the values that it carries, as files of the engine.

    Args:
        times: (T,) scene frames at which the T frames of the files act.
        metres: length of one scene unit [m].
        fps: frames of the files per second.

    Returns:
        The box (2, 3) [m] in the object's own coordinates, and the contents of the files by name: the force, then the wind if it is felt.
    """
    sampled = read_samples(samples)
    counts, frames, box = sampled.counts, len(sampled.force), sampled.box * metres
    rows = rows_at(field, times, frames)
    left = sampled.left(reach_of(field["seeing_wind_reach"], sampled.box))[..., None]
    fields = {"field.safetensors": ("force", sampled.force * left)}
    if sampled.velocity is not None and field[KIND] == "WIND":
        fields["wind.safetensors"] = ("wind", sampled.velocity * left)
    return box, {
        name: _field_file(kind, (values * metres).reshape(frames, *counts, 3), rows, box, fps) for name, (kind, values) in fields.items()
    }


def _field_file(kind: str, values: np.ndarray, rows: np.ndarray, box: np.ndarray, fps: float) -> bytes:
    """A safetensors file that the engine reads as a `ForceFieldLattice`: values (N, A, B, C, 3), and the row acting in each frame (T,)."""
    tensors = {"force": ("F32", values.astype("<f4")), "row": ("I64", rows.astype("<i8"))}
    metadata = {
        "representation": "lattice", "version": "2", "units": UNITS[kind], "kind": kind, "box": json.dumps(box.tolist()),
        "fps": repr(float(fps)), "frames": str(len(rows)),
    }  # fmt: skip
    header: dict[str, object] = {"__metadata__": metadata}
    at = 0
    for name, (dtype, array) in tensors.items():
        header[name] = {"dtype": dtype, "shape": list(array.shape), "data_offsets": [at, at + array.nbytes]}
        at += array.nbytes
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + b"".join(np.ascontiguousarray(array).tobytes() for _, array in tensors.values())
