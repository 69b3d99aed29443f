"""The sidebar tab *Seeing Wind*, in the order of the work. `draw` only reads settings and `status`."""

import bpy

from .clip import panel as panel_clip
from .clip.panel import draw_guesses, draw_material, draw_more, draw_object
from .edit.panel import LISTS, draw_bake, draw_bodies, draw_body, draw_edits, draw_surroundings
from .job import status
from .job.status import State
from .panel_pieces import ICONS, draw_engine, draw_failure, draw_job, draw_override

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
        draw_object(column, settings)
        column.separator()
        column.prop(settings, "scale_mode")
        if settings.scale_mode == "PROXY" or settings.object_mode == "PROXY":
            column.prop(settings, "proxy")
        else:
            column.prop(settings, "pixels_per_metre" if settings.scale_mode == "PIXELS" else "distance")
        column.prop(settings, "material")
        draw_material(column, settings)
        for name in ("density", "youngs_modulus", "thickness"):
            draw_override(column, settings, name)
        column.prop(settings, "pin")
        draw_guesses(self.layout, context, settings, self.bl_space_type)
        draw_more(self.layout, settings)
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
        undone = [text for name, text in (("clip", "choose a clip"), ("object", "mark the object")) if now.steps[name].state != State.DONE]
        missing = f"First {' and '.join(undone)}" if undone else ""
        draw_job(self.layout, context, "recover", "seeing_wind.recover", "Recover", "FORCE_WIND", missing)
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
        draw_edits(self.layout, settings, self.bl_space_type)
        draw_bodies(self.layout, settings, self.bl_space_type)
        column, settings = self.columns()
        if settings.active_body < len(settings.bodies):
            draw_body(column, settings.bodies[settings.active_body], settings)
        column.separator()
        draw_surroundings(column, settings, self.bl_space_type)


class ResimulateTab(Tab):
    """Simulate the edit."""

    bl_label = "Re-simulate"
    step = "resimulate"

    def draw(self, context):
        """Go."""
        settings = context.scene.seeing_wind
        missing = "First recover a field" if not settings.recovered_take else "First insert a mesh" if not len(settings.bodies) else ""
        draw_job(self.layout, context, "resimulate", "seeing_wind.resimulate", "Re-simulate", "PHYSICS", missing)


class BakeTab(Tab):
    """Motion to keyframes."""

    bl_label = "Bake"
    step = "bake"

    def draw(self, context):
        """How, which frames, go."""
        column, settings = self.columns()
        draw_bake(column, settings)
        missing = "" if settings.simulated_take else "First re-simulate"
        draw_job(self.layout, context, "bake", "seeing_wind.bake", "Bake to Keyframes", "KEYFRAME", missing)
        self.layout.operator("seeing_wind.clear_bake", icon="X")


class SEEING_WIND_OT_open_preferences(bpy.types.Operator):
    """Open the preferences of this extension"""

    bl_idname = "seeing_wind.open_preferences"
    bl_label = "Open Preferences"

    def execute(self, context):
        """Blender's own way there."""
        from .install.preferences import EXTENSION

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

CLASSES = (*panel_clip.LISTS, *LISTS, SEEING_WIND_OT_open_preferences, *PANELS)
