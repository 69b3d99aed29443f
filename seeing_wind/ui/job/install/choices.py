"""Access to the user's choices in the extension's preferences; `preferences` displays and changes them."""

from __future__ import annotations

import bpy

EXTENSION = __package__.rpartition(".seeing_wind.ui")[0] or "seeing_wind"
"""The name by which Blender knows this extension: bl_ext.REPOSITORY.seeing_wind, or plain seeing_wind if run from source."""


def preferences() -> bpy.types.AddonPreferences | None:
    """The extension's preferences; None if Blender has none (run from source)."""
    addon = bpy.context.preferences.addons.get(EXTENSION)
    return addon.preferences if addon is not None else None


def preferred_python() -> str:
    """The user's own Python for the engine as an absolute path, or ""."""
    chosen = preferences().python if preferences() is not None else ""
    return bpy.path.abspath(chosen) if chosen else ""


def folder_of_wheels() -> str:
    """The absolute path of the folder from which Install Engine takes all packages; "" for none."""
    chosen = preferences()
    return bpy.path.abspath(chosen.wheels) if chosen is not None and chosen.wheels else ""


def outline_model() -> str:
    """The absolute path of the network that helps to outline objects; "" for the one that is installed with the engine, if any."""
    chosen = preferences()
    return bpy.path.abspath(chosen.outline_model) if chosen is not None and chosen.outline_model else ""


def asked_model() -> tuple[str, str, str]:
    """Address, name and key of the vision-language model; "" for each one that is not set."""
    chosen = preferences()
    return ("", "", "") if chosen is None else (chosen.material_endpoint, chosen.material_model, chosen.material_key)
