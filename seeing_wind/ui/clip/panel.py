"""The panel *Clip*."""

from ..job import status
from ..job.panel_pieces import Tab, draw_engine, draw_failure, panels
from ..job.status import State


class ClipTab(Tab):
    """Which clip, which part of it, through which camera."""

    bl_label = "Clip"
    step = "clip"

    def draw(self, context):
        """The engine's state comes first: without one nothing works."""
        if status.engine.problem is not None or "engine" in status.of(context.scene.session_uid).steps:
            draw_engine(self.layout, context)
        row = self.layout.row(align=True)
        row.operator("seeing_wind.choose_clip", text="Choose Clip", icon="FILE_MOVIE")
        row.operator("seeing_wind.choose_clip", text="Active Clip", icon="TRACKER").active = True
        column, settings = self.columns()
        column.prop(settings, "clip")
        column.prop(settings, "fps")
        row = column.row(heading="Pictures")
        row.prop(settings, "use_frames", text="")
        sub = row.row(align=True)
        sub.enabled = settings.use_frames
        sub.prop(settings, "frames", index=0, text="")
        sub.prop(settings, "frames", index=1, text="")
        column.prop(settings, "camera_mode")
        if settings.camera_mode in ("AUTO", "FOV", "JSON"):
            column.prop(settings, "camera" if settings.camera_mode == "JSON" else "fov")
        column.prop(settings, "frame_start")
        column.operator("seeing_wind.match_scene", icon="SCENE_DATA")
        step = status.of(context.scene.session_uid).steps["clip"]
        if step.state == State.FAILED:
            draw_failure(self.layout, context, step)


CLASSES = panels(ClipTab, 0)
