"""What solvers feel of a field object at some places, and the truth beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np

Flow = Callable[[np.ndarray, float], np.ndarray]
"""Force densities (P, 3) [N/m³] at places (P, 3) [m] of the box, where the field object was made, in a frame."""


@dataclass(frozen=True)
class Felt:
    """In the world, wherever the field object now stands."""

    at: np.ndarray
    """(P, 3) [m]."""
    force: np.ndarray
    """(P, 3) [N/m³]: acceleration times density."""
    blind: np.ndarray | None = None
    """(P, 3) unit vectors along which the solver cannot follow: there, only forces that are strong across them are compared."""

    def beside(self, field: bpy.types.Object, centre: np.ndarray, flow: Flow, interval: int) -> tuple[np.ndarray, np.ndarray]:
        """The force that was felt and that of the flow, both (N, 3); `centre` [m] is where the field object was made."""
        moved = np.array(field.matrix_world)
        found, truth = self.force, flow((self.at - moved[:3, 3]) @ moved[:3, :3] + centre, interval) @ moved[:3, :3].T
        if self.blind is None:
            return found, truth
        found, truth = (each - (each * self.blind).sum(1, keepdims=True) * self.blind for each in (found, truth))
        size = np.linalg.norm(truth, axis=1)
        clear = size > 0.3 * size.max()
        return found[clear], truth[clear]
