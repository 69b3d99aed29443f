"""What acts on the bodies: the recovered field and further ones, also away from where they were recovered, gravity, colliders and further
forces.

The field may have been moved, turned or scaled. The force at a place is then the field's at that place in the field's own coordinates,
turned with the field. Its strength does not change with the scale, as with Blender's own force fields.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from ...conventions import frame_named
from ...errors import UsageError, WrongTake
from ...field.force_field import ForceField
from ...field.storage import load_field
from ...mpm.lattice.colliders import Collider
from ...settings import Edit, FieldEdit
from .forces import Forces
from .pins import read_way

FLATTEST = 1e-6
"""Smallest scale of a field along any direction, relative to the largest."""

FAINT = 0.5
"""A note says that the field has faded if less than this share of it is left, averaged over a body."""

ALIKE = 1e-6
"""Relative difference below which two frame rates are the same."""

MOST_SCALED = 1e6
"""Factors on a mass, a stiffness or a field beyond this, and on the former two below its inverse, are a mistake."""


@dataclass(frozen=True)
class Reach:
    """What becomes of a field away from the filmed object and outside its box, where it continues as at the box's nearest place."""

    fade: float | None = None
    """Distance from the object, where it is in that frame, over which the field fades smoothly to zero; likewise from the box [m]."""
    falloff: tuple[float, float] | None = None
    """(a, p): at a distance d [m] from the box the share (a / (a + d)) ** p of the field is left; inside the box, all of it."""

    @classmethod
    def of(cls, edit: FieldEdit) -> Reach:
        """The reach that an edit asks for. Raises UsageError for both fade and falloff, or a falloff that is not finite and above zero."""
        if edit.fade is not None and edit.falloff is not None:
            raise UsageError(f"The edit has both fade and falloff{f' for {edit.file}' if edit.file else ''}.", "Leave one of them out.")
        if edit.falloff is not None and not (np.isfinite(edit.falloff).all() and min(edit.falloff) > 0.0):
            raise UsageError(f"falloff is {edit.falloff}.", "Give metres and a power, both above zero.")
        return cls(edit.fade, edit.falloff)

    def left(self, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Share (P,) of the field that is left at distances (P,) [m] from the box, and its derivative (P,) [1/m]."""
        if self.falloff is not None:
            near, power = self.falloff
            share = (near / (near + distance)) ** power
            return share, -power * share / (near + distance)
        if self.fade is not None:
            t = np.clip(distance / self.fade, 0.0, 1.0)
            return 1.0 - t * t * (3.0 - 2.0 * t), -6.0 * t * (1.0 - t) / self.fade
        return np.ones_like(distance), np.zeros_like(distance)

    def left_near(self, field: ForceField, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Share (P,) of a field left at points (P, 3) [m] in its box, from their distance to the object; and its gradient (P, 3) [1/m]."""
        if self.fade is None:
            return np.ones(len(points)), np.zeros(points.shape)
        distance, outwards = field.away(points, frame)
        share, slope = self.left(distance)
        return share, slope[:, None] * outwards


@dataclass(frozen=True)
class Blowing:
    """A field as it stands in an edit."""

    field: ForceField
    strength: np.ndarray
    """(T,) factor on the field in each of its frames."""
    place: np.ndarray | None = None
    """(T, 4, 4) matrices from the field's own coordinates to the world's [m] in each of its frames; None if it stands where it was
    recovered."""
    reach: Reach = Reach()
    lead: int = 0
    """Frames before the clip, in which the field of the clip's first frame acts."""
    name: str = ""
    """Of a further field, in notes; empty for that of the take."""

    def felt(self, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """The field's force density (P, 3) [N/m³] and its gradient (P, 3, 3) [N/m⁴] at points (P, 3) [m]; for a wind in [m/s] and [1/s]."""
        row = max(frame - self.lead, 0)
        if self.place is None:
            value, gradient = extrapolate(self.field, points, row, self.reach)
        else:
            back, turn = np.linalg.inv(self.place[row]), rotation_of(self.place[row, :3, :3])
            value, gradient = extrapolate(self.field, points @ back[:3, :3].T + back[:3, 3], row, self.reach)
            value, gradient = value @ turn.T, turn @ gradient @ back[:3, :3]
        return self.strength[row] * value, self.strength[row] * gradient

    def notes(self, x: np.ndarray) -> list[str]:
        """Notes if in some frame more than a tenth of a body was outside the field's box, or most of the field had faded at the body.

        Args:
            x: (T+1, N, 3) positions of the body's particles or vertices [m].
        """
        if self.place is not None:
            back = np.linalg.inv(self.place[np.minimum(np.arange(len(x)), len(self.place) - 1)])
            x = np.einsum("tij,tnj->tni", back[:, :3, :3], x) + back[:, None, :3, 3]
        return self._outside_note(x) + self._faded_note(x)

    def _outside_note(self, x: np.ndarray) -> list[str]:
        outside = ((x < self.field.box[0]) | (x > self.field.box[1])).any(axis=2).mean(axis=1)
        if outside.max() <= 0.1:
            return []
        first, share, kind = int(np.argmax(outside > 0.1)), 100 * outside.max(), self.field.kind
        where = f"up to {share:.0f} % of it lies outside {self.name or 'the field'}'s box, first in {frame_named(first)}"
        ends = f"the {kind} there is that of the box's edge" if self.reach == Reach() else f"the {kind} weakens there"
        return [f"{where}; {ends}"]

    def _faded_note(self, x: np.ndarray) -> list[str]:
        inside = np.clip(x[: self.field.frames], *self.field.box)
        left = np.array([self.reach.left_near(self.field, points, t)[0].mean() for t, points in enumerate(inside)])
        if left.min() >= FAINT:
            return []
        worst, kind = int(left.argmin()), self.field.kind + (f" of {self.name}" if self.name else "")
        fades = f"so far from the clip's object the {kind} at it fades to {100 * left[worst]:.0f} %, in {frame_named(worst)}"
        return [f"{fades}; to have it whole there, set Reach to Hold in the panel Field, or leave fade out of edit.toml"]


@dataclass(frozen=True)
class Surroundings:
    """Everything that acts on the bodies of an edit."""

    fields: Sequence[Blowing]
    """That of the take, which determines the frames and their rate, and the further ones."""
    gravity: Sequence[float]
    """(3,) [m/s²]."""
    colliders: Sequence[Collider]
    forces: Forces | None
    lead: int = 0
    """Frames before the clip, in which all fields of the clip's first frame act."""
    coarseness: float = 1.0
    """Factor on the length of substeps."""
    asked: int | None = None
    """How many of the field's frames the edit asks for; None for all."""

    @property
    def field(self) -> ForceField:
        """The take's field."""
        return self.fields[0].field

    @property
    def frames(self) -> int:
        """Number of simulated frames, including those before the clip."""
        return min(self.asked or self.field.frames, self.field.frames) + self.lead

    def told(self) -> list[Any]:
        """The inputs for a journal's digest, without the fields' values, on which the journal's stamp depends already."""
        stand = [part for one in self.fields for part in (one.strength, one.place, one.reach)]
        return [list(self.gravity), *stand, *self.colliders, self.forces, self.coarseness, self.asked]

    @property
    def blows(self) -> bool:
        """Whether any field is a wind."""
        return any(one.field.kind == "wind" for one in self.fields)

    def wind(self, frame: int, points: np.ndarray) -> np.ndarray:
        """Velocity (P, 3) [m/s] of the air at points (P, 3) [m]; only if it blows."""
        return self._felt("wind", points, frame)[0]

    def push(self, frame: int, density: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Acceleration (P, 3) [m/s²] by the force fields of matter of a density (P,) [kg/m³] at points (P, 3) [m], and its gradient
        (P, 3, 3) [1/s²]; None for the latter if there is no force field."""
        force, gradient = self.force(frame, points)
        pushes = any(one.field.kind == "force" for one in self.fields)
        return force / density[:, None], gradient / density[:, None, None] if pushes else None

    def force(self, frame: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sum of the force fields at points (P, 3) [m]: density (P, 3) [N/m³] and gradient (P, 3, 3) [N/m⁴]; 0 if there is none."""
        return self._felt("force", points, frame)

    def _felt(self, kind: str, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        found = [one.felt(points, frame) for one in self.fields if one.field.kind == kind]
        value, gradient = np.zeros(points.shape), np.zeros((len(points), 3, 3))
        for one in found:
            value, gradient = value + one[0], gradient + one[1]
        return value, gradient

    def place_notes(self, x: np.ndarray) -> list[str]:
        """Notes of all fields on the path x (T+1, N, 3) [m] of a body's particles or vertices."""
        return [note for one in self.fields for note in one.notes(x)]


def extrapolate(field: ForceField, points: np.ndarray, frame: int, reach: Reach = Reach()) -> tuple[np.ndarray, np.ndarray]:
    """Force density (M, 3) [N/m³] and its gradient (M, 3, 3) [N/m⁴] at points (M, 3) [m]; outside the box, what the reach leaves of the
    values at its nearest places."""
    nearest = np.clip(points, field.box[0], field.box[1])
    near, change = reach.left_near(field, nearest, frame)
    whole, _ = field.sample(nearest, frame)
    force = near[:, None] * whole
    gradient = near[:, None, None] * field.gradient(nearest, frame) + whole[:, :, None] * change[:, None, :]
    gradient = gradient * (nearest == points)[:, None, :]
    away = points - nearest
    distance = np.linalg.norm(away, axis=1)
    left, slope = reach.left(distance)
    outwards = away / np.maximum(distance, np.finfo(float).tiny)[:, None]
    return left[:, None] * force, left[:, None, None] * gradient + slope[:, None, None] * force[:, :, None] * outwards[:, None, :]


class WithinReach(ForceField):
    """A field weakened according to its reach. It can be sampled, but not saved or loaded; the field itself is what is saved."""

    def __init__(self, field: ForceField, reach: Reach) -> None:
        super().__init__(field.box, field.fps, field.frames)
        self.field, self.reach, self.kind = field, reach, field.kind

    @classmethod
    def from_file(cls, tensors: dict[str, np.ndarray], metadata: dict[str, str], box: np.ndarray, fps: float, frames: int) -> Self:
        raise NotImplementedError

    def _force(self, points: np.ndarray, frame: int) -> np.ndarray:
        return extrapolate(self.field, points, frame, self.reach)[0]

    def _gradient(self, points: np.ndarray, frame: int) -> np.ndarray:
        return extrapolate(self.field, points, frame, self.reach)[1]

    def _confidence(self, points: np.ndarray, frame: int) -> np.ndarray:
        return self.field.sample(points, frame)[1]

    def _away(self, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        return self.field.away(points, frame)

    def _tensors(self) -> dict[str, np.ndarray]:
        raise NotImplementedError


def rotation_of(matrix: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) contained in a matrix (3, 3). For a mirrored matrix it is that of its negative, as in Blender."""
    U, _, Vt = np.linalg.svd(matrix if np.linalg.det(matrix) > 0.0 else -matrix)
    return np.asarray(U @ Vt)


def fields_of(edit: Edit, field: ForceField, folder: Path) -> list[Blowing]:
    """The take's field and the further ones of an edit whose paths are relative to `folder`, as they stand there.

    Raises:
        UsageError: for a further field of another frame rate, or with fewer frames; or a file that is none; as `strengths`,
            `read_place`, `Reach.of`.
    """
    whole, found = FieldEdit("", None, edit.field_strength, edit.field_place, edit.fade, edit.falloff), []
    for one in (whole, *edit.further_field):
        blown = field if one is whole else _further(folder / one.file)
        if blown.frames < field.frames or abs(blown.fps / field.fps - 1.0) > ALIKE:
            has, asked = (f"{each.frames} frames, {each.fps:g} a second" for each in (blown, field))
            needs = "A further field needs the same frame rate, and at least as many frames."
            raise UsageError(f"{one.file} has {has}, and the take's field {asked}.", needs)
        place = None if one.place is None else read_place(folder / one.place, blown.frames)
        strength = strengths(one.strength, blown.frames, one.file)
        found.append(Blowing(blown, strength, place, Reach.of(one), edit.preroll, one.name or one.file))
    return found


def _further(path: Path) -> ForceField:
    try:
        return load_field(path)
    except WrongTake as error:
        hint = "A further field is field.safetensors or wind.safetensors of a take; if this is one, run `recover` for that take again."
        raise UsageError(error.message, hint) from error


def strengths(strength: float | tuple[float, ...], frames: int, file: str = "") -> np.ndarray:
    """The strength of an edit's field for each frame, (frames,); `file` is that of a further one.

    Raises:
        UsageError: for another number of values, or one beyond `MOST_SCALED`.
    """
    values = np.atleast_1d(np.asarray(strength, dtype=np.float64))
    if len(values) not in (1, frames) or not (np.abs(values) <= MOST_SCALED).all():
        called = f"The strength of {file}" if file else "field_strength"
        raise UsageError(
            f"{called} has {len(values)} values for {frames} frames, the largest {np.abs(values).max(initial=0.0):g}.",
            f"Give one number, or one per frame, up to {MOST_SCALED:g}.",
        )
    return np.broadcast_to(values, (frames,))


def read_place(path: str | os.PathLike[str], frames: int) -> np.ndarray:
    """The place of a field with `frames` frames: matrices (T, 4, 4) from an NPY file.

    Raises:
        UsageError: as in `read_way`, or for a matrix that is not affine, or is flat.
    """
    place = read_way(path, (frames, 4, 4), "the field's place")
    scale = np.linalg.svd(place[:, :3, :3], compute_uv=False)
    foreign = (place[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1)
    wrong = np.flatnonzero(foreign | (scale[:, 2] <= FLATTEST * scale[:, 0]))
    if len(wrong):
        t = int(wrong[0])
        why = f"has the last row {place[t, 3].tolist()}, not 0 0 0 1" if foreign[t] else f"is flat: its scales are {scale[t].tolist()}"
        raise UsageError(f"{path}, the field's place: the matrix of {frame_named(t)} {why}.", "Check the field's scale.")
    return place
