"""The panel *Field*: the field object in the rest of Blender."""

import bpy

from ..job.panel_pieces import Tab, draw_text, panels
from ..scene_units import said_of_units
from .display import (
    ARROWS_MATERIAL,
    KIND,
    LOOP,
    arrows_of,
    field_at_hand,
    frames_per_second,
    has_wind,
    in_figures,
    out_of_time,
    said_of_fit,
    said_of_mirror,
    said_of_override,
    said_of_pace,
    said_of_speed,
    said_of_unseen,
    said_of_wind,
    stride_of,
)
from .node_groups import get_input, modifier_input

SHOWN = {
    "Length": "Length", "Density": "Density", "Confidence Shown": "Min Confidence", "Slice Axis": "Slice (0: Off)",
    "Slice Position": "Slice At", "Slice Thickness": "Slice Width",
}  # fmt: skip
"""Settings of the arrows' modifier, and labels for them that fit into a sidebar."""


class FieldTab(Tab):
    """The recovered field: strength, arrows with their legend, Blender's own solvers, export."""

    bl_label = "Field"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """Whether there is a field: the scene's own, or a selected one that was appended or linked."""
        return context.scene is not None and field_at_hand(context) is not None

    def fill(self, context, layout):
        """Draw the objects' own settings, so that nothing is stored twice."""
        settings, field = context.scene.seeing_wind, field_at_hand(context)
        layout.use_property_split, layout.use_property_decorate = True, False
        if field != settings.field_object:
            layout.label(text=field.name, icon="FORCE_WIND")
        layout.prop(settings, "field_share")
        if has_wind(field):
            draw_text(layout, context, said_of_wind(field), "FORCE_WIND")
        speed = said_of_speed(field, context.scene)
        if speed:
            draw_text(layout, context, speed, "TIME")
            layout.operator("seeing_wind.conform", icon="TIME")
            if field == settings.field_object and settings.recovered_object is not None:
                then = said_of_pace(frames_per_second(context.scene) / field["seeing_wind_fps"])
                draw_text(layout, context, f"Then {then}", "INFO")
        for wrong in filter(None, (said_of_units(field, context.scene), said_of_mirror(field), said_of_override(field))):
            box = layout.box()
            box.alert = True
            draw_text(box, context, wrong, "ERROR")
        if said_of_override(field):
            layout.operator("seeing_wind.turn_override", icon="ORIENTATION_LOCAL")
        if stride_of(field) != 1.0:
            layout.operator("seeing_wind.conform", text="One Clip Frame per Scene Frame", icon="RENDER_ANIMATION").real_time = False
        if LOOP in field:
            layout.prop(field, f'["{LOOP}"]', text="Loop")
        self._felt(context, layout, settings, field)
        arrows = arrows_of(field, context.scene)
        if arrows is not None:
            self._arrows(context, layout, arrows)
        column = layout.column()
        both = column.column(align=True)
        one = both.row(align=True)
        one.enabled = context.active_object is not None
        one.operator("seeing_wind.calibrate", icon="PHYSICS")
        both.operator("seeing_wind.calibrate", text="Calibrate All Objects").every = True
        for each in settings.calibrations:
            if each.object is not None and each.object == context.active_object and each.said:
                draw_text(column, context, each.said, "INFO")
        wrong = out_of_time(context.scene)
        if wrong:
            box = column.box()
            box.alert = True
            names = ", ".join(each.object.name for each in wrong[:3])
            said = f"The frame rate, or what solvers feel, has changed since {names} was calibrated: the wind is felt wrongly"
            draw_text(box, context, said, "ERROR")
            box.operator("seeing_wind.calibrate_again", icon="FILE_REFRESH")
        if sum(has_wind(each) for each in context.scene.objects if each.get("seeing_wind_take")) > 1:
            column.operator("seeing_wind.join", icon="LINKED")
        column.operator_menu_enum("seeing_wind.export_field", "format", text="Export Field", icon="EXPORT")

    def _felt(self, context, layout, settings, field):
        """Draw what solvers feel, and how close it is to the recovered field."""
        column = layout.column()
        if has_wind(field):
            column.prop(settings, "field_kind")
        column.prop(settings, "field_reach")
        kind = settings.field_kind if has_wind(field) else field.get(KIND)
        row = column.row()
        row.alert = (settings.field_reach, kind) != (field.get("seeing_wind_reach"), field.get(KIND))
        row.operator("seeing_wind.apply_to_field", icon="FORCE_TEXTURE")
        if said_of_fit(field):
            draw_text(column, context, said_of_fit(field), "INFO")

    def _arrows(self, context, layout, arrows):
        modifier = next((modifier for modifier in arrows.modifiers if modifier.type == "NODES"), None)
        unseen = said_of_unseen(arrows, get_input(modifier, "Confidence Shown") or 0.0) if modifier is not None else ""
        if unseen:
            draw_text(layout, context, unseen, "INFO")
        header, column = layout.panel("SEEING_WIND_arrows", default_closed=True)
        header.label(text="Arrows")
        # Blender itself shows a closed eye while the property is set
        header.prop(arrows, "hide_viewport", text="", icon="HIDE_OFF", emboss=False)
        if column is None:
            return
        for name, text in SHOWN.items() if modifier is not None else ():
            place = modifier_input(modifier, name)
            if place is not None:
                column.prop(place[0], place[1], text=text)
        space = context.space_data
        if space is not None and space.type == "VIEW_3D" and space.shading.type == "SOLID":
            column.prop(space.shading, "color_type", text="Solid Color")
        material = bpy.data.materials.get(ARROWS_MATERIAL)
        ramp = None
        if material is not None:
            ramp = next((node for node in material.node_tree.nodes if node.type == "VALTORGB"), None)
        if ramp is not None:
            box = column.box()
            box.template_color_ramp(ramp, "color_ramp", expand=False)
            row = box.row()
            row.label(text="0")
            end = row.row()
            end.alignment = "RIGHT"
            end.label(text=f"{in_figures(arrows.get('seeing_wind_peak', 0.0))} {arrows.get('seeing_wind_units', 'N/m³')}")


CLASSES = panels(FieldTab, 20)
