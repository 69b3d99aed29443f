"""Further forces on the bodies of an edit, in addition to the field: those of a scene's other force fields, sampled on a lattice.

A force field of Blender exerts the same force in newtons on a thing of any size. So a body of mass M accelerates by F(x) / M, as Blender's
own particle of that mass does, and each part of the body by the force at its own place. The force may depend on the velocity v, as drag
does: F(x, v) = F(x) + A(x) v - q(x) |v| v.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace

import numpy as np

from ...conventions import FARTHEST, frame_named
from ...errors import UsageError
from ...field.trilinear import value_at
from ...reading import read_arrays

STRONGEST = 1e9
"""Largest plausible coefficient [N, N s/m and N s²/m²]: more is a mistake."""


@dataclass(frozen=True)
class Push:
    """The further forces at P places."""

    force: np.ndarray
    """(P, 3) F, the force at rest [N]."""
    linear: np.ndarray | None
    """(P, 3, 3) A, the force per velocity [N s/m]."""
    quadratic: np.ndarray | None
    """(P,) q, the force against the velocity per squared speed [N s²/m²]."""

    def on(self, v: np.ndarray) -> np.ndarray:
        """Force (P, 3) [N] at velocities v (P, 3) [m/s]."""
        found = self.force
        if self.linear is not None:
            found = found + np.einsum("pij,pj->pi", self.linear, v)
        if self.quadratic is not None:
            found = found - (self.quadratic * np.linalg.norm(v, axis=1))[:, None] * v
        return found

    def damping(self, v: np.ndarray) -> np.ndarray:
        """Damping (P,) at velocities v (P, 3) [m/s]: mean force against a change of velocity, per change [N s/m]; 0 where negative."""
        against = np.zeros(len(v))
        if self.linear is not None:
            against -= np.trace(self.linear, axis1=1, axis2=2) / 3.0
        if self.quadratic is not None:
            against += self.quadratic * np.linalg.norm(v, axis=1)
        return np.maximum(against, 0.0)

    def acceleration(self, v: np.ndarray, mass: np.ndarray, duration: float) -> np.ndarray:
        """Acceleration (P, 3) [m/s²], constant over a `duration` [s], of parts of bodies with the total `mass` (P,) [kg], moving at
        v (P, 3) [m/s].

        It is that at the end of the duration (implicit Euler), so that drag never reverses a body and no magnet throws it out, however
        light it is.
        """
        if self.linear is None and self.quadratic is None:
            return self.force / mass[:, None]
        matrix = mass[:, None, None] * np.eye(3)
        if self.linear is not None:
            matrix = matrix - duration * self.linear
        if self.quadratic is not None:
            matrix = matrix + duration * (self.quadratic * np.linalg.norm(v, axis=1))[:, None, None] * np.eye(3)
        return np.linalg.solve(matrix, self.on(v)[..., None])[..., 0]


@dataclass(frozen=True)
class Forces:
    """Forces on lattices that fill a box; outside the box, those at its nearest place. Each array has its own number of nodes."""

    box: np.ndarray
    """(2, 3) lower and upper corner [m]."""
    force: np.ndarray
    """(T, A, B, C, 3) F [N]; row t acts from frame t to frame t + 1."""
    linear: np.ndarray | None = None
    """(T, A', B', C', 3, 3) A [N s/m]."""
    quadratic: np.ndarray | None = None
    """(T, A', B', C') q [N s²/m²]."""
    lead: int = 0
    """Frames before the clip, in which the first row acts."""

    def after(self, lead: int) -> Forces:
        """The same, with the clip beginning after `lead` frames."""
        return replace(self, lead=lead)

    def at(self, points: np.ndarray, frame: int) -> Push:
        """The forces at points (P, 3) [m] in a frame that counts from the first of the `lead` frames."""
        row = max(frame - self.lead, 0)
        linear, quadratic = (
            None if one is None else value_at(one[row], self.box, points) for one in (self.linear, self.quadratic)
        )  # fmt: skip
        return Push(value_at(self.force[row], self.box, points), linear, quadratic)

    def outside_note(self, x: np.ndarray) -> list[str]:
        """A note if more than a tenth of a body left the box; x: (T+1, N, 3) path of the body [m]."""
        outside = ((x < self.box[0]) | (x > self.box[1])).any(axis=2).mean(axis=1)
        if outside.max() <= 0.1:
            return []
        first = frame_named(int(np.argmax(outside > 0.1)))
        return [f"it leaves the box of the further forces in {first}; outside, those at the box's edge act"]


def read_forces(path: str | os.PathLike[str], frames: int) -> Forces:
    """The forces in an NPZ file, for a field of `frames` frames: arrays as in `Forces`, with `linear` and `quadratic` optional.

    Raises:
        UsageError: for a missing file, or arrays that do not fit each other or the field, or are not finite.
    """
    advice = f"It needs box (2,3) m and force ({frames},A,B,C,3) N, two nodes or more along each side."
    try:
        arrays = read_arrays(path, ("box", "force", "linear", "quadratic"))
    except (OSError, ValueError) as error:
        raise UsageError(f"The forces {path} cannot be read: {getattr(error, 'strerror', None) or error}.", advice) from error
    box, force = arrays.get("box"), arrays.get("force")
    if box is None or force is None:
        raise UsageError(f"The forces {path} hold {', '.join(arrays) or 'nothing'}.", advice)
    inner = {"force": (3,), "linear": (3, 3), "quadratic": ()}
    for name, array in arrays.items():
        counts = array.shape[1:4]
        shape = (2, 3) if name == "box" else (frames, *counts, *inner[name])
        few = name != "box" and (len(counts) != 3 or min(counts) < 2)
        if array.shape != shape or few or not np.issubdtype(array.dtype, np.floating):
            raise UsageError(f"In the forces {path}, {name} is {array.dtype} of shape {array.shape}.", advice)
        most = FARTHEST if name == "box" else STRONGEST
        wild = ~(np.abs(array) <= most)
        if wild.any():
            at = tuple(np.argwhere(wild)[0].tolist())
            what = f"In the forces {path}, {name}[{', '.join(map(str, at))}] is {array[at]:g}."
            raise UsageError(what, f"Check strengths and unit: numbers are finite, and at most {most:g}.")
    if (box[1] <= box[0]).any():
        raise UsageError(f"The box of the forces {path} is {box.tolist()}.", "Give two corners in metres, the lower one first.")
    return Forces(box.astype(np.float64), force, arrays.get("linear"), arrays.get("quadratic"))
