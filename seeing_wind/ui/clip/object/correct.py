"""Correct the outline in any frame by points on and off the object; the engine propagates them to the other frames."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, FloatVectorProperty, IntProperty

from ....engine.errors import ObjectError, UsageError
from ...direct_operator import DirectOperator
from ..inputs.clips import loaded_clip, pace_of
from ..on_frame import LOOKING, OnFrame, draw_rectangle

NOW = -1
"""For the frame that the scene shows now."""

MARK, COLOURS = 4.0, {False: (0.2, 1.0, 0.3, 1.0), True: (1.0, 0.25, 0.2, 1.0)}
"""Half the side of a point's mark on the screen [px], and its colour, by whether it is beside the object."""


class SEEING_WIND_OT_correct_outline(OnFrame, DirectOperator, bpy.types.Operator):
    """Click a point on the object that the outline leaves out, in the frame that is shown now; Esc cancels"""

    bl_idname = "seeing_wind.correct_outline"
    bl_label = "Point on Object"

    place: FloatVectorProperty(
        name="Place (px)", size=2, options={"SKIP_SAVE"}, description="From the left and from the top, in pixels of the clip"
    )
    clip_frame: IntProperty(
        name="Frame", default=NOW, min=NOW, options={"SKIP_SAVE"}, description="Counted from 0 in the file; -1: the one shown now"
    )
    beside: BoolProperty(
        name="Off the Object", options={"SKIP_SAVE"}, description="The point is not on the object, but the outline takes it in"
    )

    @classmethod
    def description(cls, context, properties):
        """The tooltip, which differs between the panel's two buttons."""
        what = "off the object that the outline takes in" if properties.beside else "on the object that the outline leaves out"
        return f"Click a point {what}, in the frame that is shown now; Esc cancels"

    def act(self, context):
        """Add a correction."""
        scene, settings = context.scene, context.scene.seeing_wind
        clip = loaded_clip(settings)
        first, pace = pace_of(clip)
        clip_frame = first + pace.shown(scene.frame_current) if self.clip_frame == NOW else self.clip_frame
        begin, end = settings.frames if settings.use_frames else (0, clip.frame_duration - 1)
        if not max(begin, 0) <= clip_frame <= min(end, clip.frame_duration - 1):
            raise UsageError(
                f"Frame {clip_frame} of the file is not among those used, {begin} to {end}.", "Go to a scene frame that shows one of them."
            )
        if not all(-0.5 <= at <= side - 0.5 for at, side in zip(self.place, clip.size)):
            raise UsageError("The point lies outside the clip's image.", "Click on the image.")
        point = settings.corrections.add()
        point.clip_frame, point.place, point.beside = clip_frame, self.place, self.beside
        return f"The outline is corrected in frame {clip_frame} of the file; Preview shows it"

    def invoke(self, context, event):
        """Wait for a click on the clip's frame, unless the place is given."""
        if self.properties.is_property_set("place"):
            return self.execute(context)
        where = "off" if self.beside else "on"
        return {"RUNNING_MODAL"} if self.begin(context, f"Click a point {where} the object", "EYEDROPPER") else {"CANCELLED"}

    def modal(self, context, event):
        """Wait for the click; before that, the view can be moved and zoomed."""
        ended = self.given_up(context, event)
        if ended is not None:
            return ended
        if event.type != "LEFTMOUSE" or event.value != "PRESS":
            return {"PASS_THROUGH"} if event.type.startswith((*LOOKING, "TIMER")) else {"RUNNING_MODAL"}
        corners = self.corners(context)
        self.end(context)
        if corners is None:
            return {"CANCELLED"}
        from ..frame_on_screen import point_in_frame  # needs NumPy

        self.place = point_in_frame(corners, self.at(event), *self.size)
        return self.execute(context)

    def draw_over(self, context, corners) -> None:
        """Draw the frame's existing corrections."""
        from ..frame_on_screen import box_on_screen  # needs NumPy

        draw_rectangle(*corners, (1.0, 1.0, 1.0, 0.35))
        clip = bpy.data.movieclips.get(self.clip)
        if clip is None:  # a job that ended meanwhile recreated it
            return
        first, pace = pace_of(clip)
        shown = first + pace.shown(context.scene.frame_current)
        for point in (each for each in context.scene.seeing_wind.corrections if each.clip_frame == shown):
            (x, y), colour = box_on_screen(corners, (*point.place, *point.place), *self.size).mean(axis=0), COLOURS[point.beside]
            draw_rectangle((x - MARK, y - MARK), (x + MARK, y + MARK), colour)


class SEEING_WIND_OT_clear_corrections(DirectOperator, bpy.types.Operator):
    """Forget the points that correct the outline: the last one, or all"""

    bl_idname = "seeing_wind.clear_corrections"
    bl_label = "Remove Point"

    all: BoolProperty(name="All", options={"SKIP_SAVE"}, description="Not only the last one")

    def act(self, context):
        """Remove the last correction, or all."""
        points = context.scene.seeing_wind.corrections
        if not len(points):
            raise ObjectError("The outline has no corrections.", "Click a point on the object or beside it first.")
        for _ in range(len(points) if self.all else 1):
            points.remove(len(points) - 1)
        return f"{len(points)} corrections are left"


CLASSES = (SEEING_WIND_OT_correct_outline, SEEING_WIND_OT_clear_corrections)
