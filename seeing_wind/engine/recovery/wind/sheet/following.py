"""A simulation of the sheet that follows the observed one: in addition to its load, every vertex is pulled softly to where it was seen.

    a = w² (x_seen - x) + 2 w (v_seen - v)        w = `PULL`, critically damped

Without the pull, the simulation of a flapping sheet diverges from the observed one within a few frames even in the true field: small
differences grow from fold to fold. With the pull it stays close, as an observer with a fixed gain does (Ljung 1999, System Identification,
section 7.2); a constant error a in the acceleration displaces it by a / w². The take's trajectory is this simulation in the field that was
found from the balance of forces (`balance`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....errors import SimulationError
from ....mpm.shell import Load, Shell, State, advance
from ....mpm.shell.model import with_past
from .air import Cause
from .observed import Observed

PULL = 30.0
"""Strength w of the pull [1/s]."""
LONGEST = 0.008
"""Longest substep [s]."""


def substeps_for(fps: float) -> int:
    """Number of substeps per frame."""
    return max(2, math.ceil(1.0 / (fps * LONGEST)))


@dataclass(frozen=True)
class Follower:
    """The simulation; `cause` is the law by which a field loads the sheet."""

    shell: Shell
    seen: Observed
    gravity: np.ndarray
    """(3,) [m/s²]."""
    cause: Cause
    pull: float = PULL

    @property
    def dt(self) -> float:
        """Duration of a substep [s]."""
        return 1.0 / (self.seen.fps * substeps_for(self.seen.fps))

    def start(self) -> State:
        """The initial state: the shape at rest, with the observed velocities."""
        v = np.where(self.shell.pinned[:, None], 0.0, self.seen.at(0.0)[1])
        return with_past(self.seen.rest, v, np.zeros_like(v), self.dt)

    def path(self, fields: np.ndarray, check: Callable[[], None] = lambda: None) -> np.ndarray:
        """Simulated positions (T+1, V, 3) [m] in the fields (T, V, 3), one for each interval.

        Raises:
            SimulationError: when the simulation breaks down.
        """
        state, path = self.start(), []
        path.append(state.x)
        for frame, field in enumerate(fields):
            check()
            for substep in range(substeps_for(self.seen.fps)):
                state = self._after(state, field, frame, substep)
            path.append(state.x)
        return np.stack(path)

    def _after(self, state: State, field: np.ndarray, frame: int, substep: int) -> State:
        load, pins = self._around(field, frame, substep)
        try:
            return advance(self.shell, state, dt=self.dt, gravity=self.gravity, frame=frame, load=load, pins=pins)[0]
        except SimulationError as error:
            raise SimulationError(error.message, error.hint, frame=frame, substep=substep, quantity=error.quantity) from error

    def _around(self, field: np.ndarray, frame: int, substep: int) -> tuple[Load, np.ndarray]:
        """The load of a substep, and where the pinned vertices are at its end."""
        share = (substep + 1) / substeps_for(self.seen.fps)
        x_seen, v_seen = self.seen.at(frame + share)
        cause, mass = self.cause.load(field), self.shell.mass
        # Implicit: the pull acts on the position and velocity at the end of the substep.
        soft, firm = self.pull**2 * mass[:, None], 2.0 * self.pull * mass[:, None]
        damping = (firm + self.dt * soft)[..., None] * np.eye(3)

        def load(x: np.ndarray, v: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
            force, drag = cause(x, v, frame)
            pull = soft * (x_seen - x - self.dt * v) + firm * (v_seen - v)
            return force + pull, damping if drag is None else drag + damping

        pins = self.seen.pins
        return load, (1.0 - share) * pins[frame] + share * pins[frame + 1]
