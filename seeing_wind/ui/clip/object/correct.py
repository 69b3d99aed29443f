"""Correcting the outline in any picture, by points on the object and beside it; the engine carries them to the other pictures."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, FloatVectorProperty, IntProperty

from ....engine.errors import ClipError, ObjectError, UsageError
from ...direct_operator import DirectOperator
from ..draw_box import LOOKING
from ..inputs.clips import loaded_clip, pace_of

NOW = -1
"""For the picture that the scene shows now."""


class SEEING_WIND_OT_correct_outline(DirectOperator, bpy.types.Operator):
    """Click a point on the object that the outline leaves out, in the picture that is shown now; Esc cancels"""

    bl_idname = "seeing_wind.correct_outline"
    bl_label = "Point on Object"

    place: FloatVectorProperty(
        name="Place (px)", size=2, options={"SKIP_SAVE"}, description="From the left and from the top, in pixels of the clip"
    )
    picture: IntProperty(
        name="Picture", default=NOW, min=NOW, options={"SKIP_SAVE"}, description="Counted from 0 in the file; -1: the one shown now"
    )
    beside: BoolProperty(name="Beside", options={"SKIP_SAVE"}, description="The point is not on the object, but the outline takes it in")

    @classmethod
    def description(cls, context, properties):
        """The two buttons say what they are for."""
        what = "beside the object that the outline takes in" if properties.beside else "on the object that the outline leaves out"
        return f"Click a point {what}, in the picture that is shown now; Esc cancels"

    def act(self, context):
        """One more correction."""
        scene, settings = context.scene, context.scene.seeing_wind
        if not settings.clip:
            raise ClipError("No clip is chosen.", "Choose one first.")
        clip = loaded_clip(settings)
        first, pace = pace_of(clip)
        picture = first + pace.shown(scene.frame_current) if self.picture == NOW else self.picture
        if not 0 <= picture < clip.frame_duration:
            raise UsageError(f"The clip has no picture {picture}.", f"Go to a frame that shows one of 0 to {clip.frame_duration - 1}.")
        if not all(0.0 <= at <= side - 1.0 for at, side in zip(self.place, clip.size)):
            raise UsageError("The point lies outside the picture.", "Click on the picture.")
        point = settings.corrections.add()
        point.picture, point.place, point.beside = picture, self.place, self.beside
        return f"The outline is corrected in picture {picture}; Preview shows it"

    def invoke(self, context, event):
        """Wait for a click in the area's picture."""
        if self.properties.is_property_set("place"):
            return self.execute(context)
        if context.area is None or context.area.type not in ("VIEW_3D", "CLIP_EDITOR"):
            self.report({"ERROR"}, "Click the point in a 3D viewport with a camera, or in the Movie Clip Editor.")
            return {"CANCELLED"}
        self.area = context.area
        self.region = next(region for region in self.area.regions if region.type == "WINDOW")
        context.window.cursor_modal_set("EYEDROPPER")
        where = "beside" if self.beside else "on"
        context.workspace.status_text_set(f"Click a point {where} the object   |   Esc, right mouse button: cancel")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """The view can be moved and zoomed before the click."""
        if event.type in {"ESC", "RIGHTMOUSE"} or self.area not in context.screen.areas.values():
            self.cancel(context)
            return {"CANCELLED"}
        if event.type != "LEFTMOUSE" or event.value != "PRESS":
            looks = event.type.startswith((*LOOKING, "TIMER"))
            return {"PASS_THROUGH"} if looks else {"RUNNING_MODAL"}
        self.cancel(context)
        from ..frame_on_screen import box_in_picture, picture_corners  # needs NumPy

        with context.temp_override(area=self.area, region=self.region, space_data=self.area.spaces.active):
            corners = picture_corners(bpy.context, self.region)
        if corners is None or not context.scene.seeing_wind.clip:
            self.report({"ERROR"}, "The picture is not in view. Press Numpad 0 for the camera's view and try again.")
            return {"CANCELLED"}
        at = (float(event.mouse_x - self.region.x), float(event.mouse_y - self.region.y))
        self.place = box_in_picture(corners, at, at, *loaded_clip(context.scene.seeing_wind).size)[:2]
        return self.execute(context)

    def cancel(self, context):
        """Blender or the user ends the operator."""
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)


class SEEING_WIND_OT_clear_corrections(DirectOperator, bpy.types.Operator):
    """Forget the points that correct the outline: the last one, or all"""

    bl_idname = "seeing_wind.clear_corrections"
    bl_label = "Remove Point"

    all: BoolProperty(name="All", options={"SKIP_SAVE"}, description="Not only the last one")

    def act(self, context):
        """The outline is as it is found without them."""
        points = context.scene.seeing_wind.corrections
        if not len(points):
            raise ObjectError("The outline has no corrections.", "Click a point on the object or beside it first.")
        for _ in range(len(points) if self.all else 1):
            points.remove(len(points) - 1)
        return f"{len(points)} corrections are left"


CLASSES = (SEEING_WIND_OT_correct_outline, SEEING_WIND_OT_clear_corrections)
