"""The panel *Recover*."""

from ..job import status
from ..job.panel_pieces import Tab, columns, draw_job, draw_text, panels
from ..job.status import State
from .shown import said_of_view


class RecoverTab(Tab):
    """The job itself."""

    bl_label = "Recover"
    step = "recover"

    def fill(self, context, layout):
        """Draw gravity, the take's folder, the Recover button and the results."""
        column, settings = columns(layout), context.scene.seeing_wind
        column.prop(settings, "gravity_mode")
        if settings.gravity_mode == "CUSTOM":
            column.prop(settings, "gravity")
        column.prop(settings, "field")
        column.prop(settings, "take")
        now = status.of(context.scene.session_uid)
        undone = [text for name, text in (("clip", "choose a clip"), ("object", "mark the object")) if now.steps[name].state != State.DONE]
        missing = f"First {' and '.join(undone)}" if undone else ""
        draw_job(
            layout, context, "recover", "seeing_wind.recover", "Recover", "FORCE_WIND", missing,
            above=lambda layout: _draw_first(layout, context),
        )  # fmt: skip
        if settings.field_verdict and now.running != "recover":
            draw_text(layout, context, settings.field_verdict, "FORCE_WIND")
        if settings.recovered_take and now.running != "recover":
            row = layout.row(align=True)
            row.operator("seeing_wind.build_scene", text="Reload", icon="FILE_REFRESH")
            row.operator_menu_enum("seeing_wind.open_report", "which", text="Open", icon="FILE_FOLDER")


def _draw_first(layout, context) -> None:
    """Draw the most important notes on a result: in red, what to do about a force that only balances gravity; and why the field is not
    visible."""
    if context.scene.seeing_wind.answers_gravity:
        _offer_to_hold(layout)
    for text in said_of_view(context.scene):
        draw_text(layout, context, text, "INFO")


def _offer_to_hold(layout) -> None:
    """Draw the two remedies for a force that only balances gravity."""
    box = layout.box()
    box.alert = True
    box.label(text="This is only the answer to gravity", icon="ERROR")
    column = box.column(align=True)  # stacked, so that neither is cut off in a narrow sidebar
    column.operator("seeing_wind.preview", text="Mark What Is Held", icon="PINNED")
    away = column.operator("wm.context_set_enum", text="Gravity: None", icon="CANCEL")
    away.data_path, away.value = "scene.seeing_wind.gravity_mode", "NONE"


CLASSES = panels(RecoverTab, 2)
