"""A simulation of the sheet that follows what was seen: beside its load, every vertex is drawn to where it was seen, softly.

    a = w² (x_seen - x) + 2 w (v_seen - v)        w = `PULL`, critically damped

Without this, a sheet that flaps is lost within a few frames, whatever moves it: small differences grow from fold to fold. With it the
simulation stays near and forgets its past in about 3 / w. What it is then off tells of what the load lacks: a constant lack of
acceleration a puts it off by a / w². So the problem is one of prediction errors, as of an observer with a fixed gain (Ljung 1999, System
Identification, section 7.2), not one of initial values, and a whole clip is one problem.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array

from ....errors import SimulationError
from ....mpm.shell import Load, Shell, State, advance
from ....mpm.shell.model import with_past
from ....mpm.shell.tangent import Change, FaceSlopes, LoadSlopes, tangent_of
from .air import Cause
from .observed import Observed

PULL = 30.0
"""1/s."""
FORGOTTEN = 3.0
"""Times 1 / w after which nothing is left of a change."""
LONGEST = 0.008
"""s of a substep at most."""


def substeps_for(fps: float) -> int:
    """Substeps a frame."""
    return max(2, math.ceil(1.0 / (fps * LONGEST)))


@dataclass(frozen=True)
class Follower:
    """The simulation; `cause` says what its field does."""

    shell: Shell
    seen: Observed
    gravity: np.ndarray
    """(3,) [m/s²]."""
    cause: Cause
    slopes: FaceSlopes
    pull: float = PULL

    @property
    def dt(self) -> float:
        """s of a substep."""
        return 1.0 / (self.seen.fps * substeps_for(self.seen.fps))

    def start(self) -> State:
        """The shape at rest, moving as seen."""
        v = np.where(self.shell.pinned[:, None], 0.0, self.seen.at(0.0)[1])
        return with_past(self.seen.rest, v, np.zeros_like(v), self.dt)

    def path(self, fields: np.ndarray, check: Callable[[], None] = lambda: None) -> np.ndarray:
        """Places (T+1, V, 3) [m] in fields (T, V, 3), one for each frame.

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
        # Implicit: drawn by where the vertex gets with its velocity at the end.
        soft, firm = self.pull**2 * mass[:, None], 2.0 * self.pull * mass[:, None]
        damping = (firm + self.dt * soft)[..., None] * np.eye(3)

        def load(x: np.ndarray, v: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
            force, drag = cause(x, v, frame)
            drawn = soft * (x_seen - x - self.dt * v) + firm * (v_seen - v)
            return force + drawn, damping if drag is None else drag + damping

        pins = self.seen.pins
        return load, (1.0 - share) * pins[frame] + share * pins[frame + 1]

    def linearised(
        self, fields: np.ndarray, shapes: np.ndarray, hats: np.ndarray, seen_as: Callable[[np.ndarray, int], np.ndarray],
        check: Callable[[], None] = lambda: None,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Places (T+1, V, 3) [m], and the derivative (K, P, 3, T, D) of what is seen of them by the coefficients of the fields.

        Args:
            shapes: (V, P) modes of the field over the sheet; hats: (T, K) of its knots.
            seen_as: places' derivatives (V, 3, R) at the end of a frame -> (D, R).
        """
        count, modes = hats.shape[1], shapes.shape[1]
        width = 3 * modes
        spread = csr_array(np.kron(shapes, np.eye(3)))  # (3 V, 3 P): coefficients -> field
        slow = math.ceil(FORGOTTEN / self.pull * self.seen.fps)
        state, path = self.start(), []
        path.append(state.x)
        active: list[int] = []
        change = Change.none(len(state.x), 0)
        found: np.ndarray | None = None
        drawn = csr_array(diags_array(np.repeat(self.pull**2 * self.shell.mass, 3)))
        for frame, field in enumerate(fields):
            now = [k for k in range(count) if hats[max(0, frame - slow) : frame + 1, k].any()]
            change = _renewed(change, active, now, width)
            active, weight = now, hats[frame, now]
            for substep in range(substeps_for(self.seen.fps)):
                check()
                after = self._after(state, field, frame, substep)
                own, by_field = self.cause.slopes(field, state, after)
                both = LoadSlopes(csr_array(own.x - drawn), own.v)
                load = self._around(field, frame, substep)[0]
                tangent = tangent_of(
                    self.shell, self.slopes, state, after, dt=self.dt, gravity=self.gravity, frame=frame, load=load, load_slopes=both
                )
                direct = (by_field @ spread).toarray()
                loads = (direct[:, None, :] * weight[:, None]).reshape(len(state.x), 3, -1)
                change = tangent.carried(change, loads)
                state = after
            path.append(state.x)
            rows = seen_as(change.x, frame)
            if found is None:
                found = np.zeros((count, width, len(fields), len(rows)))
            found[now, :, frame] = rows.T.reshape(len(now), width, -1)
        assert found is not None
        return np.stack(path), found.reshape(count, modes, 3, len(fields), -1)


def _renewed(change: Change, before: list[int], now: list[int], width: int) -> Change:
    """The directions of the knots `now`, in order, those that were not there before without change."""
    if before == now:
        return change
    kept = [(before.index(k) if k in before else -1) for k in now]

    def chosen(part: np.ndarray) -> np.ndarray:
        shape = part.shape[:2]
        return np.concatenate([part[..., k * width : (k + 1) * width] if k >= 0 else np.zeros((*shape, width)) for k in kept], axis=2)

    return Change(*(chosen(part) for part in (change.x, change.v, change.x_before, change.v_before)))
