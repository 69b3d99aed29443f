"""Simulating bodies in a wind: drag depends on each body's surface, velocity and attitude, and is renewed several times per frame.

A light body reaches the wind's speed within a frame, and a fluttering one turns within a frame, so a force held over the whole frame would
make it overtake the wind. Each frame is therefore cut into parts in which the velocity relative to the air changes only a little. In each
part the force is that of the implicit step of `drag`: D w' instead of D w, with w' = (1 + dt D / m)^-1 (w - dt g), where m is the mass
behind the piece and g the acceleration by gravity and force fields. A body of any weight then ends the part slower than the air, and one at
terminal velocity keeps it.
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
"""In one part of a frame a body may lose this share of its velocity relative to the air, and turn by this angle [rad]."""
MOST_PARTS = 24
"""Most parts per frame."""


@dataclass(frozen=True)
class Sail:
    """A simulated body with the surface on which the air acts."""

    surface: BodySurface
    rows: slice
    """The body's particles in the model."""
    heaviness: np.ndarray | None = None
    """(E,) density of the matter behind each piece in units of the body's mean; None is one everywhere."""

    def drag(self, model: Model, state: State, wind: Callable[[np.ndarray], np.ndarray], pushed: np.ndarray, dt: float) -> np.ndarray:
        """Force of the air on the body's particles (N, 3) [N], implicit over a time dt [s] in which force fields accelerate the model's
        particles by `pushed` (M, 3) [m/s²]."""
        x, v, F = state.x[self.rows], state.v[self.rows], state.F[self.rows]
        normals = self.surface.normals(x, F)
        relative = wind(self.surface.attachment.follow(x)) - self.surface.attachment.follow(v)
        damping = face_damping(relative, normals, closed=self.surface.closed)
        behind = self._mass_per_area(model, normals) * np.linalg.norm(normals, axis=1) + TINY
        behind = behind if self.heaviness is None else behind * self.heaviness
        felt = np.eye(3) + dt * damping / behind[:, None, None]
        drawn = model.gravity + self.surface.attachment.follow(pushed[self.rows])
        after = np.linalg.solve(felt, (relative - dt * drawn)[..., None])
        return self.surface.spread((damping @ after)[..., 0], len(x))

    def haste(self, model: Model, state: State, wind: Callable[[np.ndarray], np.ndarray]) -> float:
        """The larger of two rates [1/s]: relative change of the velocity relative to the air, and rotation of the body."""
        x = state.x[self.rows]
        relative = wind(x) - state.v[self.rows]
        normals = self.surface.normals(x, state.F[self.rows])
        C = state.C[self.rows].mean(axis=0)
        rate = 0.5 * AIR.density * AIR.normal * float(np.linalg.norm(relative, axis=1).max()) / self._mass_per_area(model, normals)
        return max(rate, float(np.linalg.norm(C - C.T)) / math.sqrt(2.0))

    def _mass_per_area(self, model: Model, normals: np.ndarray) -> float:
        """The body's mass over the area of one side, which is half the surface of a closed body [kg/m²]."""
        area = float(np.linalg.norm(normals, axis=1).sum()) * (0.5 if self.surface.closed else 1.0)
        return float(model.mass[self.rows].sum()) / max(area, TINY)


def advance_in_wind(
    model: Model,
    state: State,
    wind: Callable[[np.ndarray], np.ndarray],
    sails: Sequence[Sail],
    frame: int,
    push: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray | None]],
    further: Callable[[State, np.ndarray, float], np.ndarray],
) -> State:
    """Advance bodies in a wind by one frame.

    Args:
        wind: places (P, 3) [m] -> velocity of the air there (P, 3) [m/s] in this frame.
        push: places (N, 3) [m] of the particles -> their acceleration by force fields (N, 3) [m/s²], and its gradient (N, 3, 3) [1/s²]
            or None.
        further: function of state, acceleration by air and force fields (N, 3) [m/s²] and duration [s]; it returns the acceleration with
            all other effects but gravity added.

    Raises:
        SimulationError: as in `mpm.rollout`.
    """

    haste = max(sail.haste(model, state, wind) for sail in sails)
    parts = min(max(1, math.ceil(haste * model.frame_dt / LOST)), MOST_PARTS)
    dt = model.frame_dt / parts
    for part in range(parts):
        pushed, gradient = push(state.x)
        acceleration = pushed.copy()
        for sail in sails:
            acceleration[sail.rows] += sail.drag(model, state, wind, pushed, dt) / model.mass[sail.rows, None]
        share = replace(model, frame_dt=dt, substeps=math.ceil(model.substeps / parts), part=(part, parts))
        state = advance(share, state, further(state, acceleration, dt), gradient, frame=frame)
    return state
