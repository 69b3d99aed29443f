"""The panel *Object*: where the object is, and its assumed material."""

import bpy

from ....engine.conventions import BODY, HELD_PLACE, TIME, in_units
from ....engine.materials import MATERIALS
from ....engine.settings import BuildSettings, ObserveSettings, RecoverSettings
from ...job import status
from ...job.panel_pieces import Tab, columns, draw_failure, draw_job, draw_override, draw_progress, draw_text, fold, panels
from ...job.status import State
from ...option_properties import panel_options
from ...property_kinds import PRESET
from .material_menu import draw_material
from .preview import FILM, IMAGE


class ObjectTab(Tab):
    """Which object, at what scale, made of what."""

    bl_label = "Object"
    step = "object"

    def fill(self, context, layout):
        """Draw mark, scale, material, corrections, held place, preview, a model's answers, and further options."""
        column, settings = columns(layout), context.scene.seeing_wind
        _draw_object(column, settings)
        column.separator()
        column.prop(settings, "scale_mode")
        if settings.scale_mode == "PROXY" or settings.object_mode == "PROXY":
            column.prop(settings, "proxy")
        else:
            column.prop(settings, "pixels_per_metre" if settings.scale_mode == "PIXELS" else "distance")
        draw_material(column, settings)
        if _has_parts(settings):
            draw_material(column, settings, "head_material")
            draw_material(column, settings, "leaf_material")
        column.prop(settings, "form")
        _draw_material(column, settings)
        _draw_corrections(column, settings)
        _draw_held(column, context, settings)
        step = status.of(context.scene.session_uid).steps["object"]
        if step.state == State.FAILED:  # above the preview, whose many lines would push it out of sight
            draw_failure(layout, context, step)
        _draw_preview(layout, context, settings)
        _draw_guesses(layout, context, settings, self.bl_space_type)
        _draw_more(layout, settings)


def _has_parts(settings) -> bool:
    """Whether the object may have parts with materials of their own: a place is marked as held, or such a material is set already."""
    marked = {"FILE": bool(settings.pin), "BOX": any(settings.held_box), "BLENDER_MASK": settings.held_mask is not None}
    return marked[settings.held_mode] or any(getattr(settings, f"{part}_material") != PRESET for part in ("head", "leaf"))


def _draw_object(column, settings) -> None:
    """Draw the choice of how to mark the object, and its control."""
    column.prop(settings, "object_mode")
    if settings.object_mode == "BOX":
        row = column.row()
        row.scale_y = 1.2
        row.operator("seeing_wind.draw_box", text="Draw Box", icon="SELECT_SET")
        _draw_corners(column, settings, "box")
    elif settings.object_mode == "MASK":
        column.prop(settings, "mask")
    elif settings.object_mode == "BLENDER_MASK":
        column.prop(settings, "mask_data")
    column.prop(settings, "use_tracks")


def _draw_material(column, settings) -> None:
    """Draw overrides of the material's numbers, each with the value used without it."""
    material = MATERIALS[settings.material]
    numbers = {"density": f"{material.density:g}", "youngs_modulus": in_units(material.youngs_modulus, "Pa"), "thickness": "Automatic"}
    own = sum(getattr(settings, f"use_{name}") for name in numbers)
    body = fold(column, "material", f"Density, Stiffness, Thickness ({own} set)" if own else "Density, Stiffness, Thickness")
    for name, otherwise in numbers.items() if body is not None else ():
        draw_override(body, settings, name, otherwise)


def _draw_held(column, context, settings) -> None:
    """Draw the choice of how to mark the held place, and its control; weight paint only if the active mesh has vertex groups."""
    column.prop(settings, "held_mode")
    if settings.held_mode == "FILE":
        column.prop(settings, "pin", text="Image")
        active = context.view_layer.objects.active
        if active is not None and active.type == "MESH" and len(active.vertex_groups):
            column.operator("seeing_wind.hold_painted", icon="WPAINT_HLT")
    elif settings.held_mode == "BOX":
        column.operator("seeing_wind.draw_box", text="Draw Held Box", icon="SELECT_SET").marks = "HELD"
        _draw_corners(column, settings, "held_box")
    else:
        column.prop(settings, "held_mask")


def _draw_corrections(column, settings) -> None:
    """Draw the corrections of the outline: points, a Blender mask, or a painted image."""
    count = len(settings.corrections)
    mended = settings.outline_data is not None or bool(settings.outline)
    body = fold(column, "corrections", f"Correct the Outline ({count + mended} set)" if count + mended else "Correct the Outline")
    if body is None:
        return
    row = body.row(align=True)
    row.operator("seeing_wind.correct_outline", icon="ADD")
    row.operator("seeing_wind.correct_outline", text="Point off Object", icon="REMOVE").beside = True
    for point in settings.corrections[-3:]:
        where = f"{'off' if point.beside else 'on'} the object at {point.place[0]:.0f}, {point.place[1]:.0f} px"
        body.label(text=f"Clip frame {point.clip_frame}: {where}", icon="REMOVE" if point.beside else "ADD")
    if count:
        body.operator("seeing_wind.clear_corrections", icon="X")
    body.prop(settings, "outline_data", text="Blender Mask")
    if settings.outline_data is None:
        body.prop(settings, "outline", text="Painted")
    if mended:
        body.prop(settings, "outline_frame")


