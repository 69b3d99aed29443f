"""`scene.seeing_wind`: the settings of all steps in one property group."""

import bpy

from .bake.properties import BakeSettings
from .clip.object.properties import ObjectSettings
from .clip.properties import ClipSettings
from .composite.properties import CompositeSettings
from .edit.properties import EditOptions, EditSettings
from .field.properties import FieldSettings
from .job.steps_shown import StepsShown
from .recover.properties import RecoverOptions, RecoverResults


class SEEING_WIND_PG_scene(
    RecoverOptions, ClipSettings, ObjectSettings, EditOptions, EditSettings, BakeSettings, FieldSettings, CompositeSettings, RecoverResults,
    StepsShown, bpy.types.PropertyGroup,
):  # fmt: skip
    """`scene.seeing_wind`."""


CLASSES = (SEEING_WIND_PG_scene,)


def register() -> None:
    """Attach the settings to every scene."""
    bpy.types.Scene.seeing_wind = bpy.props.PointerProperty(type=SEEING_WIND_PG_scene)


def unregister() -> None:
    """Remove the settings."""
    del bpy.types.Scene.seeing_wind
