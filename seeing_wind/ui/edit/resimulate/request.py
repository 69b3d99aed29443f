"""The input of Re-simulate as a snapshot of a scene's edit: values, digest, and the names of the files to be made. No NumPy."""

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
"""Most characters of an object's name used in a file name: Blender allows 255 bytes, as do most file systems, extension included."""


@dataclass(frozen=True)
class Mover:
    """A body or a collider of the edit."""

    name: str
    """The name in the panel's list."""
    result: str
    """The name of its files, and of a body in edit.toml."""
    object: bpy.types.Object | None
    values: dict[str, Any]
    """Values of `BodyEdit` or `ColliderEdit`, as far as the panel has them."""

    @property
    def called(self) -> str:
        """The name used in messages."""
        return f"the collider {self.name}"

    def stamp(self) -> tuple:
        """Everything the simulation reads of it, apart from its names."""
        return (self.values, geometry(self.object))


@dataclass(frozen=True)
class Body(Mover):
    """A body, with the vertex groups that hold it and let it go."""

    is_recovered: bool
    """Whether it is the clip's own object."""
    pin_group: str
    free_mode: str
    free_group: str

    @classmethod
    def of(cls, body: bpy.types.PropertyGroup, taken: set[str]) -> Body:
        """Read an entry of the panel's list. A mass takes precedence over a density, and the clip's own object keeps its material."""
        values, obj = values_of(body, BodyEdit), body.object
        values |= {"density": None} if values["mass"] is not None else {}
        values |= {"material": None} if body.is_recovered else {}
        # a sheet's numbers mean nothing to a solid
        values = {name: value for name, value in values.items() if name not in SHEET or (value is not None and is_shell(body))}
        result = _free_name(body.called, taken)
        return cls(body.called, result, obj, values, body.is_recovered, body.pin_group, body.free_mode, body.free_group)

    @property
    def called(self) -> str:
        """The name used in messages."""
        return self.name

    def stamp(self) -> tuple:
        """As for `Mover`, with pins and released vertices."""
        held = (self.is_recovered, self.pin_group, self.is_recovered and self.free_mode, self.free_group)
        pinned = (weights(self.object, self.pin_group), moves(self.object)) if self.object is not None and self.pin_group else ""
        return (*super().stamp(), held, pinned)


@dataclass(frozen=True)
class EditRequest:
    """Everything that a re-simulation depends on, read from the scene once; meshes are read when they are written."""

    field: tuple[str, str]
    """Identifies the recovered field in which the edit is simulated."""
    stands: tuple
    """How the field object stands in the scene, from `field_place.stamp`."""
    bodies: tuple[Body, ...]
    colliders: tuple[Mover, ...]
    floor: dict[str, Any] | None
    """Values of `ColliderEdit` for the floor; None without one."""
    values: dict[str, Any]
    """Values of `Edit`, as far as the panel has them and no field below holds them."""
    gravity: tuple[float, float, float] | str
    """[m/s²], or SAME or NONE."""
    strength: object
    """Factor on the field, or its keyframes."""
    forces: list[tuple]
    """Blender's own force fields, from `force_fields.stamp`."""
    offset: tuple[float, ...]
    """Displacement [m] from where the edit is simulated to where it is shown."""
    frame_start: int
    timing: tuple
    """Bakes that move colliders, and the scene frames of the clip; empty if neither bakes nor keyframes move anything."""
    metres: float
    """Length of one scene unit [m]."""

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> EditRequest:
        """Read the present edit of a scene."""
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
        """Digest of all that the re-simulation depends on; "" if there are no bodies."""
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
    """A valid file name close to `name` that is not in `taken`, to which it is added (case is ignored)."""
    plain = re.sub(r"[^\w .-]", "_", name)[:LONGEST].strip(" .") or "body"
    free, count = plain, 1
    while free.lower() in taken:
        count += 1
        free = f"{plain}_{count}"
    taken.add(free.lower())
    return free
