"""The sidebar tab *Seeing Wind*, in the order of the work. `draw` only reads settings and `status`."""

import bpy

from . import status
from .panel_pieces import ICONS, draw_engine, draw_failure, draw_job
from .status import State

CATEGORY = "Seeing Wind"


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
        sub.prop(settings, "frames", index=0, text="")
        sub.prop(settings, "frames", index=1, text="")
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
    column.prop(body, "use_velocity")
    if body.use_velocity:
        column.prop(body, "velocity")
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
    body = {
        "bl_idname": name,
        "bl_space_type": space,
        "bl_order": order,
        "bl_label": f"{order + 1}. {tab.bl_label}",
        "__doc__": tab.__doc__,
    }
    return type(name, (tab, bpy.types.Panel), body)


PANELS = tuple(_panel(space, tab, order) for space in ("VIEW_3D", "CLIP_EDITOR") for order, tab in enumerate(TABS))

CLASSES = (SEEING_WIND_UL_bodies, SEEING_WIND_OT_open_preferences, *PANELS)
