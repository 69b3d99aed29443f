"""The first two of three clicks: choose a clip, and mark the object in its first picture."""

import math

import bpy
import gpu
from bpy.props import BoolProperty, EnumProperty, FloatVectorProperty, StringProperty
from gpu_extras.batch import batch_for_shader

from ...engine.conventions import front_view
from ...engine.errors import ClipError, UsageError
from ..direct_operator import DirectOperator
from ..job import status
from ..job.operator import redraw
from ..property_kinds import PATH
from ..user_paths import absolute
from .inputs.clips import first_picture, loaded_clip, scene_frame, start_of
from .match import OURS, PARTS, follow, followed, left_alone

VIDEOS = ".mp4;.mov;.avi;.mkv;.webm;.m4v;.mpg"
LOOKING = ("MOUSE", "INBETWEEN_MOUSEMOVE", "MIDDLEMOUSE", "WHEEL", "TRACKPAD", "NDOF", "NUMPAD", "HOME")
"""How the names of the events begin that move the view, which stays free until the box is begun."""

SMALLEST = 3.0
"""Pixels of the clip that a box must measure: less is a click by mistake."""


class SEEING_WIND_OT_choose_clip(DirectOperator, bpy.types.Operator):
    """Choose the video, show it behind the scene, and take rate, size and place in time from it"""

    bl_idname = "seeing_wind.choose_clip"
    bl_label = "Choose Clip"

    filepath: StringProperty(name="File", subtype="FILE_PATH", options=PATH, description="A video, or one picture of a sequence")
    filter_glob: StringProperty(
        default="*" + VIDEOS.replace(";", ";*") + ";*.png;*.jpg;*.jpeg;*.tif;*.tiff;*.bmp;*.webp", options={"HIDDEN"}
    )
    active: BoolProperty(name="Active Clip", options={"SKIP_SAVE"}, description="The clip that the Movie Clip Editor or the scene has now")

    def invoke(self, context, event):
        """A dropped file comes with its path; otherwise the file browser asks for it."""
        if self.filepath or self.active:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def act(self, context):
        """The clip is seen behind the scene at once."""
        scene = context.scene
        settings = scene.seeing_wind
        path = self.filepath
        if self.active:
            clip = getattr(context.space_data, "clip", None) or scene.active_clip
            if clip is None:
                raise ClipError("The scene has no active movie clip.", "Open one in the Movie Clip Editor, or choose a file.")
            path = clip.filepath
        if not path:
            raise ClipError("No clip is chosen.", "Choose a video of something that is moved by forces.")
        another = absolute(path) != absolute(settings.clip)
        former, settings.clip = settings.clip, path
        try:
            clip = loaded_clip(settings)
        except ClipError:
            settings.clip = former
            raise
        if former and another:  # box and pictures that were chosen for the former one mean nothing here
            settings.box, settings.use_frames = (0.0, 0.0, 0.0, 0.0), False
        settings.frame_start = start_of(clip, first_picture(settings), settings.frame_start)
        ask = not settings.follows_decided
        parts, kept = followed(scene), left_alone(scene)  # before the clip makes the scene another one
        scene.active_clip = clip
        _show(scene, clip, parts)
        if ask and kept and not bpy.app.background:
            bpy.ops.seeing_wind.match_scene("INVOKE_DEFAULT")
        said = f"{clip.name}: {clip.frame_duration} pictures of {clip.size[0]} x {clip.size[1]}"
        return f"{said}; {kept}" if kept else said


class SEEING_WIND_OT_match_scene(DirectOperator, bpy.types.Operator):
    """Choose what of the scene is to be as the clip's, now and whenever results are loaded"""

    bl_idname = "seeing_wind.match_scene"
    bl_label = "Match Scene"

    parts: EnumProperty(
        name="As the Clip's", items=PARTS, options={"ENUM_FLAG", "SKIP_SAVE"}, description="The rest stays as the scene has it"
    )

    def invoke(self, context, event):
        """Ask; what follows already is ticked."""
        self.parts = set(followed(context.scene))
        return context.window_manager.invoke_props_dialog(self, title="What is to be as the clip's?", confirm_text="Match")

    def draw(self, context):
        """One below the other: side by side their names are cut off."""
        self.layout.column(align=True).prop(self, "parts")

    def act(self, context):
        """At once."""
        scene = context.scene
        settings = scene.seeing_wind
        clip = loaded_clip(settings)
        settings.follows, settings.follows_decided = self.parts, True
        field = settings.field_object
        fps = field["seeing_wind_fps"] if field is not None else settings.fps or clip.fps
        last = settings.frames[1] if settings.use_frames else clip.frame_duration - 1 + clip.frame_offset
        frames = int(field["seeing_wind_frames"]) if field is not None else max(last - first_picture(settings), 1)
        camera = settings.camera_object or next((obj for obj in scene.objects if obj.get(OURS)), None)
        follow(
            scene, self.parts, fps=fps, first=settings.frame_start, last=settings.frame_start + frames, size=tuple(clip.size), aspect=None,
            camera=camera,
        )  # fmt: skip
        return left_alone(scene).capitalize() or "The scene is as the clip"


