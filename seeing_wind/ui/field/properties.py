"""The settings of the field object.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

from collections.abc import Callable

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, PointerProperty, StringProperty

from ..property_kinds import KEPT
from .display import KIND, field_at_hand, share

KINDS = [
    ("WIND", "Wind", "Air that moves: it pushes bodies by their own surface, and slows what is faster than it"),
    ("FORCE", "Force", "The force per volume that the filmed object felt, whatever the body and its speed"),
]
REACHES = [
    ("FADE", "Fade", "It fades away from the filmed object, over three quarters of the box's length: nothing is known there"),
    ("HOLD", "Hold", "Whole in the box, and beside it as strong as at its nearest edge, however far away"),
    ("CONTINUE", "Continue", "Whole in the box, and beside it weaker with distance, but never zero"),
]


class SEEING_WIND_PG_calibration(bpy.types.PropertyGroup):
    """One object that was calibrated: its weights are right for one frame rate of the scene."""

    object: PointerProperty(type=bpy.types.Object, description="The object that was calibrated")
    field: PointerProperty(type=bpy.types.Object, description="The field that it was calibrated for")
    density: FloatProperty(name="Density (kg/m³)", description="0: as the recovered object")
    alone: BoolProperty(description="Whether it feels no other forces than those of the field")
    set_mass: BoolProperty(description="Whether its mass was changed to suit the weight of its rigid body world")
    areal_density: FloatProperty(name="Areal Density (kg/m²)", description="Of cloth in a wind")
    said: StringProperty(description="What was set, how far off it is, and what its solver cannot do")
    wind: BoolProperty(description="Whether it was calibrated for a wind that moves, not for a force")
    fps: FloatProperty(name="Frame Rate (1/s)", description="Of the scene, at that time")


def _share(settings) -> float:
    field = field_at_hand(bpy.context)
    return share(field) if field is not None else 1.0


def _set_share(settings, value: float) -> None:
    field = field_at_hand(bpy.context)
    if field is not None and field.library is None:
        field.field.strength = value * field["seeing_wind_strength"]


def _of_field(own: str, mark: str, items: list[tuple[str, str, str]]) -> dict[str, Callable]:
    """Getter and setter of a choice for the field at hand: for the scene's own field, the setting `own`; for another, a property of that
    field, which starts as the value that the field was made with."""
    words, chosen = [word for word, *_ in items], f"{mark}_chosen"

    def get(settings) -> int:
        field = _other_field(settings)
        return words.index(getattr(settings, own) if field is None else field.get(chosen, field.get(mark, words[0])))

    def put(settings, value: int) -> None:
        field = _other_field(settings)
        if field is None:
            setattr(settings, own, words[value])
        elif field.library is None:
            field[chosen] = words[value]

    return {"get": get, "set": put}


def _other_field(settings):
    """The field at hand if it is not the scene's own, else None."""
    field = field_at_hand(bpy.context) if bpy.context.scene == settings.id_data else None
    return field if field != settings.field_object else None


class FieldSettings:
    """What solvers feel of the field object, and where."""

    field_share: FloatProperty(
        name="Strength", get=_share, set=_set_share, default=1.0, soft_min=0.0, soft_max=3.0, step=10, options={"SKIP_SAVE"},
        description="Factor on the recovered field. To animate it, keyframe Strength of the object's force field, in its Physics tab",
    )  # fmt: skip
    field_kind: EnumProperty(
        name="Solvers Feel", items=KINDS, options=KEPT,
        description="What Blender's own solvers feel of a field that was recovered as a wind", **_of_field("own_kind", KIND, KINDS),
    )  # fmt: skip
    field_reach: EnumProperty(
        name="Reach", items=REACHES, options=KEPT,
        description="What becomes of the wind away from the filmed object and beside the box in which it was recovered",
        **_of_field("own_reach", "seeing_wind_reach", REACHES),
    )  # fmt: skip
    own_kind: EnumProperty(items=KINDS, options={"HIDDEN"}, description="That choice for the scene's own field")
    own_reach: EnumProperty(items=REACHES, options={"HIDDEN"}, description="That choice for the scene's own field")
    real_time: BoolProperty(
        options={"HIDDEN"},
        description="The clip's motion plays at its own speed, whatever the frame rate; otherwise one clip frame per scene frame",
    )
    calibrations: CollectionProperty(type=SEEING_WIND_PG_calibration, options={"HIDDEN"})


CLASSES = (SEEING_WIND_PG_calibration,)
