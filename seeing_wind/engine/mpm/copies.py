"""Several copies of one body, each under its own force, given by coefficients in a common basis."""

from __future__ import annotations

import numpy as np

from ..errors import SimulationError
from ..progress import Progress
from .body.copies_run import CopiesRun
from .checks import check_state
from .failure import diagnosis, failure
from .kernels.copies_forward import CODE, DONE, STATUS
from .kernels.substep import RUNNING
from .lattice.boundary import HELD
from .lattice.kinematics import conditions_for
from .model import Model
from .state import State

_GRID_NODES_AT_ONCE = 8_000_000
"""Nodes of all private grids together, at most: 256 MB."""


class Copies:
    """States of B copies of one body, advanced in place frame by frame."""

    def __init__(
        self, model: Model, phi: np.ndarray, dphi: np.ndarray, x: np.ndarray, v: np.ndarray, C: np.ndarray, F: np.ndarray
    ) -> None:
        """phi (N, P), dphi (N, P, 3) as in `rollout_batch`; x, v (B, N, 3) and C, F (B, N, 3, 3), which are changed in place: by `advance`,
        and at once by setting HELD particles to rest."""
        assert all(array.flags.c_contiguous for array in (x, v, C, F)), "arrays that are changed in place must be contiguous"
        self.run = CopiesRun(model)
        check_state(model.particles, model.offset, model.dx, x, v, C, F)
        self.run.make_room_for(x)
        v[:, model.role == HELD] = 0.0
        C[:, model.role == HELD] = 0.0
        self.model = model
        self.x, self.v, self.C, self.F = x, v, C, F
        active = self.run.packing.active
        self.phi, self.dphi = (np.ascontiguousarray(values[active], dtype=np.float64) for values in (phi, dphi))

    def advance(self, copies: np.ndarray, coefficients: np.ndarray, frame: int, progress: Progress) -> tuple[np.ndarray, np.ndarray]:
        """Advance the listed copies (A,) through frame `frame` under the force of `coefficients` (A, P, 3) [m/s²] and gravity.

        Copies that fail repeat the frame once with half the dt.

        Returns:
            substeps (A,) that the frame took, status (A, STATUS) of `copies_forward`.
        """
        before = [array[copies] for array in (self.x, self.v, self.C, self.F)]
        substeps = np.full(len(copies), self.model.substeps)
        status = self._frame(copies, coefficients, frame, self.model.substeps, progress)
        failed = np.flatnonzero(status[:, CODE] != RUNNING)
        if len(failed):
            for array, start in zip((self.x, self.v, self.C, self.F), before):
                array[copies[failed]] = start[failed]
            substeps[failed] *= 2
            status[failed] = self._frame(copies[failed], coefficients[failed], frame, 2 * self.model.substeps, progress)
        return substeps, status

    def failure(self, copy: int, status: np.ndarray, frame: int, substeps: int) -> SimulationError:
        """The error for a copy that failed in `advance`, from its status and the state in which it was left."""
        dt_over_dx = self.model.frame_dt / substeps / self.model.dx
        found = diagnosis(int(status[CODE]), dt_over_dx, self.x[copy], self.v[copy], self.F[copy])
        return failure((*found, int(status[DONE])), frame, substeps)

    def _frame(self, copies: np.ndarray, coefficients: np.ndarray, frame: int, substeps: int, progress: Progress) -> np.ndarray:
        """All substeps of a frame, for as many copies at a time as memory allows; returns status (A, STATUS)."""
        packing, offset = self.run.packing, self.model.offset
        conditions = conditions_for(self.model, frame, _all_of(self.x[copies], self.v[copies], self.C[copies], self.F[copies]))
        pieces = [packing.piece(c, packing.active, self.model.frame_dt / substeps) for c in conditions]
        everyone = _all_of(self.x, self.v, self.C, self.F)
        gravity = np.ascontiguousarray(np.broadcast_to(self.model.gravity_in(frame), (self.model.particles, 3))[packing.active])
        status = np.zeros((len(copies), STATUS), np.int32)
        first = 0
        while first < len(copies):
            some = copies[first : first + max(1, _GRID_NODES_AT_ONCE // self.run.capacity)]
            order = (some.astype(np.int32)[:, None] * np.int32(self.model.particles) + packing.active).reshape(-1)
            state = packing.packed(order, everyone, offset)
            given = np.ascontiguousarray(coefficients[first : first + len(some)], dtype=np.float64)
            force = packing.combined(self.phi, self.dphi, gravity, given, state)
            status[first : first + len(some)] = self.run.frame(state, force, len(some), pieces, substeps, progress)
            packing.write(order, state, offset, everyone)
            first += len(some)
        return status


def _all_of(x: np.ndarray, v: np.ndarray, C: np.ndarray, F: np.ndarray) -> State:
    """The particles of all copies, one copy after another, as views of the same memory."""
    return State(x.reshape(-1, 3), v.reshape(-1, 3), C.reshape(-1, 3, 3), F.reshape(-1, 3, 3))