def _show(scene: bpy.types.Scene, clip: bpy.types.MovieClip, parts: frozenset[str]) -> None:
    """Put the clip behind the camera that Recover will use: the scene's own where the settings say so, else one of ours."""
    from .clip_scene import set_background, setup_clip_scene  # these need NumPy
    from .inputs.camera import camera_source

    settings = scene.seeing_wind
    first = first_picture(settings)
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
    setup_clip_scene(scene, bpy.path.abspath(clip.filepath), camera, fps, first, max(last - first, 1), settings.frame_start, parts)


class SEEING_WIND_OT_draw_box(bpy.types.Operator):
    """Draw a box round the object in the clip's first picture: drag with the left mouse button, Esc cancels"""

    bl_idname = "seeing_wind.draw_box"
    bl_label = "Draw Box"
    bl_options = {"REGISTER", "UNDO"}

    box: FloatVectorProperty(
        name="Box (px)", size=4, options={"SKIP_SAVE"}, description="Left, top, right, bottom in pixels of the first picture"
    )

    def execute(self, context):
        """Take the box over, as drawn or as given."""
        settings = context.scene.seeing_wind
        left, top, right, bottom = self.box
        if right - left < SMALLEST or bottom - top < SMALLEST:
            self.report({"ERROR"}, "The box is too small. Drag from one corner of the object to the opposite one.")
            return {"CANCELLED"}
        settings.object_mode, settings.box = "BOX", self.box
        status.refresh(context.scene)
        self.report({"INFO"}, f"Box of {right - left:.0f} x {bottom - top:.0f} pixels")
        return {"FINISHED"}

    def invoke(self, context, event):
        """Show the first picture, then wait for the mouse."""
        scene, space = context.scene, context.space_data
        try:
            clip = loaded_clip(scene.seeing_wind) if scene.seeing_wind.clip else None
        except (ClipError, UsageError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if clip is None:
            self.report({"ERROR"}, "No clip is chosen. Choose one first.")
            return {"CANCELLED"}
        # names and numbers, no datablocks: a job that ends meanwhile may make them anew
        self.clip, self.size, self.former = clip.name, tuple(clip.size), None
        if space.type == "CLIP_EDITOR":
            space.clip = clip
        elif space.type == "VIEW_3D" and scene.camera is not None:
            space.region_3d.view_perspective = "CAMERA"
            self._bring_forward(scene)
        else:
            self.report({"ERROR"}, "Draw the box in a 3D viewport with a camera, or in the Movie Clip Editor.")
            return {"CANCELLED"}
        scene.frame_set(scene_frame(clip, first_picture(scene.seeing_wind)))
        # the button may be in the sidebar; the picture is in the area's main region
        self.area = context.area
        self.region = next(region for region in self.area.regions if region.type == "WINDOW")
        self.start = self.end = None
        self.space_type = type(space)
        self.handler = space.draw_handler_add(self._draw, (context,), "WINDOW", "POST_PIXEL")
        context.window.cursor_modal_set("CROSSHAIR")
        context.workspace.status_text_set("Drag a box round the object   |   Esc, right mouse button: cancel")
        context.window_manager.modal_handler_add(self)
        self.region.tag_redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Press, drag, release; the view can still be moved and zoomed before."""
        if event.type in {"ESC", "RIGHTMOUSE"} or self.area not in context.screen.areas.values():
            self._end(context)
            return {"CANCELLED"}
        at = (float(event.mouse_x - self.region.x), float(event.mouse_y - self.region.y))
        if event.type == "MOUSEMOVE" and self.start is not None:
            self.end = at
            self.region.tag_redraw()
            return {"RUNNING_MODAL"}
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            if not (0 <= at[0] < self.region.width and 0 <= at[1] < self.region.height):
                self._end(context)  # the user has turned to something else
                return {"CANCELLED", "PASS_THROUGH"}
            self.start = self.end = at
            return {"RUNNING_MODAL"}
        if event.type == "LEFTMOUSE" and event.value == "RELEASE" and self.start is not None:
            corners = self._corners(context)
            self._end(context)
            if corners is None:
                self.report({"ERROR"}, "The picture is not in view. Press Numpad 0 for the camera's view and try again.")
                return {"CANCELLED"}
            from .frame_on_screen import box_in_picture  # needs NumPy

            self.box = box_in_picture(corners, self.start, at, *self.size)
            return self.execute(context)
        # not undo, nor anything else that changes the scene under the box
        looks = event.type.startswith(LOOKING) and self.start is None
        return {"PASS_THROUGH"} if looks or event.type.startswith("TIMER") else {"RUNNING_MODAL"}

    def cancel(self, context):
        """Blender ends the operator: a file is loaded or the window closed."""
        self._end(context)

    def _bring_forward(self, scene) -> None:
        """Show the clip before everything while the box is drawn: things in the scene may hide it."""
        camera, background = scene.camera.data, self._background(scene)
        if background is not None:
            self.former = (background.display_depth, background.alpha, camera.show_background_images)
            background.display_depth, background.alpha, camera.show_background_images = "FRONT", 1.0, True

    def _background(self, scene):
        """The clip behind the scene's camera, None where it is not shown."""
        images = scene.camera.data.background_images if scene.camera is not None and scene.camera.type == "CAMERA" else ()
        return next((each for each in images if each.clip is not None and each.clip.name == self.clip), None)

    def _corners(self, context):
        from .frame_on_screen import picture_corners  # needs NumPy

        with context.temp_override(area=self.area, region=self.region, space_data=self.area.spaces.active):
            return picture_corners(bpy.context, self.region)

    def _end(self, context) -> None:
        if self.handler is None:
            return
        self.space_type.draw_handler_remove(self.handler, "WINDOW")
        self.handler = None
        background = self._background(context.scene)
        if self.former is not None and background is not None:
            background.display_depth, background.alpha, context.scene.camera.data.show_background_images = self.former
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)
        redraw()

    def _draw(self, context) -> None:
        if bpy.context.area != self.area:
            return
        if self.start is not None:
            low, high = (tuple(map(pick, self.start, self.end)) for pick in (min, max))
            _rectangle(low, high, (1.0, 0.55, 0.1, 1.0))
            return
        from .frame_on_screen import box_on_screen, picture_corners  # needs NumPy

        corners, box = picture_corners(bpy.context, self.region), context.scene.seeing_wind.box
        if corners is not None:
            _rectangle(*corners, (1.0, 1.0, 1.0, 0.35))
            if box[2] > box[0]:
                _rectangle(*box_on_screen(corners, tuple(box), *self.size), (1.0, 0.55, 0.1, 0.6))


