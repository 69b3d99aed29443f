"""The panel *Recover*."""

from ..job import status
from ..job.panel_pieces import Tab, draw_job, draw_text, panels
from ..job.status import State


class RecoverTab(Tab):
    """The job itself."""

    bl_label = "Recover"
    step = "recover"

    def draw(self, context):
        """Gravity, where to, go."""
        column, settings = self.columns()
        column.prop(settings, "gravity_mode")
        if settings.gravity_mode == "CUSTOM":
            column.prop(settings, "gravity")
        column.prop(settings, "field")
        column.prop(settings, "take")
        now = status.of(context.scene.session_uid)
        undone = [text for name, text in (("clip", "choose a clip"), ("object", "mark the object")) if now.steps[name].state != State.DONE]
        missing = f"First {' and '.join(undone)}" if undone else ""
        draw_job(self.layout, context, "recover", "seeing_wind.recover", "Recover", "FORCE_WIND", missing)
        if settings.field_verdict and now.running != "recover":
            draw_text(self.layout, context, settings.field_verdict, "FORCE_WIND")
        if settings.recovered_take and now.running != "recover":
            row = self.layout.row(align=True)
            row.operator("seeing_wind.build_scene", text="Reload", icon="FILE_REFRESH")
            row.operator_menu_enum("seeing_wind.open_report", "which", text="Open", icon="FILE_FOLDER")


CLASSES = panels(RecoverTab, 2)
