"""How a field behaves away from the filmed object, and outside the box in which it is known.

The rule is the same in the texture that solvers feel, in *Sample Wind*, in VDB files and in a re-simulation (the engine's `Reach`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FADE, HOLD, CONTINUE = "FADE", "HOLD", "CONTINUE"
"""FADE: the field fades to zero, with the distance from the object and again with that from the box. HOLD: it is whole in the box, and
outside has the value of the nearest place in it. CONTINUE: like HOLD, but weaker with distance, never zero."""

FADE_WIDTH = 0.75
"""Distance over which the field fades, relative to the box's longest side."""

POWERS = (0.05, 10.0)
"""Limits of the falloff's power for a field that continues; Blender's slider ends at 10."""


@dataclass(frozen=True)
class Reach:
    """How a field with a box of a given size ends. Lengths in scene units."""

    kind: str
    width: float
    """Distance over which a field that fades does so."""
    radius: float
    """Half the box's longest side."""
    power: float
    """A field that continues has the share ((1 + radius) / (1 + radius + distance)) ** power of its strength."""


def reach_of(kind: str, box: np.ndarray) -> Reach:
    """How the field of a box (2, 3) ends. The power is 0.5 at a radius of 1 unit, and grows as the box shrinks."""
    side = float(np.ptp(box, axis=0).max())
    return Reach(kind, FADE_WIDTH * side, 0.5 * side, float(np.clip(1.0 / max(side, 1e-9), *POWERS)))


def left_of(reach: Reach, distance: np.ndarray) -> np.ndarray:
    """Share of the field that is left at distances from the box: 1 at its faces."""
    if reach.kind == HOLD:
        return np.ones_like(distance)
    if reach.kind == CONTINUE:
        near = 1.0 + reach.radius
        return (near / (near + distance)) ** reach.power
    t = np.clip(distance / reach.width, 0.0, 1.0)
    return 1.0 - t * t * (3.0 - 2.0 * t)


def left_near(reach: Reach, distance: np.ndarray) -> np.ndarray:
    """Share of the field that is left in its box, at distances from the filmed object in that frame."""
    return left_of(reach, distance) if reach.kind == FADE else np.ones_like(distance)


def beside(box: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Distance of places (P, 3) from a box (2, 3): (P,), 0 inside."""
    return np.linalg.norm(np.maximum(np.maximum(box[0] - places, places - box[1]), 0.0), axis=-1)
