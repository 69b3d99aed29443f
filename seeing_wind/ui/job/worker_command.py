"""The worker's command line and environment."""

from __future__ import annotations

import os
from pathlib import Path

from ...engine.settings.observe import NETWORK_VARIABLE

ROOT = Path(__file__).resolve().parents[3]
"""The folder that contains the package `seeing_wind`, where the worker finds it under its plain name."""


def command(python: str, verb: str, *options: str) -> list[str]:
    """The worker's command line."""
    return [python, "-m", "seeing_wind.engine", verb, *options]


KEY_VARIABLE = "SEEING_WIND_MATERIAL_KEY"
"""Environment variable in which the engine looks for the key of the model that is asked about materials."""


def environment(key: str = "", outline_model: str = "") -> dict[str, str]:
    """This process's environment without Blender's Python settings, which would break another Python, and with a model's `key` and the path
    of the `outline_model`, if there is one."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    if key:
        kept[KEY_VARIABLE] = key
    if outline_model:
        kept[NETWORK_VARIABLE] = outline_model
    # Compiled modules are cached beside the engine's files, as Blender does for the panel's; otherwise every start takes a second longer.
    # If the folder is not writable, Python does without the cache.
    return kept | {"PYTHONPATH": str(ROOT), "PYTHONUTF8": "1", "PYTHONNOUSERSITE": "1"}
