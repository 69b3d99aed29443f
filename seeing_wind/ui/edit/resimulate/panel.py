"""The panel *Re-simulate*."""

from ...field.display import field_at_hand
from ...job import status
from ...job.panel_pieces import Tab, draw_beside, draw_job, draw_preview_mark, draw_progress, panels
from ...job.status import State


class ResimulateTab(Tab):
    """Simulate the edit."""

    bl_label = "Re-simulate"
    step = "resimulate"

    def fill(self, context, layout):
        """Draw the buttons Re-simulate and Preview, or the progress."""
        settings, now = context.scene.seeing_wind, status.of(context.scene.session_uid)
        if now.running == status.EDIT_PREVIEW:
            draw_progress(layout, context, now.steps[status.EDIT_PREVIEW], now.cancelling)
            return
        blown = settings.recovered_take or field_at_hand(context) is not None
        missing = "First recover a field, or add a wind" if not blown else "First insert a mesh" if not len(settings.bodies) else ""
        draw_job(
            layout, context, "resimulate", "seeing_wind.resimulate", "Re-simulate", "PHYSICS", missing,
            beside=lambda row: row.operator("seeing_wind.preview_edit", icon="HIDE_OFF"),
        )  # fmt: skip
        if now.running != "resimulate":
            draw_preview_mark(layout, context, self.step)
            if now.steps["resimulate"].state != State.DONE or now.steps[status.EDIT_PREVIEW].state == State.FAILED:
                draw_beside(layout, context, status.EDIT_PREVIEW)


CLASSES = panels(ResimulateTab, 4)
