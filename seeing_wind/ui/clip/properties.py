"""The settings of the step *Clip*.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

from bpy.props import BoolProperty, EnumProperty, IntProperty, IntVectorProperty

from ...engine.conventions import DEFAULT_FOV_DEGREES
from ..property_kinds import KEPT, changed, choice, file_path, number, toggle
from .match import PARTS


class ClipOptions:
    """Which clip, which part of it, through which camera: settings of a scene, and keyword arguments of Recover."""

    clip: file_path("Clip", "The video in which something is moved by forces that nobody sees")
    fps: number("FPS (1/s)", 0.0, "Frames per second of the clip; 0 takes what the file says", min=0.0, soft_max=240.0, step=100)
    use_frames: toggle("Part of the Clip", "Use only some of the clip's pictures")
    frames: IntVectorProperty(
        name="Pictures",
        size=2,
        default=(0, 40),
        min=0,
        description="First and last picture, both inclusive, counted from 0",
        options=KEPT,
        update=changed,
    )
    camera_mode: choice("Camera", "What is known of the camera", [
        ("AUTO", "Automatic", "The clip's camera solve if it has one, else the field of view"),
        ("SOLVE", "Camera Solve", "The solve of the Movie Clip Editor, placed as the camera with the Camera Solver constraint is"),
        ("SCENE", "Scene Camera", "The scene's camera, at each frame"),
        ("FOV", "Field of View", "A level camera that stands still and looks along +Y"),
        ("JSON", "File", "JSON with width height fx fy cx cy and camera_to_world"),
    ])  # fmt: skip
    fov: number("FOV (°)", DEFAULT_FOV_DEGREES, "Horizontal field of view in degrees", min=1.0, max=170.0, step=100, precision=1)
    camera: file_path("Camera File", "JSON: width height fx fy cx cy, camera_to_world (4x4, OpenCV axes, one or one per picture)")


class ClipSettings:
    """What only the scene has."""

    frame_start: IntProperty(
        name="First Frame", default=1,
        description="Scene frame of the first picture used; takes effect at the next Recover or Reload. A clip that was in the file before "
        "stays where it is in time",
    )  # fmt: skip
    follows: EnumProperty(
        name="Follows the Clip", items=PARTS, options={"ENUM_FLAG", "HIDDEN"}, description="What of the scene is as the clip's"
    )
    follows_decided: BoolProperty(options={"HIDDEN"})
