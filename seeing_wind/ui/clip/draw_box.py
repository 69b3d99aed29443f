"""Draw Box: mark the object in the clip's first picture with the mouse."""

import bpy
import gpu
from bpy.props import EnumProperty, FloatVectorProperty
from gpu_extras.batch import batch_for_shader

from ...engine.errors import ClipError, UsageError
from ..job import status
from ..job.operator import redraw
from .inputs.clips import first_picture, loaded_clip, scene_frame

LOOKING = ("MOUSE", "INBETWEEN_MOUSEMOVE", "MIDDLEMOUSE", "WHEEL", "TRACKPAD", "NDOF", "NUMPAD", "HOME")
"""How the names of the events begin that move the view, which stays free until the box is begun."""

SMALLEST = 3.0
"""Pixels of the clip that a box must measure: less is a click by mistake."""


class SEEING_WIND_OT_draw_box(bpy.types.Operator):
    """Draw a box round the object, or its held part, in the clip's first picture: drag with the left mouse button, Esc cancels"""

    bl_idname = "seeing_wind.draw_box"
    bl_label = "Draw Box"
    bl_options = {"REGISTER", "UNDO"}

    box: FloatVectorProperty(
        name="Box (px)", size=4, options={"SKIP_SAVE"}, description="Left, top, right, bottom in pixels of the first picture"
    )

    marks: EnumProperty(
        name="Marks", options={"SKIP_SAVE"}, description="What the box is drawn round",
        items=[("OBJECT", "Object", "The object that is followed"), ("HELD", "Held Part", "Where the object is held")],
    )  # fmt: skip

    def execute(self, context):
        """Take the box over, as drawn or as given."""
        settings = context.scene.seeing_wind
        left, top, right, bottom = self.box
        if right - left < SMALLEST or bottom - top < SMALLEST:
            self.report({"ERROR"}, "The box is too small. Drag from one corner of the object to the opposite one.")
            return {"CANCELLED"}
        if self.marks == "HELD":
            settings.held_mode, settings.held_box = "BOX", self.box
        else:
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

        corners, settings = picture_corners(bpy.context, self.region), context.scene.seeing_wind
        box = settings.held_box if self.marks == "HELD" else settings.box
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


CLASSES = (SEEING_WIND_OT_draw_box,)
