"""Force prescribed at the nodes of the lattice: an acceleration that acts on all matter at a node, whatever particles it came from.

Added to the nodes' velocities between momentum / mass and the boundary conditions (the other way in, a force on particles before p2g, is
`rollout`'s `acceleration`). A uniform one is gravity; one that varies over a cell acts on the particles as `transfer`'s splines see it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UsageError

if TYPE_CHECKING:
    from .model import Model


@dataclass(frozen=True)
class GridForce:
    """Acceleration at a box of nodes; zero outside."""

    lo: np.ndarray
    """(3,) int32, first node of the box: it stands at the lattice's offset + dx lo."""
    acceleration: np.ndarray
    """(a, b, c, 3) held all the time, or (T, a, b, c, 3), one for each frame from the clip's first [m/s²]; the last frame's goes on."""

    @property
    def active(self) -> bool:
        """Whether anything is pushed."""
        return bool(self.acceleration.any())

    def at(self, frame: int) -> np.ndarray:
        """(a, b, c, 3) in a frame."""
        field = self.acceleration
        return field if field.ndim == 4 else field[min(max(frame, 0), len(field) - 1)]


NO_FORCE = GridForce(np.zeros(3, np.int32), np.zeros((1, 1, 1, 3)))
"""No force at any node."""


def with_grid_force(model: Model, low: np.ndarray, high: np.ndarray, field: Callable[[np.ndarray], np.ndarray]) -> Model:
    """The model with a force at all nodes of the lattice between the corners low and high (3,) [m].

    Args:
        field: from places (P, 3) [m] to accelerations (P, 3), or (T, P, 3) with one for each frame [m/s²].

    Raises:
        UsageError: the box has no node, or the field's shape is wrong or a value not finite.
    """
    first = np.ceil((np.asarray(low, float) - model.offset) / model.dx).astype(np.int32)
    count = np.floor((np.asarray(high, float) - model.offset) / model.dx).astype(np.int32) - first + 1
    if (count < 1).any():
        raise UsageError("No node of the grid lies in the box of the grid force.", f"Make it larger than a cell, {model.dx:.3g} m.")
    nodes = np.stack(np.meshgrid(*(np.arange(n) for n in count), indexing="ij"), axis=-1).reshape(-1, 3)
    found = np.asarray(field(model.offset + model.dx * (first + nodes)), dtype=np.float64)
    if found.ndim not in (2, 3) or found.shape[-2:] != nodes.shape:
        raise UsageError(f"The grid force has shape {found.shape}.", f"It must be ({len(nodes)}, 3), or (T, {len(nodes)}, 3).")
    if not np.isfinite(found).all():
        node = nodes[np.argwhere(~np.isfinite(found))[0, -2]]
        place = ", ".join(f"{c:.3g}" for c in model.offset + model.dx * (first + node))
        raise UsageError(f"The grid force at ({place}) m is not finite.", "Check the field that gives it.")
    return replace(model, grid_force=GridForce(first, found.reshape(*found.shape[:-2], *count, 3)))
