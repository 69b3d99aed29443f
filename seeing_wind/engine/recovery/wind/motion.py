"""Bodies in a wind: their drag from their own surface, speed and attitude, renewed several times in a frame.

A light body reaches the wind's speed within a frame, and one that flutters turns in it, so a force held over a whole frame would carry it
past the wind. A frame is cut into parts, in each of which a piece of surface loses only a little of its velocity relative to the air.
What it loses in a part is that of the implicit step of `drag`: D w becomes D w' with w' = (1 + dt D / m)^-1 (w - dt g), m the mass behind
the piece and g gravity, so that a body of any weight ends the part slower than the air, and one that sinks steadily goes on to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...mpm.model import Model
from ...mpm.rollout import advance
from ...mpm.state import State
from .drag import AIR, TINY, face_damping
from .surface import BodySurface

LOST = 0.25
"""Share of the velocity relative to the air that a body may lose in a part of a frame, and radians that it may turn."""
MOST_PARTS = 24
"""Of a frame."""


@dataclass(frozen=True)
class Sail:
    """A body of a simulation as the air sees it."""

    surface: BodySurface
    rows: slice
    """Its particles in the model."""

    def drag(self, model: Model, state: State, wind: Callable[[np.ndarray], np.ndarray], dt: float) -> np.ndarray:
        """Force of the air on its particles (N, 3) [N], as it acts over a time dt [s]."""
        x, v, F = state.x[self.rows], state.v[self.rows], state.F[self.rows]
        normals = self.surface.normals(x, F)
        relative = wind(self.surface.attachment.follow(x)) - self.surface.attachment.follow(v)
        damping = face_damping(relative, normals, closed=self.surface.closed)
        behind = self._mass_per_area(model, normals) * np.linalg.norm(normals, axis=1) + TINY
        felt = np.eye(3) + dt * damping / behind[:, None, None]
        after = np.linalg.solve(felt, (relative - dt * model.gravity)[..., None])
        return self.surface.spread((damping @ after)[..., 0], len(x))

    def haste(self, model: Model, state: State, wind: Callable[[np.ndarray], np.ndarray]) -> float:
        """How fast its velocity relative to the air changes, relative to that velocity, or its attitude does [1/s]."""
        x = state.x[self.rows]
        relative = wind(x) - state.v[self.rows]
        normals = self.surface.normals(x, state.F[self.rows])
        C = state.C[self.rows].mean(axis=0)
        rate = 0.5 * AIR.density * AIR.normal * float(np.linalg.norm(relative, axis=1).max()) / self._mass_per_area(model, normals)
        return max(rate, float(np.linalg.norm(C - C.T)) / math.sqrt(2.0))

    def _mass_per_area(self, model: Model, normals: np.ndarray) -> float:
        """Mass [kg] over the area [m²] of one side: half the surface of a closed body."""
        area = float(np.linalg.norm(normals, axis=1).sum()) * (0.5 if self.surface.closed else 1.0)
        return float(model.mass[self.rows].sum()) / max(area, TINY)


def advance_in_wind(
    model: Model,
    state: State,
    wind: Callable[[np.ndarray], np.ndarray],
    sails: Sequence[Sail],
    frame: int,
    further: Callable[[State, np.ndarray, float], np.ndarray],
) -> State:
    """One frame of bodies in a wind.

    Args:
        wind: places (P, 3) [m] -> velocity of the air there (P, 3) [m/s] in this frame.
        further: state, acceleration by the air (N, 3) [m/s²] and duration [s] -> acceleration with everything else that is no gravity.

    Raises:
        SimulationError: as `mpm.rollout`.
    """

    haste = max(sail.haste(model, state, wind) for sail in sails)
    parts = min(max(1, math.ceil(haste * model.frame_dt / LOST)), MOST_PARTS)
    dt = model.frame_dt / parts
    for part in range(parts):
        acceleration = np.zeros_like(state.x)
        for sail in sails:
            acceleration[sail.rows] = sail.drag(model, state, wind, dt) / model.mass[sail.rows, None]
        share = replace(model, frame_dt=dt, substeps=math.ceil(model.substeps / parts), part=(part, parts))
        state = advance(share, state, further(state, acceleration, dt), frame=frame)
    return state
