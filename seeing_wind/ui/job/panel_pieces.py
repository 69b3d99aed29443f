"""Building blocks of the panels: the tab they stand in, states, messages with the button that mends an error, progress bars.

`draw` only reads settings and `status`.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable

import blf
import bpy

from ...engine.progress import in_words
from . import notes, status
from .status import State

CATEGORY = "Seeing Wind"
"""The sidebar tab."""

ICONS = {State.IDLE: "RADIOBUT_OFF", State.DONE: "CHECKMARK", State.STALE: "FILE_REFRESH", State.RUNNING: "SORTTIME", State.FAILED: "ERROR"}

SAYS = {State.STALE: "Settings have changed since: run it again"}

WARNINGS = 2
"""Number of a job's warnings that the panel shows unfolded."""

MARGIN, INDENT = 58, 20
"""Parts of a region's width that are not available to text: the panel's borders and tabs; and an icon. In pixels of an unscaled screen."""

MENDS = {
    "install_engine": ("seeing_wind.install_engine", "Install Engine", "IMPORT"),
    "fetch_python": ("seeing_wind.fetch_python", "Fetch Python and Install Engine", "IMPORT"),
    "allow_online": ("extensions.userpref_allow_online", "Allow Online Access", "URL"),
    "open_preferences": ("seeing_wind.open_preferences", "Open Preferences", "PREFERENCES"),
}
"""The control that mends an error, by `SeeingWindError.mend`."""


class Tab:
    """Mix-in for all panels of the sidebar tab."""

    bl_region_type = "UI"
    bl_category = CATEGORY
    step = ""
    """The step that the panel is for, or ""."""
    title = ""
    """Title of the step, with its number."""

    def draw(self, context):
        """Draw a step under its own foldable title, as scripts cannot fold a panel; it is folded once the work has gone past the step."""
        if not self.step:
            self.fill(context, self.layout)
            return
        header, body = self.layout.panel_prop(context.scene.seeing_wind, f"shows_{self.step}")
        header.label(text=self.title)
        step = status.of(context.scene.session_uid).steps[self.step]
        row = header.row()
        row.alert = step.state == State.FAILED
        row.active = step.state != State.IDLE
        row.label(text="", icon=ICONS[step.state])
        if body is not None:
            self.fill(context, body)

    def fill(self, context, layout):
        """Draw the contents of the panel."""
        raise NotImplementedError


def columns(layout):
    """A column in which properties have their names beside the values."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout.column()


def panels(tab: type[Tab], order: int) -> tuple[type, ...]:
    """Panel classes for the 3D viewport and the Movie Clip Editor, as Blender needs a separate class for each.

    Args:
        tab: the mix-in that draws both. A step's panel has its number in the title.
        order: position in the tab, from 0.
    """
    made = []
    for space in ("VIEW_3D", "CLIP_EDITOR"):
        name = f"SEEING_WIND_PT_{space.lower()}_{tab.step or tab.bl_label.lower().replace(' ', '_')}"
        body = {
            "bl_idname": name,
            "bl_space_type": space,
            "bl_order": order,
            "bl_options": {"HIDE_HEADER"} if tab.step else getattr(tab, "bl_options", set()),
            "title": f"{order + 1}. {tab.bl_label}",
            "__doc__": tab.__doc__,
        }
        made.append(type(name, (tab, bpy.types.Panel), body))
    return tuple(made)


def draw_text(layout, context, text: str, icon: str = "NONE") -> None:
    """Draw a text wrapped to the width of the region, as Blender's labels do not wrap."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(_lines(context, text, 0 if icon == "NONE" else INDENT)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")


def fold(layout, name: str, text: str, closed: bool = True):
    """Draw a foldable title for what few users need. Returns the layout below it, None while it is folded."""
    header, body = layout.panel(f"SEEING_WIND_{name}", default_closed=closed)
    header.label(text=text)
    return body


def _lines(context, text: str, indent: int) -> list[str]:
    """A text wrapped to the region's width as measured in Blender's font."""
    region, preferences = context.region, context.preferences
    if region is None:
        return textwrap.wrap(text, 60)
    scale, lines = preferences.system.ui_scale, [""]
    blf.size(0, preferences.ui_styles[0].widget.points * scale)
    room = max(region.width - (MARGIN + indent) * scale, 80 * scale)
    for word in text.split():
        longer = f"{lines[-1]} {word}".lstrip()
        if lines[-1] and blf.dimensions(0, longer)[0] > room:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def draw_failure(layout, context, step: status.Step, button: bool = True) -> None:
    """Draw what went wrong, what to do, and the button that does it."""
    box = layout.box()
    message = box.column()
    message.alert = True
    draw_text(message, context, step.message, "ERROR")
    if step.hint:
        draw_text(box, context, step.hint)
    if button and step.mend in MENDS:
        operator, text, icon = MENDS[step.mend]
        box.operator(operator, text=text, icon=icon)


def draw_progress(layout, context, step: status.Step, cancelling: bool) -> None:
    """Draw the bar of a running job, what it is doing, and the Cancel button."""
    column = layout.column(align=True)
    left = status.remaining(step)
    text = f"{100 * step.fraction:.0f} %" + (f", about {in_words(left)} left" if left is not None else "")
    column.progress(factor=step.fraction, text=text, type="BAR")
    lines = column.column(align=True)
    lines.active = False
    lines.scale_y = 0.8
    draw_text(lines, context, step.message[:1].upper() + step.message[1:])
    if step.expected is not None:
        lines.label(text=f"The solve takes about {in_words(step.expected)}")
    if step.residual:
        lines.label(text=f"Residual {step.residual}")
    row = column.row()
    row.enabled = not cancelling
    row.operator("seeing_wind.cancel", text="Stopping..." if cancelling else "Cancel", icon="CANCEL")


