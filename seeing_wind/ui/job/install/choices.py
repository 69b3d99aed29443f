"""What the user has chosen in the extension's preferences, for those who need it; `preferences` shows and changes it."""

from __future__ import annotations

import bpy

EXTENSION = __package__.rpartition(".seeing_wind.ui")[0] or "seeing_wind"
"""The name that Blender knows this extension by: bl_ext.REPOSITORY.seeing_wind; run from source, plain."""


def preferences() -> bpy.types.AddonPreferences | None:
    """The preferences, None where Blender keeps none (run from source)."""
    addon = bpy.context.preferences.addons.get(EXTENSION)
    return addon.preferences if addon is not None else None


def preferred_python() -> str:
    """The user's own Python for the engine as an absolute path, or ""."""
    chosen = preferences().python if preferences() is not None else ""
    return bpy.path.abspath(chosen) if chosen else ""


def folder_of_wheels() -> str:
    """The absolute path of the folder that Install Engine takes all packages from, "" for none."""
    chosen = preferences()
    return bpy.path.abspath(chosen.wheels) if chosen is not None and chosen.wheels else ""


def asked_model() -> tuple[str, str, str]:
    """Address, name and key of the vision-language model; "" for what is not given."""
    chosen = preferences()
    return ("", "", "") if chosen is None else (chosen.material_endpoint, chosen.material_model, chosen.material_key)
