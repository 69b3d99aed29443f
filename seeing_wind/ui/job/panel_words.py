"""What the engine says to its command line, in the panel's words: `--distance` is called Distance here, and frames are the scene's."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from ...engine.conventions import FRAME, in_units
from ...engine.settings import BuildSettings, ObserveSettings, RecoverSettings, WindSettings, options_of

STAGES = (ObserveSettings, BuildSettings, RecoverSettings, WindSettings)

LABELS = {
    **{one.flag: one.label for cls in STAGES for one in options_of(cls).values() if one.panel},
    "--points": "Blender Mask", "--correct": "Correct the Outline", "--depth": "Proxy Mesh", "--take": "Take", "--out": "To",
    "--tracks": "Tracks", "--view": "Further Views", "--no-gravity": "Gravity: None",
}  # fmt: skip
"""Of the options that the panel has, and what it has in the place of others."""


def in_scene_frames(text: str, frame_of: Callable[[int], int]) -> str:
    """The text with each frame of the clip, counted from the first clip frame that is used, called by its frame in the scene."""
    return FRAME.sub(lambda found: f"frame {frame_of(int(found[1]))}", text)


def in_panel_words(text: str) -> str:
    """The text with each flag that the panel has a property for called by its label."""
    return re.sub(r"`?(--[a-z][a-z-]*)`?", lambda found: LABELS.get(found[1], found[0]), text)


def residual_told(message: Mapping[str, Any]) -> str:
    """How far the simulation is from what was seen, of a message of progress, with its unit; "" where it does not say."""
    return in_units(float(message["residual"]), str(message.get("residual_unit", ""))).strip() if "residual" in message else ""
