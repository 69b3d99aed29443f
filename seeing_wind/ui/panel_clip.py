"""What the panel *Object* draws: where the object is, and what it is taken to be made of. Reads settings only."""

from ..engine.materials import MATERIALS


def draw_object(column, settings) -> None:
    """The way to mark the object, and the control that does it."""
    column.prop(settings, "object_mode")
    if settings.object_mode == "BOX":
        row = column.row()
        row.scale_y = 1.2
        row.operator("seeing_wind.draw_box", text="Draw Box", icon="SELECT_SET")
        sub = column.column(align=True)
        for index, text in enumerate(("Box Left (px)", "Top", "Right", "Bottom")):
            sub.prop(settings, "box", index=index, text=text)
    elif settings.object_mode == "MASK":
        column.prop(settings, "mask")
    elif settings.object_mode == "BLENDER_MASK":
        column.prop(settings, "mask_data")
    column.prop(settings, "use_tracks")


def draw_material(column, settings) -> None:
    """The numbers that the chosen material stands for, unless they are replaced below."""
    material = MATERIALS[settings.material]
    shown = []
    if not settings.use_density:
        shown.append(f"{material.density:g} kg/m³")
    if not settings.use_youngs_modulus:
        shown.append(f"{material.youngs_modulus:.3g} Pa")
    if shown:
        row = column.row()
        row.active = False
        row.label(text=", ".join(shown), icon="BLANK1")