def _rectangle(low, high, colour: tuple[float, float, float, float]) -> None:
    """An outline, filled with a tenth of its colour."""
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    gpu.state.line_width_set(2.0)
    shader.bind()
    shader.uniform_float("color", (*colour[:3], 0.1 * colour[3]))
    batch_for_shader(shader, "TRI_FAN", {"pos": corners}).draw(shader)
    shader.uniform_float("color", colour)
    batch_for_shader(shader, "LINE_LOOP", {"pos": corners}).draw(shader)
    gpu.state.line_width_set(1.0)
    gpu.state.blend_set("NONE")


class SEEING_WIND_FH_clip(bpy.types.FileHandler):
    """A video dropped into the viewport or the Movie Clip Editor becomes the clip."""

    bl_idname = "SEEING_WIND_FH_clip"
    bl_label = "Seeing Wind Clip"
    bl_import_operator = "seeing_wind.choose_clip"
    bl_file_extensions = VIDEOS

    @classmethod
    def poll_drop(cls, context):
        """Where the panels are."""
        return context.area is not None and context.area.type in {"VIEW_3D", "CLIP_EDITOR"}


CLASSES = (SEEING_WIND_OT_choose_clip, SEEING_WIND_OT_match_scene, SEEING_WIND_OT_draw_box, SEEING_WIND_FH_clip)
