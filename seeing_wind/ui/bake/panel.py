"""The panel *Bake*."""

from ..job.panel_pieces import Tab, columns, draw_job, draw_preview_mark, draw_range, fold, panels
from .plan import MARK, left_in


class BakeTab(Tab):
    """Motion to keyframes."""

    bl_label = "Bake"
    step = "bake"

    def fill(self, context, layout):
        """Draw the way, the frames, and the buttons."""
        column, settings = columns(layout), context.scene.seeing_wind
        column.prop(settings, "bake_way")
        first, last = settings.bake_frames
        body = fold(column, "bake", f"Frames {first} to {last}" if settings.bake_use_frames else "Frames and Precision")
        if body is not None:
            _draw_how(body, settings)
        missing = "" if settings.simulated_take or settings.coarse_take else "First re-simulate"
        draw_job(layout, context, "bake", "seeing_wind.bake", "Bake to Keyframes", "KEYFRAME", missing)
        draw_preview_mark(layout, context, self.step)
        if any(MARK in (body.baked_copy or body.object or ()) for body in settings.bodies) or left_in(context.scene):
            layout.operator("seeing_wind.clear_bake", icon="X")


def _draw_how(column, settings) -> None:
    """Draw the tolerance of rigid bodies, the smoothing, and the range of frames."""
    if settings.bake_way in ("AUTO", "TRANSFORM"):
        column.prop(settings, "bake_tolerance")
    if settings.bake_way != "TRANSFORM":
        column.prop(settings, "bake_smooth")
    draw_range(column, settings, "bake_use_frames", "bake_frames")


CLASSES = panels(BakeTab, 5)