def _draw_corners(column, settings, name: str) -> None:
    """Draw the four numbers of a box."""
    left, top, right, bottom = getattr(settings, name)
    drawn = right > left and bottom > top
    body = fold(column, name, f"{right - left:.0f} x {bottom - top:.0f} px at {left:.0f}, {top:.0f}" if drawn else "Box in Numbers")
    sub = body.column(align=True) if body is not None else None
    for index, text in enumerate(("Box Left (px)", "Top", "Right", "Bottom")) if sub is not None else ():
        sub.prop(settings, name, index=index, text=text)


def _draw_preview(layout, context, settings) -> None:
    """Draw the preview: its button, its image, and the verdicts on what can be trusted."""
    now = status.of(context.scene.session_uid)
    steps, foreseen = now.steps, now.foreseen
    ready = steps["clip"].state == State.DONE and steps["object"].state == State.DONE
    missing = "" if ready else "Mark the object in a clip first"
    draw_job(layout, context, "preview", "seeing_wind.preview", "Preview", "HIDE_OFF", missing, warned=not len(settings.verdicts))
    if not len(settings.verdicts):
        return
    body = fold(layout, "preview", "What Is Seen", closed=False)
    if body is None:
        return
    image = settings.preview_image
    if image is not None and image.preview is not None:
        body.template_icon(icon_value=image.preview.icon_id, scale=11.0)
    row = body.row(align=True)
    for name, text, icon in ((IMAGE, "Image", "IMAGE_DATA"), (FILM, "Film", "FILE_MOVIE")):
        row.operator("wm.path_open", text=text, icon=icon).filepath = f"{settings.previewed_take}/{name}"
    marked = bool(settings.pin) if settings.held_mode == "FILE" else ready
    for verdict in settings.verdicts:
        words, doubtful = f"{verdict.because} {verdict.advice}".strip(), verdict.doubtful
        proposed = settings.proposed_pin if verdict.name == HELD_PLACE else ""
        if proposed and marked:  # marked since the preview
            words, doubtful = "It is marked.", False
        icon = "ERROR" if doubtful else "CHECKMARK"
        if verdict.name in (BODY, TIME) and not foreseen:
            words, icon = "Settings have changed since. Press Preview again.", "FILE_REFRESH"
        draw_text(body, context, f"{verdict.name.capitalize()}: {words}", icon)
        if proposed and settings.pin != proposed:
            body.operator("seeing_wind.use_held", icon="PINNED")


class SEEING_WIND_UL_guesses(bpy.types.UIList):
    """What a model saw in the clip."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index):
        """Draw a guess: name, material and density."""
        row = layout.row()
        row.label(text=f"{item.name}: {item.made_of}", icon="OBJECT_DATA")
        sub = row.row()
        sub.alignment = "RIGHT"
        sub.label(text=f"{item.density:.3g} kg/m³")


def _draw_guesses(layout, context, settings, space: str) -> None:
    """Draw the button that asks a model what is in the clip, and the list of its answers."""
    body = fold(layout, "guesses", "Ask a Model", closed=not len(settings.guesses))
    if body is None:
        return
    now = status.of(context.scene.session_uid)
    asked = now.steps.get("identify")
    if now.running == "identify" and asked is not None:
        draw_progress(body, context, asked, now.cancelling)
        return
    row = body.row()
    row.enabled = now.steps["clip"].state == State.DONE and not now.running
    row.operator("seeing_wind.identify", icon="QUESTION")
    if asked is not None and asked.state == State.FAILED:
        draw_failure(body, context, asked)
    elif asked is not None and asked.message:
        draw_text(body, context, asked.message)
    if len(settings.guesses):
        body.template_list("SEEING_WIND_UL_guesses", space, settings, "guesses", settings, "active_guess", rows=2)
        body.operator("seeing_wind.use_guess", icon="CHECKMARK")


def _draw_more(layout, settings) -> None:
    """Draw all options without a place of their own, which few users need."""
    body = fold(layout, "more", "More")
    if body is None:
        return
    column = body.column()
    for one in panel_options(BuildSettings, ObserveSettings, RecoverSettings, part="more"):
        draw_override(column, settings, one.identifier)


CLASSES = (SEEING_WIND_UL_guesses, *panels(ObjectTab, 1))
