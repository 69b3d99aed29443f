"""Choose a clip, the first of three clicks, and the scene settings that follow it."""

import math
import os

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ...engine.conventions import front_view
from ...engine.errors import ClipError
from ..direct_operator import DirectOperator
from ..property_kinds import PATH
from ..user_paths import absolute, relate
from .inputs.clips import first_clip_frame, follow_moved, loaded_clip, start_of
from .match import OURS, PARTS, follow, followed, hide_default_cube, left_alone

ACTIVE = "Take the clip that the Movie Clip Editor or the scene has now"
VIDEOS = ".mp4;.mov;.avi;.mkv;.webm;.m4v;.mpg"


class SEEING_WIND_OT_choose_clip(DirectOperator, bpy.types.Operator):
    """Choose the video, show it behind the scene, and take rate, size and place in time from it"""

    bl_idname = "seeing_wind.choose_clip"
    bl_label = "Choose Clip"

    filepath: StringProperty(name="File", subtype="FILE_PATH", options=PATH, description="A video, or one image of a sequence")
    filter_glob: StringProperty(
        default="*" + VIDEOS.replace(";", ";*") + ";*.png;*.jpg;*.jpeg;*.tif;*.tiff;*.bmp;*.webp", options={"HIDDEN"}
    )
    # hidden: the file browser would show it as a checkbox
    active: BoolProperty(name="Active Clip", options={"SKIP_SAVE", "HIDDEN"}, description=ACTIVE)

    @classmethod
    def description(cls, context, properties):
        """The tooltip: the panel has two buttons for this operator."""
        return ACTIVE if properties.active else cls.__doc__

    def invoke(self, context, event):
        """Run at once for a dropped file or the active clip; otherwise open the file browser."""
        if self.filepath or self.active:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def act(self, context):
        """Load the clip and show it behind the scene."""
        scene = context.scene
        settings = scene.seeing_wind
        path = self.filepath
        if self.active:
            clip = getattr(context.space_data, "clip", None) or scene.active_clip
            if clip is None:
                raise ClipError("The scene has no active movie clip.", "Open one in the Movie Clip Editor, or choose a file.")
            path = absolute(clip.filepath, clip.library)
        if not path:
            raise ClipError("No clip is chosen.", "Choose a video of something that is moved by forces.")
        another = absolute(path) != absolute(settings.clip) and not follow_moved(settings, absolute(path))
        former, settings.clip = settings.clip, path
        try:
            clip = loaded_clip(settings)
        except ClipError:
            settings.clip = former
            raise
        if former and another:  # boxes, points and frames of the former clip do not apply to this one
            settings.box = settings.held_box = (0.0, 0.0, 0.0, 0.0)
            settings.use_frames = False
            settings.corrections.clear()
        settings.frame_start = start_of(clip, first_clip_frame(settings), settings.frame_start)
        ask = not settings.follows_decided
        parts, kept = followed(scene), left_alone(scene)  # before the clip changes the scene
        scene.active_clip = clip
        _show(scene, clip, parts)
        if bpy.data.filepath and context.preferences.filepaths.use_relative_paths:
            relate(settings, os.path.dirname(bpy.data.filepath))
        if "CAMERA" in parts and context.area is not None and context.area.type == "VIEW_3D":
            context.space_data.region_3d.view_perspective = "CAMERA"
        hidden = hide_default_cube(scene) if "CAMERA" in parts else ""
        if ask and kept and not bpy.app.background:
            bpy.ops.seeing_wind.match_scene("INVOKE_DEFAULT")
        said = [f"{clip.name}: {clip.frame_duration} frames of {clip.size[0]} x {clip.size[1]}", kept, hidden]
        return "; ".join(each for each in said if each)


class SEEING_WIND_OT_match_scene(DirectOperator, bpy.types.Operator):
    """Choose which settings of the scene follow the clip, now and whenever results are loaded"""

    bl_idname = "seeing_wind.match_scene"
    bl_label = "Match Scene"

    parts: EnumProperty(
        name="Follows the Clip", items=PARTS, options={"ENUM_FLAG", "SKIP_SAVE"}, description="The other settings stay as they are"
    )

    def invoke(self, context, event):
        """Ask in a dialog in which the parts that already follow are ticked."""
        self.parts = set(followed(context.scene))
        return context.window_manager.invoke_props_dialog(self, title="Which settings follow the clip?", confirm_text="Match")

    def draw(self, context):
        """Draw the parts in a column, since their names are cut off in a row."""
        self.layout.column(align=True).prop(self, "parts")

    def act(self, context):
        """Make the chosen parts follow the clip at once."""
        scene = context.scene
        settings = scene.seeing_wind
        clip = loaded_clip(settings)
        settings.follows, settings.follows_decided = self.parts, True
        field = settings.field_object
        fps = field["seeing_wind_fps"] if field is not None else settings.fps or clip.fps
        last = settings.frames[1] if settings.use_frames else clip.frame_duration - 1 + clip.frame_offset
        frames = int(field["seeing_wind_frames"]) if field is not None else max(last - first_clip_frame(settings), 1)
        camera = settings.camera_object or next((obj for obj in scene.objects if obj.get(OURS)), None)
        follow(
            scene, self.parts, fps=fps, first=settings.frame_start, last=settings.frame_start + frames, size=tuple(clip.size), aspect=None,
            camera=camera,
        )  # fmt: skip
        kept = left_alone(scene)
        return f"{kept[0].upper()}{kept[1:]}" if kept else "The scene follows the clip"


def _show(scene: bpy.types.Scene, clip: bpy.types.MovieClip, parts: frozenset[str]) -> None:
    """Make the clip the background of the camera that Recover will use: the scene's own if the settings say so, else ours."""
    from .clip_scene import set_background, setup_clip_scene  # these need NumPy
    from .inputs.camera import camera_source

    settings = scene.seeing_wind
    first = first_clip_frame(settings)
    if settings.camera_mode in ("SOLVE", "SCENE") or (settings.camera_mode == "AUTO" and camera_source(scene)):
        camera = scene.camera
        if camera is not None and camera.type == "CAMERA" and not len(camera.data.background_images):
            set_background(camera.data, clip)
        return
    width, height = clip.size
    focal = 0.5 * width / math.tan(0.5 * math.radians(settings.fov))
    camera = {
        "width": width, "height": height, "fx": focal, "fy": focal, "cx": 0.5 * (width - 1), "cy": 0.5 * (height - 1),
        "camera_to_world": front_view(settings.distance),
    }  # fmt: skip
    last = settings.frames[1] if settings.use_frames else clip.frame_duration - 1 + clip.frame_offset
    fps = settings.fps or clip.fps or scene.render.fps / scene.render.fps_base
    setup_clip_scene(scene, absolute(clip.filepath, clip.library), camera, fps, first, max(last - first, 1), settings.frame_start, parts)


class SEEING_WIND_FH_clip(bpy.types.FileHandler):
    """A video dropped into the viewport or the Movie Clip Editor becomes the clip."""

    bl_idname = "SEEING_WIND_FH_clip"
    bl_label = "Seeing Wind Clip"
    bl_import_operator = "seeing_wind.choose_clip"
    bl_file_extensions = VIDEOS

    @classmethod
    def poll_drop(cls, context):
        """Accept a drop in the editors that have our panels."""
        return context.area is not None and context.area.type in {"VIEW_3D", "CLIP_EDITOR"}


CLASSES = (SEEING_WIND_OT_choose_clip, SEEING_WIND_OT_match_scene, SEEING_WIND_FH_clip)
