"""The panel *Edit*: edits, bodies, and their surroundings."""

import bpy

from ...engine.conventions import in_units
from ...engine.materials import MATERIALS, SHEETS
from ...engine.settings import BodyEdit, options_of
from ..clip.object.material_menu import draw_material
from ..field.display import has_wind, is_field
from ..job.panel_pieces import Tab, columns, draw_list, draw_override, draw_text, fold, panels
from ..option_properties import panel_options
from .sheet_label import is_shell, sheet_words

SHORT = {"areal_density": "Weight", "tensile_stiffness": "Stretching", "bending_stiffness": "Bending"}
"""Short labels for numbers whose full names do not fit into a sidebar. The unit is appended, unless it is shown with the number."""
BODY = options_of(BodyEdit)


class EditTab(Tab):
    """What else shall move in the wind."""

    bl_label = "Edit"
    step = "edit"

    def fill(self, context, layout):
        """The list of bodies and the active one's settings."""
        settings = context.scene.seeing_wind
        _draw_edits(layout, settings, self.bl_space_type)
        _draw_bodies(layout, settings, self.bl_space_type)
        column, settings = columns(layout), context.scene.seeing_wind
        if settings.active_body < len(settings.bodies):
            _draw_body(column, settings.bodies[settings.active_body], settings)
        row = column.row()
        row.use_property_decorate = True  # keyframes of the strength take effect
        row.prop(settings, "field_strength")
        if has_wind(settings.field_object):
            column.prop(settings, "edit_field")
        count = len(settings.colliders)
        body = fold(column, "around", f"Gravity, Floor, Colliders ({count})" if count else "Gravity, Floor, Colliders")
        if body is not None:
            _draw_surroundings(body, settings, self.bl_space_type)


def _draw_edits(layout, settings, space: str) -> None:
    """Draw the list of edits if there are several, else the button that makes a second one."""
    if not len(settings.edits):
        if len(settings.bodies):
            layout.operator("seeing_wind.duplicate_edit", text="Duplicate Edit to Compare", icon="DUPLICATE")
        return
    buttons = ("seeing_wind.duplicate_edit", "DUPLICATE"), ("seeing_wind.remove_edit", "REMOVE")
    draw_list(layout, settings, space, "edits", "active_edit", *buttons)


def _draw_bodies(layout, settings, space: str) -> None:
    """Draw the list of bodies and the buttons that add one."""
    buttons = ("seeing_wind.insert_mesh", "ADD"), ("seeing_wind.remove_body", "REMOVE")
    draw_list(layout, settings, space, "bodies", "active_body", *buttons)
    sub = layout.row()
    sub.enabled = settings.recovered_object is not None
    sub.operator("seeing_wind.insert_mesh", text="Insert Recovered Object", icon="OUTLINER_OB_MESH").recovered = True


def _draw_body(column, body, settings) -> None:
    """Draw the settings of one body."""
    if not body.is_recovered:
        column.prop(body, "object")
        draw_material(column, body)
        words = body.no_sheet or sheet_words(body)
        if words:
            draw_text(column, bpy.context, words, "ERROR" if body.no_sheet else "MOD_CLOTH" if is_shell(body) else "INFO")
    obj = settings.recovered_object if body.is_recovered else body.object
    column.prop(body, "mass_scale")
    column.prop(body, "stiffness_scale")
    if obj is not None:
        column.prop_search(body, "pin_group", obj, "vertex_groups", text="Pinned")
    if body.is_recovered:
        column.prop(body, "free_mode", text="Held Places")
        if body.free_mode == "GROUP" and obj is not None:
            column.prop_search(body, "free_group", obj, "vertex_groups", text="Group")
    more = fold(column, "body", "Material Values and Start")
    if more is not None:
        _draw_numbers(more, body)


def _draw_numbers(column, body) -> None:
    """Draw the values that override the material's, and the initial state of the body."""
    for name in _numbers(body):
        short = SHORT.get(name, "")
        if short and getattr(body, f"use_{name}"):
            short = f"{short} ({BODY[name].unit})"
        draw_override(column, body, name, _preset(body, name), short)
    column.prop(body, "use_velocity")
    if body.use_velocity:
        column.prop(body, "velocity")
    column.prop(body, "start_frame")
    for one in panel_options(BodyEdit, part="more"):
        draw_override(column, body, one.identifier)


