"""The panel *Clip*."""

import os

import bpy

from ..job import status
from ..job.panel_pieces import Tab, columns, draw_engine, draw_failure, draw_list, draw_range, fold, panels
from ..job.status import State


class ClipTab(Tab):
    """Which clip, which part of it, through which camera."""

    bl_label = "Clip"
    step = "clip"

    def fill(self, context, layout):
        """Draw the engine's state first, since nothing works without an engine; then the clip's settings."""
        if status.engine.problem is not None or "engine" in status.of(context.scene.session_uid).steps:
            draw_engine(layout, context)
        row = layout.row(align=True)
        row.operator("seeing_wind.choose_clip", text="Choose Clip", icon="FILE_MOVIE")
        row.operator("seeing_wind.choose_clip", text="Use Active", icon="TRACKER").active = True
        column, settings = columns(layout), context.scene.seeing_wind
        column.prop(settings, "clip")
        column.prop(settings, "camera_mode")
        if settings.camera_mode == "JSON":
            column.prop(settings, "camera")
        elif settings.camera_mode in ("AUTO", "FOV"):
            row = column.row(align=True)
            row.prop(settings, "focal_length", text="Lens (mm, °)")
            row.prop(settings, "fov", text="")
        _draw_time(layout, settings)
        _draw_views(layout, settings, self.bl_space_type)
        step = status.of(context.scene.session_uid).steps["clip"]
        if step.state == State.FAILED:
            draw_failure(layout, context, step)


def _draw_time(layout, settings) -> None:
    """Draw the clip's range, rate, and first scene frame."""
    first, last = settings.frames
    title = f"Frames {first} to {last}" if settings.use_frames else "Frames and Time"
    column = fold(layout, "time", title)
    if column is None:
        return
    column.prop(settings, "fps", text="FPS (1/s)" if settings.fps else "FPS (0: file's)")
    draw_range(column, settings, "use_frames", "frames")
    if settings.use_frames:
        column.label(text=f"Scene frames {settings.frame_start} to {settings.frame_start + last - first}")
    column.prop(settings, "frame_start")
    column.operator("seeing_wind.match_scene", icon="SCENE_DATA")


def _draw_views(layout, settings, space: str) -> None:
    """Draw the list of further views."""
    body = fold(layout, "views", "Further Views", closed=not len(settings.views))
    if body is None:
        return
    draw_list(body, settings, space, "views", "active_view", ("seeing_wind.add_view", "ADD"), ("seeing_wind.remove_view", "REMOVE"))
    if settings.active_view < len(settings.views):
        column = body.column()
        for name in ("clip", "camera", "mask"):
            column.prop(settings.views[settings.active_view], name)


class SEEING_WIND_UL_views(bpy.types.UIList):
    """Further views of the object."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        """Draw the file name of the view's clip."""
        layout.label(text=os.path.basename(item.clip) or "No clip", icon="CAMERA_DATA")


CLASSES = (SEEING_WIND_UL_views, *panels(ClipTab, 0))
