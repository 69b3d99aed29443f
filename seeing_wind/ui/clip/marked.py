"""Draw the boxes that mark the object and its held place over the clip's first frame."""

from __future__ import annotations

import bpy

from .inputs.clips import first_clip_frame, scene_frame
from .on_frame import draw_rectangle

OBJECT, HELD = (1.0, 0.55, 0.1, 0.8), (1.0, 0.3, 0.25, 0.8)
"""Colours of the two boxes."""

SPACES = (bpy.types.SpaceView3D, bpy.types.SpaceClipEditor)
_handlers: list[tuple[type, object]] = []


def marks_of(scene: bpy.types.Scene) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Boxes [px of the clip] with their colours, to be drawn over the scene's present frame; none while the panel *Object* is folded."""
    settings, clip = scene.seeing_wind, scene.active_clip
    if clip is None or not settings.shows_object or scene.frame_current != scene_frame(clip, first_clip_frame(settings)):
        return []
    chosen = [(settings.box, OBJECT)] * (settings.object_mode == "BOX") + [(settings.held_box, HELD)] * (settings.held_mode == "BOX")
    return [(tuple(box), colour) for box, colour in chosen if box[2] > box[0] and box[3] > box[1]]


def _draw() -> None:
    context = bpy.context
    space, scene = context.space_data, context.scene
    marks = marks_of(scene)
    drawing = any(each.bl_idname == "SEEING_WIND_OT_draw_box" for each in context.window.modal_operators)
    if not marks or drawing or not _shows_clip(space, scene):
        return
    from .frame_on_screen import box_on_screen, frame_corners  # needs NumPy

    corners = frame_corners(context, context.region)
    for box, colour in marks if corners is not None else ():
        draw_rectangle(*box_on_screen(corners, box, *scene.active_clip.size), colour)


def _shows_clip(space: bpy.types.Space, scene: bpy.types.Scene) -> bool:
    """Whether a space shows the scene's clip, in a viewport as the camera's background."""
    if space.type == "CLIP_EDITOR":
        return space.clip == scene.active_clip and space.mode == "TRACKING"
    camera = scene.camera
    if camera is None or camera.type != "CAMERA" or not space.overlay.show_overlays or not camera.data.show_background_images:
        return False
    return any(each.show_background_image and each.clip == scene.active_clip for each in camera.data.background_images)


def register() -> None:
    """Start drawing in both editors."""
    unregister()
    _handlers.extend((space, space.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")) for space in SPACES)


def unregister() -> None:
    """Stop drawing."""
    for space, handler in _handlers:
        space.draw_handler_remove(handler, "WINDOW")
    _handlers.clear()

