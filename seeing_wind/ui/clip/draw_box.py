"""Draw Box: mark the object in the clip's first frame with the mouse."""

import bpy
from bpy.props import EnumProperty, FloatVectorProperty

from ..job import status
from .inputs.clips import first_clip_frame, loaded_clip, scene_frame
from .on_frame import LOOKING, OnFrame, draw_rectangle

SMALLEST = 3.0
"""Least size of a box in pixels of the clip: a smaller one is an accidental click."""


class SEEING_WIND_OT_draw_box(OnFrame, bpy.types.Operator):
    """Draw a box round the object, or its held part, in the clip's first frame: drag with the left mouse button, Esc cancels"""

    bl_idname = "seeing_wind.draw_box"
    bl_label = "Draw Box"
    bl_options = {"REGISTER", "UNDO"}

    box: FloatVectorProperty(
        name="Box (px)", size=4, options={"SKIP_SAVE"}, description="Left, top, right, bottom in pixels of the first frame"
    )

    marks: EnumProperty(
        name="Marks", options={"SKIP_SAVE"}, description="What the box is drawn round",
        items=[("OBJECT", "Object", "The object that is followed"), ("HELD", "Held Part", "Where the object is held")],
    )  # fmt: skip

    def execute(self, context):
        """Store the box, as drawn or as given, in the settings."""
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
        """Show the first frame, then wait for the mouse."""
        self.start = self.stop = None
        if not self.begin(context, "Drag a box round the object", "CROSSHAIR"):
            return {"CANCELLED"}
        settings = context.scene.seeing_wind
        context.scene.frame_set(scene_frame(loaded_clip(settings), first_clip_frame(settings)))
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Press, drag, release; before that, the view can be moved and zoomed."""
        ended = self.given_up(context, event)
        if ended is not None:
            return ended
        if event.type == "MOUSEMOVE" and self.start is not None:
            self.stop = self.at(event)
            self.region.tag_redraw()
            return {"RUNNING_MODAL"}
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            self.start = self.stop = self.at(event)
            return {"RUNNING_MODAL"}
        if event.type == "LEFTMOUSE" and event.value == "RELEASE" and self.start is not None:
            corners = self.corners(context)
            self.end(context)
            if corners is None:
                return {"CANCELLED"}
            from .frame_on_screen import box_in_frame  # needs NumPy

            self.box = box_in_frame(corners, self.start, self.at(event), *self.size)
            return self.execute(context)
        # block undo and everything else that would change the scene under the box
        looks = event.type.startswith(LOOKING) and self.start is None
        return {"PASS_THROUGH"} if looks or event.type.startswith("TIMER") else {"RUNNING_MODAL"}

    def draw_over(self, context, corners) -> None:
        """Draw the box being dragged or, before that, the former one."""
        if self.start is not None:
            low, high = (tuple(map(pick, self.start, self.stop)) for pick in (min, max))
            draw_rectangle(low, high, (1.0, 0.55, 0.1, 1.0))
            return
        from .frame_on_screen import box_on_screen  # needs NumPy

        settings = context.scene.seeing_wind
        box = settings.held_box if self.marks == "HELD" else settings.box
        draw_rectangle(*corners, (1.0, 1.0, 1.0, 0.35))
        if box[2] > box[0]:
            draw_rectangle(*box_on_screen(corners, tuple(box), *self.size), (1.0, 0.55, 0.1, 0.6))


CLASSES = (SEEING_WIND_OT_draw_box,)
