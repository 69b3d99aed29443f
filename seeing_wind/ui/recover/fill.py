"""Fill the panel's settings from a take that was made by the command line or a batch, so that the user can continue from it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import bpy

from ...engine.conventions import NO_GRAVITY
from ...engine.errors import TakeError
from ...engine.settings import BuildSettings, ObserveSettings, RecoverSettings, WindSettings
from ...engine.take import Take
from ..option_properties import choice_of, give, panel_options
from ..user_paths import absolute
from .properties import MODES
from .request import gravity_of

OPTIONS = {one.name: one for one in panel_options(ObserveSettings, BuildSettings, RecoverSettings, WindSettings)}


def fill(scene: bpy.types.Scene, take: Take, clip: str) -> bool:
    """Fill a scene's settings from a take, unless the scene has settings of its own.

    A scene with another clip, or in which the object is already marked, keeps its settings. An option whose file no longer exists is
    skipped.

    Args:
        clip: present path of the take's clip; "" for a field from trajectories.

    Returns:
        Whether the settings now equal those of the take, as far as the panel has them.

    Raises:
        TakeError: when a setting in take.toml has an invalid value.
    """
    settings = scene.seeing_wind
    if not clip or not os.path.isfile(clip):
        return False
    own = absolute(settings.clip) if settings.clip else clip
    if own != clip and (not os.path.isfile(own) or not os.path.samefile(own, clip)) or settings.clip and _is_marked(settings):
        return False
    given: dict[str, Any] = {}
    points: list[float] = []
    whole = True
    for stage in take.description().get("stages", {}).values():
        asked = stage.get("settings", {})
        given |= {key: value for key, value in asked.items() if key in OPTIONS}
        points += asked.get("correct") or []
    settings.clip = clip
    _give_corrections(settings, points)
    for name, value in given.items():
        one = OPTIONS[name]
        if one.file and not os.path.isfile(str(value)):
            whole = False
            continue
        try:
            give(settings, one, value)
        except (TypeError, ValueError) as error:
            raise TakeError(f"take.toml of {take.path} says {name} = {value!r} ({error}).", "Run Recover again.") from error
        mode, implied = MODES.get(name, ("", None))
        if mode:
            setattr(settings, mode, implied)
    if "gravity" in given:
        settings.gravity_mode = choice_of(given["gravity"], _gravities(scene))
    elif "solve" in take.description().get("stages", {}):
        settings.gravity_mode = "NONE"
    return whole and _is_marked(settings)


def _gravities(scene: bpy.types.Scene) -> dict[str, Sequence[float]]:
    """Acceleration [m/s²] of each entry of the menu *Gravity* that needs no custom numbers."""
    return {"NONE": NO_GRAVITY} | ({"SCENE": gravity_of(scene)} if scene.use_gravity else {})


def _give_corrections(settings: bpy.types.PropertyGroup, points: list[float]) -> None:
    """Set the outline's correction points from the engine's flat list: frame, x, y and whether the point is on the object, in turn."""
    settings.corrections.clear()
    for clip_frame, x, y, on in zip(*(points[start::4] for start in range(4)), strict=True):
        point = settings.corrections.add()
        point.clip_frame, point.place, point.beside = int(clip_frame), (x, y), not on


def _is_marked(settings: bpy.types.PropertyGroup) -> bool:
    """Whether the user has marked the object; an empty box, as in a new scene, does not count."""
    return settings.object_mode != "BOX" or any(settings.box)
