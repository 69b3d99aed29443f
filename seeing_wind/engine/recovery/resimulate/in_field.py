"""What is around the bodies: the recovered field, also where nobody saw anything move, gravity, obstacles and further forces.

The field may stand elsewhere than it was recovered: turned, moved, scaled. Then its force at a place is that at the place's own coordinates
in the field, turned with it; its size does not change, as that of a force field of Blender does not.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ...conventions import frame_named
from ...errors import UsageError
from ...field.force_field import ForceField
from ...mpm.lattice.colliders import Collider
from ...settings import Edit
from .forces import Forces
from .pins import read_way

FLATTEST = 1e-6
"""Least scale of a field along any direction, relative to the largest."""

FAINT = 0.5
"""Share of the field, in the mean over a body, below which the user is told that it has faded."""


@dataclass(frozen=True)
class Reach:
    """What becomes of a field away from the filmed object and beside its box, where that of the box's nearest place goes on."""

    fade: float | None = None
    """Over so many metres from the object, in its place of that frame, it fades to nothing, smoothly; and once more from the box."""
    falloff: tuple[float, float] | None = None
    """(a, p): at a distance d [m] from the box (a / (a + d)) ** p of it is left, and all of it within."""

    @classmethod
    def of(cls, edit: Edit) -> Reach:
        """Of an edit. Raises UsageError for a falloff beside a fade, or one that is not finite and above zero."""
        if edit.fade is not None and edit.falloff is not None:
            raise UsageError("The edit has both fade and falloff.", "Leave one of them out.")
        if edit.falloff is not None and not (np.isfinite(edit.falloff).all() and min(edit.falloff) > 0.0):
            raise UsageError(f"falloff is {edit.falloff}.", "Give metres and a power, both above zero.")
        return cls(edit.fade, edit.falloff)

    def left(self, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Share (P,) of the field that is left at distances (P,) [m] from the box, and its derivative [1/m]."""
        if self.falloff is not None:
            near, power = self.falloff
            share = (near / (near + distance)) ** power
            return share, -power * share / (near + distance)
        if self.fade is not None:
            t = np.clip(distance / self.fade, 0.0, 1.0)
            return 1.0 - t * t * (3.0 - 2.0 * t), -6.0 * t * (1.0 - t) / self.fade
        return np.ones_like(distance), np.zeros_like(distance)

    def left_near(self, field: ForceField, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Share (P,) of a field that is left at points (P, 3) [m] of its box, by their distance from the object, and its gradient [1/m]."""
        if self.fade is None:
            return np.ones(len(points)), np.zeros(points.shape)
        distance, outwards = field.away(points, frame)
        share, slope = self.left(distance)
        return share, slope[:, None] * outwards


@dataclass(frozen=True)
class Surroundings:
    """All that is around the bodies of an edit."""

    field: ForceField
    strength: np.ndarray
    """(T,) factor on the field in each of its frames."""
    gravity: Sequence[float]
    """(3,) [m/s²]."""
    colliders: Sequence[Collider]
    forces: Forces | None
    lead: int = 0
    """Frames for which the field's first one lasts longer."""
    place: np.ndarray | None = None
    """(T, 4, 4) from the field's own coordinates to the world's [m] in each of its frames; None where it was recovered."""
    reach: Reach = Reach()
    coarseness: float = 1.0
    """Factor on the length of substeps."""
    asked: int | None = None
    """How many of the field's frames are simulated; None for all."""

    @property
    def frames(self) -> int:
        """How many are simulated, those before the clip included."""
        return min(self.asked or self.field.frames, self.field.frames) + self.lead

    def told(self) -> list[Any]:
        """What a journal is told of it, but for the field, which its stamp tells."""
        return [list(self.gravity), self.strength, *self.colliders, self.forces, self.place, self.reach, self.coarseness, self.asked]

    def felt(self, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """The field's force density (P, 3) [N/m³] and its gradient (P, 3, 3) [N/m⁴] at points (P, 3) [m]; of a wind [m/s] and [1/s]."""
        row = max(frame - self.lead, 0)
        if self.place is None:
            value, gradient = extrapolate(self.field, points, row, self.reach)
        else:
            back, turn = np.linalg.inv(self.place[row]), rotation_of(self.place[row, :3, :3])
            value, gradient = extrapolate(self.field, points @ back[:3, :3].T + back[:3, 3], row, self.reach)
            value, gradient = value @ turn.T, turn @ gradient @ back[:3, :3]
        return self.strength[row] * value, self.strength[row] * gradient

    def value(self, frame: int, points: np.ndarray) -> np.ndarray:
        """The first of `felt`."""
        return self.felt(points, frame)[0]

    def place_notes(self, x: np.ndarray) -> list[str]:
        """Notes if at some time more than a tenth of a body was outside the field's box, or most of the field had faded where it was.

        Args:
            x: (T+1, N, 3) [m], the body's particles or vertices.
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
        where = f"up to {share:.0f} % of it lies outside the field's box, first in {frame_named(first)}"
        ends = f"the {kind} there is that of the box's edge" if self.reach == Reach() else f"the {kind} weakens there"
        return [f"{where}; {ends}"]

    def _faded_note(self, x: np.ndarray) -> list[str]:
        inside = np.clip(x[: self.field.frames], *self.field.box)
        left = np.array([self.reach.left_near(self.field, points, t)[0].mean() for t, points in enumerate(inside)])
        if left.min() >= FAINT:
            return []
        worst, kind = int(left.argmin()), self.field.kind
        fades = f"so far from the clip's object the {kind} at it fades to {100 * left[worst]:.0f} %, in {frame_named(worst)}"
        return [f"{fades}; to have it whole there, set Reach to Hold in the panel Field, or leave fade out of edit.toml"]


def extrapolate(field: ForceField, points: np.ndarray, frame: int, reach: Reach = Reach()) -> tuple[np.ndarray, np.ndarray]:
    """Force density (M, 3) [N/m³] and its gradient (M, 3, 3) [N/m⁴] at points (M, 3) [m]: what is left of those at the box's nearest
    places."""
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
    """What its reach leaves of a field, to be asked for values; the field alone is saved."""

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
    """(3, 3) the rotation in a matrix (3, 3). That of a mirrored one is the rotation in its negative, as Blender takes it."""
    U, _, Vt = np.linalg.svd(matrix if np.linalg.det(matrix) > 0.0 else -matrix)
    return np.asarray(U @ Vt)


def read_place(path: str | os.PathLike[str], frames: int) -> np.ndarray:
    """Where a field of so many frames stands: matrices (T, 4, 4) from an NPY file.

    Raises:
        UsageError: see `read_way`; a matrix that is no place, or flat.
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
