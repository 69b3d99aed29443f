"""Wait for the mouse over the clip's frame, in a camera view or the Movie Clip Editor, to mark a box or a point."""

import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ...engine.errors import ClipError, UsageError
from ..job.operator import redraw
from .inputs.clips import loaded_clip

LOOKING = ("MOUSE", "INBETWEEN_MOUSEMOVE", "MIDDLEMOUSE", "WHEEL", "TRACKPAD", "NDOF", "NUMPAD", "HOME")
"""Prefixes of the names of events that move the view."""


class OnFrame:
    """Mix-in of a modal operator: shows the clip in front of the scene while it waits, and restores the view when it ends."""

    def begin(self, context, says: str, cursor: str) -> bool:
        """Show the clip and start waiting. Reports an error and returns False if no clip can be shown."""
        scene, space = context.scene, context.space_data
        try:
            clip = loaded_clip(scene.seeing_wind)
        except (ClipError, UsageError) as error:
            self.report({"ERROR"}, str(error))
            return False
        # names and numbers, not datablocks: a job that ends meanwhile may recreate these
        self.clip, self.size, self.former = clip.name, tuple(clip.size), None
        if space is not None and space.type == "CLIP_EDITOR":
            space.clip = clip
        elif space is not None and space.type == "VIEW_3D" and scene.camera is not None:
            space.region_3d.view_perspective = "CAMERA"
            self._bring_forward(scene)
        else:
            self.report({"ERROR"}, f"{self.bl_label} needs a 3D viewport with a camera, or the Movie Clip Editor.")
            return False
        # the button may be in the sidebar; the frame is in the area's main region
        self.area = context.area
        self.region = next(region for region in self.area.regions if region.type == "WINDOW")
        self.space_type = type(space)
        self.handler = space.draw_handler_add(self._draw, (context,), "WINDOW", "POST_PIXEL")
        context.window.cursor_modal_set(cursor)
        context.workspace.status_text_set(f"{says}   |   Esc, right mouse button: cancel")
        context.window_manager.modal_handler_add(self)
        self.region.tag_redraw()
        return True

    def given_up(self, context, event) -> set[str] | None:
        """The return value for `modal` if the user cancels or clicks elsewhere, which ends the wait; None to go on."""
        if event.type in {"ESC", "RIGHTMOUSE"} or self.area not in context.screen.areas.values():
            self.end(context)
            return {"CANCELLED"}
        if event.type == "LEFTMOUSE" and event.value == "PRESS" and self._elsewhere(event):
            self.end(context)
            return {"CANCELLED", "PASS_THROUGH"}
        return None

    def at(self, event) -> tuple[float, float]:
        """Position of the mouse in the region [px]."""
        return float(event.mouse_x - self.region.x), float(event.mouse_y - self.region.y)

    def corners(self, context):
        """`frame_corners` of the region. Reports an error and returns None if the frame is not in view."""
        from .frame_on_screen import frame_corners  # needs NumPy

        with context.temp_override(area=self.area, region=self.region, space_data=self.area.spaces.active):
            found = frame_corners(bpy.context, self.region)
        if found is None:
            self.report({"ERROR"}, "The clip is not in view. Press Numpad 0 for the camera's view and try again.")
        return found

    def end(self, context) -> None:
        """Restore everything; further calls do nothing."""
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

    def cancel(self, context):
        """End the wait when Blender cancels the operator, because a file is loaded or the window closed."""
        self.end(context)

    def draw_over(self, context, corners) -> None:
        """Draw over the frame, which lies between `corners`, during the wait."""
        raise NotImplementedError

    def _elsewhere(self, event) -> bool:
        """Whether the mouse is in another area, or on the sidebar, which lies over the frame."""
        sidebars = [each for each in self.area.regions if each.type == "UI" and each.width > 1]
        return not _holds(self.region, event) or any(_holds(each, event) for each in sidebars)

    def _bring_forward(self, scene) -> None:
        """Show the clip in front of the scene, whose objects may hide it."""
        camera, background = scene.camera.data, self._background(scene)
        if background is not None:
            self.former = (background.display_depth, background.alpha, camera.show_background_images)
            background.display_depth, background.alpha, camera.show_background_images = "FRONT", 1.0, True

    def _background(self, scene):
        """The background image of the scene's camera that shows the clip; None if there is none."""
        images = scene.camera.data.background_images if scene.camera is not None and scene.camera.type == "CAMERA" else ()
        return next((each for each in images if each.clip is not None and each.clip.name == self.clip), None)

    def _draw(self, context) -> None:
        if bpy.context.area != self.area:
            return
        from .frame_on_screen import frame_corners  # needs NumPy

        corners = frame_corners(bpy.context, self.region)
        if corners is not None:
            self.draw_over(context, corners)


def _holds(region, event) -> bool:
    return 0 <= event.mouse_x - region.x < region.width and 0 <= event.mouse_y - region.y < region.height


def draw_rectangle(low, high, colour: tuple[float, float, float, float]) -> None:
    """Draw a rectangle's outline, and fill it at a tenth of its opacity."""
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
