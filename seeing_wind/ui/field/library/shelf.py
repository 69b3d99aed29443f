"""The shelf: winds.blend with an asset for each wind, the catalogs of Blender's Asset Browser, and an index that can be read without
opening the file. `make winds` makes all three. Without NumPy, as the panel reads the index.
"""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy

from ....engine.errors import UsageError
from ..display import frames_per_second

SHELF = Path(__file__).with_name("winds")
BLEND, CATALOGS, INDEX = "winds.blend", "blender_assets.cats.txt", "winds.json"


@dataclass(frozen=True)
class Entry:
    """A wind of the library."""

    name: str
    catalog: str
    description: str


@functools.cache
def entries(shelf: Path) -> tuple[Entry, ...]:
    """The winds of a shelf in their order; empty if there is no such shelf.

    Raises:
        UsageError: when its index is damaged.
    """
    if not (shelf / INDEX).is_file():
        return ()
    try:
        rows: list[Any] = json.loads((shelf / INDEX).read_text(encoding="utf-8"))
        return tuple(Entry(str(row["name"]), str(row["catalog"]), str(row["description"])) for row in rows)
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{shelf / INDEX} is damaged ({error}).", "Install the extension again.") from error


def take_down(scene: bpy.types.Scene, collection: bpy.types.Collection, shelf: Path, name: str) -> bpy.types.Object:
    """Append a wind to a scene. It begins with the scene and plays at its own speed, whatever the frame rate and the unit of length.

    Raises:
        UsageError: when the shelf has no such wind.
    """
    from ..conform import begin_at, set_stride  # need NumPy, as do the next two
    from ..field_object import convert_unit
    from .arrows import show_arrows

    path = shelf / BLEND
    if name not in [each.name for each in entries(shelf)] or not path.is_file():
        raise UsageError(f"The library has no wind {name!r}.", "Choose one of its menu, or install the extension again.")
    with bpy.data.libraries.load(str(path), link=False) as (source, wanted):
        wanted.objects = [each for each in source.objects if each == name]
    if not wanted.objects:
        raise UsageError(f"{path} holds no {name}.", "Install the extension again.")
    field = wanted.objects[0]
    field.asset_clear()
    collection.objects.link(field)
    convert_unit(field, scene)
    begin_at(field, scene.frame_start)
    show_arrows(scene, field)
    set_stride(field, frames_per_second(scene) / field["seeing_wind_fps"])
    return field


def listed() -> bpy.types.UserAssetLibrary | None:
    """The shelf's entry among the asset libraries in Blender's preferences; None if it is not listed."""
    libraries = bpy.context.preferences.filepaths.asset_libraries
    return next((each for each in libraries if each.path and Path(each.path).resolve() == SHELF.resolve()), None)
