"""Translation of the engine's messages into the panel's words: `--distance` becomes Distance, and clip frames become scene frames."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from ...engine.conventions import FRAME, FRAME_OF_FILE, frame_named, in_units
from ...engine.settings import BuildSettings, ObserveSettings, RecoverSettings, WindSettings, options_of

STAGES = (ObserveSettings, BuildSettings, RecoverSettings, WindSettings)

LABELS = {
    **{one.flag: one.label for cls in STAGES for one in options_of(cls).values() if one.panel},
    "--points": "Blender Mask", "--correct": "Correct the Outline", "--depth": "Proxy Mesh", "--take": "Take", "--out": "To",
    "--tracks": "Tracks", "--view": "Further Views", "--no-gravity": "Gravity: None",
}  # fmt: skip
"""Panel labels of command-line options, including those for which the panel has something else."""


def in_scene_frames(text: str, frame_of: Callable[[int], int], first_frame: int) -> str:
    """The text with the number of each clip frame replaced by that of the scene frame.

    Args:
        frame_of: from a clip frame, counted from the first one used, to its scene frame.
        first_frame: that first one, where "frame 12 of the file" counts from the file's beginning; see `conventions.as_in_file`.
    """

    def from_first(found: re.Match[str]) -> str:
        return " to ".join(frame_named(int(number) - first_frame) for number in found.groups() if number)

    def in_scene(found: re.Match[str]) -> str:
        return " to ".join(frame_named(frame_of(int(number))) for number in found.groups() if number)

    return FRAME.sub(in_scene, FRAME_OF_FILE.sub(from_first, text))


def in_panel_words(text: str) -> str:
    """The text with each flag that has a panel label replaced by that label."""
    return re.sub(r"`?(--[a-z][a-z-]*)`?", lambda found: LABELS.get(found[1], found[0]), text)


def residual_told(message: Mapping[str, Any]) -> str:
    """The residual in a progress message, as text with its unit; "" if there is none."""
    return in_units(float(message["residual"]), str(message.get("residual_unit", ""))).strip() if "residual" in message else ""