def draw_job(
    layout, context, name: str, operator: str, text: str, icon: str, missing: str = "", warned: bool = True,
    above: Callable[[bpy.types.UILayout], None] | None = None, beside: Callable[[bpy.types.UILayout], object] | None = None,
) -> None:  # fmt: skip
    """Draw the button of a step's job, or its bar while it runs; then its state, or what must be done before it.

    Args:
        missing: what must be done before the job can start; "" if nothing.
        warned: whether to draw its warnings here.
        above: draws what comes before all messages of the step.
        beside: draws another button in the same row.
    """
    now = status.of(context.scene.session_uid)
    step = now.steps[name]
    if now.running == name:
        draw_progress(layout, context, step, now.cancelling)
        return
    row = layout.row()
    row.scale_y = 1.4
    row.enabled = not missing and not now.running
    row.operator(operator, text=text, icon=icon)
    if beside is not None:
        beside(row)
    if above is not None:
        above(layout)
    if missing:
        draw_text(layout, context, missing, "INFO")
    if step.state == State.FAILED:
        draw_failure(layout, context, step)
    elif step.state == State.STALE:
        draw_text(layout, context, step.message or SAYS[State.STALE], "INFO")
    elif step.message:
        draw_text(layout, context, step.message)
    if warned:
        _draw_warnings(layout, context, name)


def draw_beside(layout, context, name: str) -> None:
    """Draw the messages of a second job of a step, whose button stands beside the first one's."""
    now = status.of(context.scene.session_uid)
    step = now.steps[name]
    if step.state == State.FAILED:
        draw_failure(layout, context, step)
    elif step.message:
        draw_text(layout, context, step.message)
    _draw_warnings(layout, context, name)


def draw_preview_mark(layout, context, step: str) -> None:
    """If objects show a preview of the edit, draw a message saying so at the step that gives the full result."""
    now = status.of(context.scene.session_uid)
    full, button = ("bake", "Bake to Keyframes") if now.steps["resimulate"].state == State.DONE else ("resimulate", "Re-simulate")
    if now.previewed and step == full:
        text = f"Preview: coarser, and only up to the last frame shown. {button} for the full result of {', '.join(now.previewed)}"
        draw_text(layout, context, text, "HIDE_OFF")


def _draw_warnings(layout, context, name: str) -> None:
    now = status.of(context.scene.session_uid)
    warnings = now.warnings if now.warned == name else []
    if not warnings and now.steps[name].state != State.FAILED:
        warnings = notes.kept(context.scene.seeing_wind, name)
    for warning in warnings[:WARNINGS]:
        draw_text(layout, context, warning, "INFO")
    more = warnings[WARNINGS:]
    body = fold(layout, "notes", f"{len(more)} more {'notes' if len(more) > 1 else 'note'}") if more else None
    for warning in more if body is not None else []:
        draw_text(body, context, warning, "INFO")


def draw_engine(layout, context, button: bool = True) -> None:
    """Draw whether there is an engine, and the button that installs one."""
    now = status.of(context.scene.session_uid)
    job = now.steps.get("engine")
    if now.running == "engine" and job is not None:
        layout.label(text=now.title, icon="SORTTIME")
        draw_progress(layout, context, job, now.cancelling)
        return
    problem, failed = status.engine.problem, job is not None and job.state == State.FAILED
    if failed:
        draw_failure(layout, context, job)
    elif job is not None and job.message:
        draw_text(layout, context, job.message)
    # after a failed installation, the message that there is no engine would be redundant
    if problem is not None and not (failed and problem.mend == "install_engine"):
        draw_failure(layout, context, problem, button)


def draw_range(column, settings, tick: str, numbers: str) -> None:
    """Draw a range of frames: the box `tick`, and if it is ticked, the first and the last frame, a property `numbers` of two."""
    row = column.row(heading="Frames")
    row.prop(settings, tick, text="")
    sub = row.row(align=True)
    if getattr(settings, tick):
        sub.prop(settings, numbers, index=0, text="")
        sub.prop(settings, numbers, index=1, text="")
    else:
        sub.label(text="All")


def draw_list(layout, settings, space: str, items: str, active: str, *buttons: tuple[str, str]) -> None:
    """Draw the list `items` of the settings in an editor of type `space`, with a column of buttons (operator, icon) beside it."""
    row = layout.row()
    row.template_list(f"SEEING_WIND_UL_{items}", space, settings, items, settings, active, rows=2)
    column = row.column(align=True)
    for operator, icon in buttons:
        column.operator(operator, text="", icon=icon)


def draw_override(column, settings, name: str, otherwise: str = "", text: str = "") -> None:
    """Draw a property, with its tick in the same row if it has one.

    Args:
        otherwise: the value that is used without the tick, if known.
        text: a shorter name, if the property's own would be cut off.
    """
    if f"use_{name}" not in settings.bl_rna.properties:
        column.prop(settings, name)
        return
    row = column.row(heading=text or settings.bl_rna.properties[name].name)
    row.prop(settings, f"use_{name}", text="")
    sub = row.row()
    ticked = getattr(settings, f"use_{name}")
    sub.enabled = ticked
    if ticked or not otherwise:
        sub.prop(settings, name, text="")
    else:
        sub.label(text=otherwise)
