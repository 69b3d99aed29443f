"""The settings of the step *Clip*.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

import math

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty

from ...engine.settings import ObserveSettings
from ..option_properties import with_options
from ..property_kinds import choice, file_path
from .match import PARTS

OF_THE_CLIP = ("fps", "frames", "camera", "fov")
"""Options of `ObserveSettings` that belong to the clip; the others belong to the object in it."""
FULL_FRAME = 36.0
"""Width of the sensor to which focal lengths refer [mm]."""


@with_options(ObserveSettings, only=OF_THE_CLIP)
class ClipOptions:
    """Which clip, which part of it, through which camera: settings of a scene, and keyword arguments of Recover."""

    clip: file_path("Clip", "The video in which something is moved by forces that nobody sees")
    camera_mode: choice("Camera", "What is known of the camera", [
        ("AUTO", "Automatic", "The clip's camera solve if it has one, else the field of view"),
        ("SOLVE", "Camera Solve", "The solve of the Movie Clip Editor, placed as the camera with the Camera Solver constraint is"),
        ("SCENE", "Scene Camera", "The scene's camera, at each frame"),
        ("FOV", "Field of View", "A level camera that stands still and looks along +Y"),
        ("JSON", "File", "JSON with width height fx fy cx cy and camera_to_world"),
    ])  # fmt: skip


class SEEING_WIND_PG_view(bpy.types.PropertyGroup):
    """A further synchronised view of the same object."""

    clip: file_path("Clip", "The other camera's video, in step with the first")
    camera: file_path("Camera File", "JSON of that camera: width height fx fy cx cy camera_to_world")
    mask: file_path("Mask", "PNG of that view's first frame, non-zero where the object is")


def _focal_length(settings) -> float:
    return 0.5 * FULL_FRAME / math.tan(0.5 * math.radians(settings.fov))


def _set_focal_length(settings, value: float) -> None:
    settings.fov = math.degrees(2.0 * math.atan(0.5 * FULL_FRAME / value))


class ClipSettings:
    """Settings that only a scene has, not the operator *Recover*."""

    focal_length: FloatProperty(
        name="35 mm Equivalent (mm)", get=_focal_length, set=_set_focal_length, default=38.6, min=0.5, max=2000.0, precision=1, step=100,
        description="The field of view as the focal length of a lens that shows as much on a sensor 36 mm wide",
    )  # fmt: skip
    views: CollectionProperty(type=SEEING_WIND_PG_view)
    active_view: IntProperty(name="Active View", default=0, min=0)
    frame_start: IntProperty(
        name="First Frame", default=1,
        description="Scene frame of the first clip frame; takes effect at the next Recover or Reload. A clip that was in the file before "
        "stays where it is in time",
    )  # fmt: skip
    follows: EnumProperty(
        name="Follows the Clip", items=PARTS, options={"ENUM_FLAG", "HIDDEN"}, description="Which settings of the scene follow the clip"
    )
    follows_decided: BoolProperty(options={"HIDDEN"})


CLASSES = (SEEING_WIND_PG_view,)
