"""The sidebar tab *Seeing Wind*, in the order of the work. `draw` only reads settings and `status`."""

import textwrap

import bpy

from . import status
from .status import State

CATEGORY = "Seeing Wind"

ICONS = {State.IDLE: "RADIOBUT_OFF", State.DONE: "CHECKMARK", State.STALE: "FILE_REFRESH", State.RUNNING: "SORTTIME", State.FAILED: "ERROR"}

SAYS = {State.STALE: "Settings have changed since: run it again"}

MENDS = {
    "install_engine": ("seeing_wind.install_engine", "Install Engine", "IMPORT"),
    "allow_online": ("extensions.userpref_allow_online", "Allow Online Access", "URL"),
    "open_preferences": ("seeing_wind.open_preferences", "Open Preferences", "PREFERENCES"),
}
"""The control that mends an error, by `SeeingWindError.mend`."""


# -- pieces -----------------------------------------------------------------------------------------------------------------------


def draw_text(layout, context, text: str, icon: str = "NONE") -> None:
    """A text in as many lines as the region is wide; Blender's labels do not wrap."""
    region, scale = context.region, context.preferences.system.ui_scale
    characters = max(16, int((region.width / scale - 75) / 6.4)) if region is not None else 60
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(textwrap.wrap(text, characters)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")


def draw_failure(layout, context, step: status.Step) -> None:
    """What went wrong, what to do, and the button that does it."""
    box = layout.box()
    message = box.column()
    message.alert = True
    draw_text(message, context, step.message, "ERROR")
    if step.hint:
        draw_text(box, context, step.hint)
    if step.mend in MENDS:
        operator, text, icon = MENDS[step.mend]
        box.operator(operator, text=text, icon=icon)


def draw_progress(layout, step: status.Step, cancelling: bool) -> None:
    """The bar of a running job, what it does, and the way to stop it."""
    column = layout.column(align=True)
    column.progress(factor=step.fraction, text=f"{100 * step.fraction:.0f} %", type="BAR")
    row = column.row()
    row.active = False
    row.label(text=step.message[:60])
    row = column.row()
    row.enabled = not cancelling
    row.operator("seeing_wind.cancel", text="Stopping..." if cancelling else "Cancel", icon="CANCEL")


def draw_job(layout, context, name: str, operator: str, text: str, icon: str, ready: bool = True) -> None:
    """The button of a step's job, or its bar while it runs; then how it stands."""
    now = status.of(context.scene.session_uid)
    step = now.steps[name]
    if now.running == name:
        draw_progress(layout, step, now.cancelling)
        return
    row = layout.row()
    row.scale_y = 1.4
    row.enabled = ready and not now.running
    row.operator(operator, text=text, icon=icon)
    if step.state == State.FAILED:
        draw_failure(layout, context, step)
    elif step.state == State.STALE:
        draw_text(layout, context, SAYS[State.STALE], "INFO")
    elif step.message:
        draw_text(layout, context, step.message)


def draw_engine(layout, context) -> None:
    """Whether there is an engine, and the button that makes one."""
    now = status.of(context.scene.session_uid)
    job = now.steps.get("engine")
    if now.running == "engine" and job is not None:
        layout.label(text=now.title, icon="SORTTIME")
        draw_progress(layout, job, now.cancelling)
        return
    if job is not None and job.state == State.FAILED:
        draw_failure(layout, context, job)
    elif job is not None and job.message:
        draw_text(layout, context, job.message)
    if status.engine.problem is not None:
        draw_failure(layout, context, status.engine.problem)


# -- panels -----------------------------------------------------------------------------------------------------------------------


class Tab:
    """Mix-in of all panels of the tab."""

    bl_region_type = "UI"
    bl_category = CATEGORY
    step = ""

    def draw_header_preset(self, context):
        """How the step stands, at the right end of its title."""
        if self.step:
            step = status.of(context.scene.session_uid).steps[self.step]
            row = self.layout.row()
            row.alert = step.state == State.FAILED
            row.active = step.state != State.IDLE
            row.label(text="", icon=ICONS[step.state])
            row.separator()

    def columns(self):
        """A layout with names beside their values."""
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        return self.layout.column(), bpy.context.scene.seeing_wind


class ClipTab(Tab):
    """Which clip, which part of it, through which camera."""

    bl_label = "Clip"
    step = "clip"

    def draw(self, context):
        """The engine's state comes first: without one nothing works."""
        if status.engine.problem is not None or "engine" in status.of(context.scene.session_uid).steps:
            draw_engine(self.layout, context)
        column, settings = self.columns()
        column.prop(settings, "clip")
        column.prop(settings, "fps")
        row = column.row(heading="Pictures")
        row.prop(settings, "use_frames", text="")
        sub = row.row(align=True)
        sub.enabled = settings.use_frames
        sub.prop(settings, "frames", text="")
        column.prop(settings, "camera_mode")
        column.prop(settings, "camera" if settings.camera_mode == "JSON" else "fov")
        step = status.of(context.scene.session_uid).steps["clip"]
        if step.state == State.FAILED:
            draw_failure(self.layout, context, step)


class ObjectTab(Tab):
    """Which object, at what scale, made of what."""

    bl_label = "Object"
    step = "object"

    def draw(self, context):
        """Box or mask, distance or scale, material."""
        column, settings = self.columns()
        row = column.row()
        row.prop(settings, "object_mode", expand=True)
        if settings.object_mode == "MASK":
            column.prop(settings, "mask")
        else:
            sub = column.column(align=True)
            for index, text in enumerate(("Box Left (px)", "Top", "Right", "Bottom")):
                sub.prop(settings, "box", index=index, text=text)
        column.separator()
        column.prop(settings, "scale_mode")
        column.prop(settings, "pixels_per_metre" if settings.scale_mode == "PIXELS" else "distance")
        column.prop(settings, "material")
        for name in ("density", "youngs_modulus", "thickness"):
            draw_override(column, settings, name)
        column.prop(settings, "pin")
        step = status.of(context.scene.session_uid).steps["object"]
        if step.state == State.FAILED:
            draw_failure(self.layout, context, step)


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
        column.prop(settings, "take")
        now = status.of(context.scene.session_uid)
        ready = now.steps["clip"].state == State.DONE and now.steps["object"].state == State.DONE
        draw_job(self.layout, context, "recover", "seeing_wind.recover", "Recover", "FORCE_WIND", ready)
        if settings.recovered_take and now.running != "recover":
            row = self.layout.row(align=True)
            row.operator("seeing_wind.build_scene", text="Reload", icon="FILE_REFRESH")
            row.operator_menu_enum("seeing_wind.open_report", "which", text="Open", icon="FILE_FOLDER")
        for warning in now.warnings[:4]:
            draw_text(self.layout, context, warning, "INFO")


class EditTab(Tab):
    """What else shall move in the wind."""

    bl_label = "Edit"
    step = "edit"

    def draw(self, context):
        """The list of bodies and the active one's settings."""
        settings = context.scene.seeing_wind
        row = self.layout.row()
        row.template_list("SEEING_WIND_UL_bodies", self.bl_space_type, settings, "bodies", settings, "active_body", rows=3)
        buttons = row.column(align=True)
        buttons.operator("seeing_wind.insert_mesh", text="", icon="ADD")
        buttons.operator("seeing_wind.remove_body", text="", icon="REMOVE")
        sub = self.layout.row()
        sub.enabled = settings.recovered_object is not None
        sub.operator("seeing_wind.insert_mesh", text="Insert Recovered Object", icon="OUTLINER_OB_MESH").recovered = True
        column, settings = self.columns()
        if settings.active_body < len(settings.bodies):
            draw_body(column, settings.bodies[settings.active_body], settings)
        column.separator()
        column.prop(settings, "field_strength")
        column.prop(settings, "edit_gravity_mode")
        if settings.edit_gravity_mode == "CUSTOM":
            column.prop(settings, "edit_gravity")
        column.prop(settings, "contact")


class ResimulateTab(Tab):
    """Simulate the edit."""

    bl_label = "Re-simulate"
    step = "resimulate"

    def draw(self, context):
        """Go."""
        settings = context.scene.seeing_wind
        ready = bool(settings.recovered_take) and bool(len(settings.bodies))
        draw_job(self.layout, context, "resimulate", "seeing_wind.resimulate", "Re-simulate", "PHYSICS", ready)


class BakeTab(Tab):
    """Motion to keyframes."""

    bl_label = "Bake"
    step = "bake"

    def draw(self, context):
        """Go."""
        ready = bool(context.scene.seeing_wind.simulated_take)
        draw_job(self.layout, context, "bake", "seeing_wind.bake", "Bake to Keyframes", "KEYFRAME", ready)


def draw_override(column, settings, name: str) -> None:
    """A tick and a number that replaces the preset's."""
    row = column.row(heading=settings.bl_rna.properties[name].name)
    row.prop(settings, f"use_{name}", text="")
    sub = row.row()
    sub.enabled = getattr(settings, f"use_{name}")
    sub.prop(settings, name, text="")


def draw_body(column, body, settings) -> None:
    """The settings of one body."""
    if not body.is_recovered:
        column.prop(body, "object")
        column.prop(body, "material")
    obj = settings.recovered_object if body.is_recovered else body.object
    column.prop(body, "mass_scale")
    if obj is not None:
        column.prop_search(body, "pin_group", obj, "vertex_groups", text="Pinned")
    for name in ("density", "youngs_modulus"):
        draw_override(column, body, name)
    row = column.row(heading="Velocity (m/s)")
    row.prop(body, "use_velocity", text="")
    sub = row.row()
    sub.enabled = body.use_velocity
    sub.prop(body, "velocity", text="")
    column.prop(body, "start_frame")


class SEEING_WIND_UL_bodies(bpy.types.UIList):
    """The bodies of the edit."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        """Name, mass and pins at a glance; an object that is gone says so."""
        gone = not item.is_recovered and item.object is None
        row = layout.row()
        row.alert = gone
        name = item.name if item.object is None else item.object.name
        row.label(text=f"{name} (gone)" if gone else name, icon="ERROR" if gone else "MESH_DATA")
        if item.pin_group:
            row.label(text="", icon="PINNED")
        if item.mass_scale != 1.0:
            row.label(text=f"x {item.mass_scale:g}")


class SEEING_WIND_OT_open_preferences(bpy.types.Operator):
    """Open the preferences of this extension"""

    bl_idname = "seeing_wind.open_preferences"
    bl_label = "Open Preferences"

    def execute(self, context):
        """Blender's own way there."""
        from .preferences import EXTENSION

        return bpy.ops.preferences.addon_show(module=EXTENSION)


TABS = (ClipTab, ObjectTab, RecoverTab, EditTab, ResimulateTab, BakeTab)


def _panel(space: str, tab: type, order: int) -> type:
    """One panel class per space: Blender wants a class of its own for each."""
    name = f"SEEING_WIND_PT_{space.lower()}_{tab.step}"
    body = {"bl_idname": name, "bl_space_type": space, "bl_order": order, "bl_label": f"{order + 1}. {tab.bl_label}", "__doc__": tab.__doc__}
    return type(name, (tab, bpy.types.Panel), body)


PANELS = tuple(_panel(space, tab, order) for space in ("VIEW_3D", "CLIP_EDITOR") for order, tab in enumerate(TABS))

CLASSES = (SEEING_WIND_UL_bodies, SEEING_WIND_OT_open_preferences, *PANELS)
