"""What is around the bodies: the recovered field, also where nobody saw anything move, gravity, obstacles and further forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import UsageError
from ...field.force_field import ForceField
from ...mpm.lattice.colliders import Collider
from .forces import Forces


class Waiting(ForceField):
    """A field that begins later: its first frame lasts `lead` frames longer. It is in no file."""

    def __init__(self, field: ForceField, lead: int) -> None:
        super().__init__(field.box, field.fps, field.frames + lead)
        self.field, self.lead, self.kind = field, lead, field.kind

    @classmethod
    def from_file(cls, tensors: dict[str, np.ndarray], metadata: dict[str, str], box: np.ndarray, fps: float, frames: int) -> Waiting:
        """There is none."""
        raise UsageError("A field that waits is in no file.", "Save the field itself.")

    def _tensors(self) -> dict[str, np.ndarray]:
        raise UsageError("A field that waits is in no file.", "Save the field itself.")

    def _force(self, points: np.ndarray, frame: int) -> np.ndarray:
        return self.field.sample(points, max(frame - self.lead, 0))[0]

    def _gradient(self, points: np.ndarray, frame: int) -> np.ndarray:
        return self.field.gradient(points, max(frame - self.lead, 0))


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
    device: str

    def told(self) -> list[Any]:
        """What a journal is told of it, but for the field, which its stamp tells."""
        return [list(self.gravity), self.strength, *self.colliders, self.forces]


def continued(field: ForceField, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Force density (M, 3) [N/m³] and its gradient (M, 3, 3) [N/m⁴] at points (M, 3) [m]; beyond the box those of its nearest place."""
    nearest = np.clip(points, field.box[0], field.box[1])
    force, _ = field.sample(nearest, frame)
    return force, field.gradient(nearest, frame) * (nearest == points)[:, None, :]


def outside_note(x: np.ndarray, field: ForceField) -> list[str]:
    """A note if more than a tenth of a body was outside the field's box at some time. x (T+1, N, 3) [m]."""
    outside = ((x < field.box[0]) | (x > field.box[1])).any(axis=2).mean(axis=1)
    if outside.max() <= 0.1:
        return []
    first = int(np.argmax(outside > 0.1))
    share = 100 * outside.max()
    where = f"up to {share:.0f} % of it lies outside the field's box, first in frame {first}"
    return [f"{where}; the {field.kind} there is that of the box's edge"]
