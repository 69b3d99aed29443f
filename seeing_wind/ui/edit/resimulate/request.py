"""What Re-simulate is asked for, as one snapshot of a scene's edit: values, digest, and the names of what is made. No NumPy."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import bpy

from ....engine.settings import BodyEdit, ColliderEdit, Edit
from ...bake.animation import keyframes
from ...field.display import stride_of
from ...job.status import digest_of
from ...option_properties import part_of, single, values_of
from ...scene_units import metres_per_unit
from ..sheet_label import SHEET, is_shell
from . import field_place, force_fields
from .geometry import baked_motion, geometry, moves, weights

LONGEST = 50
"""Characters of an object's name that become a file's: Blender allows 255 bytes, as most file systems do, endings not counted."""


@dataclass(frozen=True)
class Mover:
    """A body or a collider of the edit."""

    name: str
    """In the panel's list."""
    result: str
    """Of its files, and of a body in edit.toml."""
    object: bpy.types.Object | None
    values: dict[str, Any]
    """Of `BodyEdit` or `ColliderEdit`, as far as the panel has them."""

    @property
    def called(self) -> str:
        """In messages."""
        return f"the collider {self.name}"

    def stamp(self) -> tuple:
        """Of all that the simulation reads of it, but for its names."""
        return (self.values, geometry(self.object))


@dataclass(frozen=True)
class Body(Mover):
    """A body, with the vertex groups that hold it and let it go."""

    is_recovered: bool
    """It is the clip's own object."""
    pin_group: str
    free_mode: str
    free_group: str

    @classmethod
    def of(cls, body: bpy.types.PropertyGroup, taken: set[str]) -> Body:
        """A line of the panel's list. A mass goes before a density, and the clip's own object keeps its material."""
        values, obj = values_of(body, BodyEdit), body.object
        values |= {"density": None} if values["mass"] is not None else {}
        values |= {"material": None} if body.is_recovered else {}
        # a sheet's numbers mean nothing to a solid
        values = {name: value for name, value in values.items() if name not in SHEET or (value is not None and is_shell(body))}
        result = _free_name(body.called, taken)
        return cls(body.called, result, obj, values, body.is_recovered, body.pin_group, body.free_mode, body.free_group)

    @property
    def called(self) -> str:
        """In messages."""
        return self.name

    def stamp(self) -> tuple:
        """As of `Mover`."""
        held = (self.is_recovered, self.pin_group, self.is_recovered and self.free_mode, self.free_group)
        pinned = (weights(self.object, self.pin_group), moves(self.object)) if self.object is not None and self.pin_group else ""
        return (*super().stamp(), held, pinned)


@dataclass(frozen=True)
class EditRequest:
    """Everything that a re-simulation depends on, read from the scene once; meshes are read when they are written."""

    field: tuple[str, str]
    """Which recovered field it is simulated in."""
    stands: tuple
    """How its object stands in the scene, as `field_place.stamp` has it."""
    bodies: tuple[Body, ...]
    colliders: tuple[Mover, ...]
    floor: dict[str, Any] | None
    """Of `ColliderEdit`."""
    values: dict[str, Any]
    """Of `Edit`, as far as the panel has them and they are not below."""
    gravity: tuple[float, float, float] | str
    """[m/s²], or SAME or NONE."""
    strength: object
    """Factor on the field, or its keyframes."""
    forces: list[tuple]
    """Blender's own force fields, as `force_fields.stamp` has them."""
    offset: tuple[float, ...]
    """Where the edit is shown, from where it is simulated [m]."""
    frame_start: int
    timing: tuple
    """Bakes by which colliders move, and where anything moves by keyframes of its own, at which scene frames the clip's frames are."""
    metres: float
    """Length of a unit of the scene."""

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> EditRequest:
        """The edit of a scene as it stands."""
        settings, bodies, walls = scene.seeing_wind, set[str](), {"floor"}
        path, values = settings.path_from_id("field_strength"), values_of(settings, Edit)
        plane = (0.0, 0.0, single(settings.floor_height), 0.0, 0.0, 1.0)
        floor = {"plane": plane, "friction": single(settings.floor_friction)} if settings.use_floor else None
        return cls(
            field=(settings.recovered_digest, settings.recovered_stamp or settings.recovered_take),
            stands=field_place.stamp(scene),
            bodies=tuple(Body.of(body, bodies) for body in settings.bodies),
            colliders=tuple(
                Mover(each.called, _free_name(each.called, walls), each.object, values_of(each, ColliderEdit))
                for each in settings.colliders
            ),
            floor=floor, values={name: value for name, value in part_of(values, Edit).items() if value is not None},
            gravity=values["gravity"] if settings.edit_gravity_mode == "CUSTOM" else settings.edit_gravity_mode,
            strength=[curve for curve in keyframes(scene) if curve[0] == path] or settings.field_strength,
            forces=force_fields.stamp(scene) if len(settings.bodies) else [],
            offset=tuple(settings.offset), frame_start=settings.frame_start, timing=_timing(scene), metres=metres_per_unit(scene),
        )  # fmt: skip

    def digest(self) -> str:
        """Changes whenever the re-simulation would be another one; "" while there are no bodies."""
        moved = [body.stamp() for body in self.bodies if body.is_recovered or body.object is not None]
        walls = [(each.stamp(), moves(each.object)) for each in self.colliders if each.object is not None]
        around = (self.stands, self.floor, self.values, self.gravity, self.strength, self.forces, self.offset, self.metres, self.timing)
        return digest_of(self.field, moved, walls, *around) if moved else ""


def _timing(scene: bpy.types.Scene) -> tuple:
    settings = scene.seeing_wind
    walls = [each.object for each in settings.colliders if each.object is not None]
    bakes = [baked_motion(obj, scene) for obj in walls]
    tied = [body.object for body in settings.bodies if body.object is not None and body.pin_group]
    if not any(bakes) and not any(moves(obj) for obj in (*walls, *tied)):
        return ()
    return bakes, settings.frame_start, stride_of(settings.field_object) if settings.field_object is not None else 1.0


def _free_name(name: str, taken: set[str]) -> str:
    """A name that can be a file's and is not taken, near to the object's."""
    plain = re.sub(r"[^\w .-]", "_", name)[:LONGEST].strip(" .") or "body"
    free, count = plain, 1
    while free.lower() in taken:
        count += 1
        free = f"{plain}_{count}"
    taken.add(free.lower())
    return free
