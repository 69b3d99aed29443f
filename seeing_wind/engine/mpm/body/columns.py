"""Small changes of one body's state ("columns"), carried together as the lanes of vectors, and the mixtures that are wanted of them.

A direction is a change of the force, or of the start, whose effect is wanted. Many more directions are wanted than the body responds to in
different ways: after a few frames, hundreds of changes of an elastic body's force lie within some tens of dimensions of its state. So the
columns are a basis of the directions' states, found by a singular value decomposition that leaves out what hardly moves the body, and each
direction is a mixture (linear combination) of columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..kernels.carry import STATE
from ..kernels.native import aligned_copy, aligned_zeros

LEAST = 1e-5
"""Singular values below this share of the largest are dropped: an error of a hundredth of a millimetre in a motion of a metre."""


WORTH = 0.7
"""Mixtures are carried once there are fewer of them than this share of the directions; otherwise mixing costs more than it saves."""
VELOCITY, SPIN, PLACE = slice(0, 3), slice(3, 12), slice(21, 24)
"""Parts of a state: the changes of the velocity, of its gradient, and of the position."""


class Columns:
    """The columns of one body, between frames."""

    def __init__(self, directions: int, particles: int, width: int, start: Sequence[tuple[slice, np.ndarray]] = ()) -> None:
        """start: parts of the state, and the change (B, M, ...) that the `directions` make in each of them when they begin."""
        self.width, self.particles, self.start = width, particles, start
        self.lanes = aligned_zeros((0, particles, STATE, width), np.float32)
        """(groups, M, STATE, width) states of the columns; unused lanes of the last group are zero."""
        self.mix = np.zeros((directions, 0))
        """(B, columns) each direction as a mixture of columns."""
        self.mixed = False
        """Whether the columns are mixtures, no longer single directions."""
        self.tried = 0
        """How many columns there were at the last unsuccessful attempt to reduce them."""
        self.begun = np.zeros(directions, bool)
        """(B,) whether a direction has changed anything yet."""
        for _, values in start:
            self.begun |= (values != 0.0).reshape(directions, -1).any(axis=1)

    def prepare_frame(self, given: np.ndarray, frame_dt: float) -> np.ndarray:
        """Prepare the columns for a frame in which each direction changes the force's coefficients by `given` (B, C).

        As long as there are few directions, each has its own column. Later their states are reduced to as few columns as possible, and each
        coefficient that changes in this frame gets one more column.

        Args:
            frame_dt: the frame's length [s].

        Returns:
            (columns, C) the change of the coefficients in this frame for each column.
        """
        self.begun |= given.any(axis=1)
        acting, begun = np.flatnonzero(given.any(axis=0)), np.flatnonzero(self.begun)
        if self.count and (self.mixed or len(begun) > max(2 * len(acting), 1.5 * self.tried)):
            fewer, mix = self._fewer(frame_dt)
            if self.mixed or fewer.shape[1] + len(acting) < WORTH * len(begun):
                self._replace(fewer, mix)
                self.mixed = True
            else:
                self.tried = self.count
        if self.mixed:
            self._append(given[:, acting])
            force = np.zeros((self.count, given.shape[1]))
            force[self.count - len(acting) + np.arange(len(acting)), acting] = 1.0
            return force
        own = self.mix.argmax(axis=0) if self.count else np.zeros(0, int)
        new = np.setdiff1d(begun, own)
        self._append(np.eye(len(given))[:, new])
        if len(new) and not len(own):
            self._begin(new)
        return given[np.concatenate([own, new])]

    def state(self) -> dict[str, np.ndarray]:
        """Everything that later frames depend on, for `resume`."""
        return {"lanes": self.lanes, "mix": self.mix, "mixed": np.array(self.mixed), "begun": self.begun, "tried": np.array(self.tried)}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Restore what `state` of other columns returned, to continue as they would have."""
        self.lanes, self.mix = aligned_copy(state["lanes"]), state["mix"]
        self.mixed, self.begun, self.tried = bool(state["mixed"]), state["begun"], int(state["tried"])

    @property
    def count(self) -> int:
        """Number of columns."""
        return self.mix.shape[1]

    def states(self, part: slice = slice(None)) -> np.ndarray:
        """(columns, M, ...) float32: the numbers `part` of the columns' states."""
        apart = self.lanes[:, :, part].transpose(0, 3, 1, 2)
        return apart.reshape(-1, *apart.shape[2:])[: self.count]

    def _append(self, mix: np.ndarray) -> None:
        """Append columns with no change so far; `mix` (B, new) is their weight in each direction."""
        groups = -(-(self.count + mix.shape[1]) // self.width)
        lanes = aligned_zeros((groups, *self.lanes.shape[1:]), np.float32)
        lanes[: len(self.lanes)] = self.lanes
        self.lanes, self.mix = lanes, np.concatenate([self.mix, mix], axis=1)

    def _fewer(self, frame_dt: float) -> tuple[np.ndarray, np.ndarray]:
        """The fewest columns that reproduce the directions' positions and what their velocities add in a frame, to within `LEAST`.

        Returns:
            (columns, fewer) the new columns as mixtures of the present ones, and (B, fewer) the directions as mixtures of the new columns.
        """
        orthonormal, weight = np.linalg.qr(self.mix)
        motions = np.stack([self.states(PLACE), np.float32(frame_dt) * self.states(VELOCITY)]).astype(np.float64)
        motions = motions.swapaxes(0, 1).reshape(self.count, -1)
        power, modes = np.linalg.eigh(weight @ (motions @ motions.T) @ weight.T)  # squares of the singular values, ascending
        modes = modes[:, power > LEAST**2 * power[-1]]
        return weight.T @ modes, orthonormal @ modes

    def _replace(self, by: np.ndarray, mix: np.ndarray) -> None:
        """Replace the columns by the mixtures that `_fewer` returned."""
        states = (by.T.astype(np.float32) @ self.states().reshape(self.count, -1)).reshape(-1, self.particles, STATE)
        self.lanes, self.mix = aligned_copy(self._in_lanes(states)), mix

    def _begin(self, new: np.ndarray) -> None:
        """Give the first columns, which are those of the directions `new`, their change of the start; later columns have none."""
        for part, values in self.start:
            self.lanes[:, :, part] = self._in_lanes(values[new].reshape(len(new), self.particles, -1))

    def _in_lanes(self, states: np.ndarray) -> np.ndarray:
        """(columns, M, K) -> (groups, M, K, width); unused lanes of the last group are zero."""
        groups = -(-len(states) // self.width)
        padded = np.zeros((groups * self.width, *states.shape[1:]), np.float32)
        padded[: len(states)] = states
        return padded.reshape(groups, self.width, *states.shape[1:]).transpose(0, 2, 3, 1)
