"""The extension's preferences: one path, normally empty."""

import bpy
from bpy.props import StringProperty

EXTENSION = __package__.rpartition(".seeing_wind.ui")[0] or "seeing_wind"
"""The name that Blender knows this extension by: bl_ext.REPOSITORY.seeing_wind; run from source, plain."""


def _changed(self, context) -> None:
    from . import engine_environment

    engine_environment.refresh()


class SEEING_WIND_AP_preferences(bpy.types.AddonPreferences):
    """Preferences > Add-ons > Seeing Wind."""

    bl_idname = EXTENSION

    python: StringProperty(
        name="Engine Python", subtype="FILE_PATH", update=_changed,
        description="Python 3.11 to 3.13 with the engine's packages; empty uses the engine that Install Engine made",
    )  # fmt: skip

    def draw(self, context) -> None:
        from .panel_pieces import draw_engine

        self.layout.prop(self, "python")
        draw_engine(self.layout, context)


def preferred_python() -> str:
    """The user's own Python for the engine as an absolute path, or ""."""
    addon = bpy.context.preferences.addons.get(EXTENSION)
    chosen = addon.preferences.python if addon is not None and addon.preferences is not None else ""
    return bpy.path.abspath(chosen) if chosen else ""


CLASSES = (SEEING_WIND_AP_preferences,)