def _preset(body, name: str) -> str:
    """The value that holds where an override is not ticked, as text."""
    if body.is_recovered:
        return "As recovered"
    if name == "mass":
        return "By its size"
    sheet = SHEETS.get(body.material)
    stuff = sheet if sheet is not None and hasattr(sheet, name) else MATERIALS[body.material]
    return in_units(getattr(stuff, name), BODY[name].unit)


def _numbers(body) -> list[str]:
    """Names of the material overrides that apply to a body; for a shell, also those of a solid that were ticked."""
    if not is_shell(body):
        return ["mass", "youngs_modulus"] if body.use_mass else ["density", "mass", "youngs_modulus"]
    sheet = ["areal_density", "thickness", "tensile_stiffness", "bending_stiffness"]
    return [*sheet, "mass", *(name for name in ("density", "youngs_modulus") if getattr(body, f"use_{name}"))]


def _draw_surroundings(column, settings, space: str) -> None:
    """Draw gravity, other forces, obstacles, and where the edit is shown."""
    column.prop(settings, "edit_gravity_mode")
    if settings.edit_gravity_mode == "CUSTOM":
        column.prop(settings, "edit_gravity")
    row = column.row(heading="Force Fields")
    row.prop(settings, "use_force_fields", text="")
    sub = row.row()
    sub.enabled = settings.use_force_fields
    sub.prop(settings, "effectors", text="")
    if settings.use_further_fields or sum(is_field(obj) for obj in settings.id_data.objects) > 1:
        column.prop(settings, "use_further_fields")
    column.prop(settings, "edit_preroll")
    column.prop(settings, "contact")
    row = column.row(heading="Floor (m)")
    row.prop(settings, "use_floor", text="")
    sub = row.row()
    sub.enabled = settings.use_floor
    sub.prop(settings, "floor_height", text="")
    if settings.use_floor:
        column.prop(settings, "floor_friction")
    if len(settings.colliders):
        buttons = ("seeing_wind.insert_collider", "ADD"), ("seeing_wind.remove_collider", "REMOVE")
        draw_list(column, settings, space, "colliders", "active_collider", *buttons)
        if settings.active_collider < len(settings.colliders):
            collider = settings.colliders[settings.active_collider]
            column.prop(collider, "kind")
            column.prop(collider, "friction")
    else:
        column.operator("seeing_wind.insert_collider", text="Collide with Selected", icon="MOD_PHYSICS")
    if len(settings.edits):
        column.prop(settings, "offset")


def is_gone(obj, scene) -> bool:
    """Whether the user has deleted an object. An object that a list still refers to lives on outside all scenes."""
    # by identity: a linked object and a local one may have the same name
    return obj is None or scene not in obj.users_scene


class SEEING_WIND_UL_bodies(bpy.types.UIList):
    """The bodies of the edit."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        """Draw name, mass factor and pins; mark an object that is gone."""
        gone = not item.is_recovered and is_gone(item.object, context.scene)
        row = layout.row()
        row.alert = gone
        row.label(text=f"{item.called} (gone)" if gone else item.called, icon="ERROR" if gone else "MESH_DATA")
        if item.pin_group:
            row.label(text="", icon="PINNED")
        if item.mass_scale != 1.0:
            row.label(text=f"x {item.mass_scale:g}")


class SEEING_WIND_UL_colliders(bpy.types.UIList):
    """What the bodies run into."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        """Draw the name; mark an object that is gone."""
        row = layout.row()
        gone = is_gone(item.object, context.scene)
        row.alert = gone
        row.label(text=f"{item.called} (gone)" if gone else item.called, icon="ERROR" if gone else "MOD_PHYSICS")


class SEEING_WIND_UL_edits(bpy.types.UIList):
    """The edits of one field."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        """Draw the name as an editable field."""
        layout.prop(item, "name", text="", emboss=False, icon="PHYSICS")


CLASSES = (SEEING_WIND_UL_bodies, SEEING_WIND_UL_colliders, SEEING_WIND_UL_edits, *panels(EditTab, 3))
