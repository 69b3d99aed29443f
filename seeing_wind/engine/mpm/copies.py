"""Several copies of one body, each under a force of its own."""

from __future__ import annotations

import numpy as np

from ..errors import SimulationError
from ..progress import Progress
from .body import Body
from .checks import check_state
from .compiler import device
from .failure import diagnosis, failure
from .kernels import substep
from .lattice.boundary import HELD
from .model import MOST_NODES, Model
from .state import State

_WORK_PER_CALL = 2_000_000
"""Particle-substeps between two safe points: a quarter of a second on one core, a second on a crowded one."""
_GRID_NODES_AT_ONCE = 8_000_000
"""Nodes of all private grids together: 256 MB."""


class Copies:
    """States of B copies of one body, advanced in place frame by frame."""

    def __init__(self, model: Model, x: np.ndarray, v: np.ndarray, C: np.ndarray, F: np.ndarray) -> None:
        """x, v (B, N, 3); C, F (B, N, 3, 3). The arrays are changed: now and by `advance`. Held particles start at rest."""
        assert model.axes is None, "give Model.upright"
        device.start(model.device)
        check_state(model.particles, model.offset, model.dx, x, v, C, F)
        v[:, model.role == HELD] = 0.0
        C[:, model.role == HELD] = 0.0
        self.model = model
        self.x, self.v, self.C, self.F = x, v, C, F
        self.acceleration = np.zeros_like(x)
        self.gradient = np.zeros_like(F)
        self.capacity = 0

    def advance(self, copies: np.ndarray, frame: int, progress: Progress) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Frame number `frame` of the copies listed (A,) under `acceleration` (gravity included) and `gradient`.

        Copies that fail start the frame once more with half the dt.

        Returns:
            substeps (A,) that the frame took, code (A,) of `substep` (RUNNING is success), status (A, 4) for `failure`.
        """
        before = [array[copies] for array in (self.x, self.v, self.C, self.F)]
        substeps = np.full(len(copies), self.model.substeps)
        status = self._run(copies, self.model.substeps, progress)
        failed = np.flatnonzero(status[:, 0] != substep.RUNNING)
        if len(failed):
            for array, start in zip((self.x, self.v, self.C, self.F), before):
                array[copies[failed]] = start[failed]
            substeps[failed] *= 2
            status[failed] = self._run(copies[failed], 2 * self.model.substeps, progress)
        return substeps, status[:, 0], status

    def failure(self, copy: int, status: np.ndarray, frame: int, substeps: int) -> SimulationError:
        """The error for a copy that `advance` could not bring through a frame, from its status (4,) and what the frame left of it."""
        dt_over_dx = self.model.frame_dt / substeps / self.model.dx
        found = diagnosis(int(status[0]), dt_over_dx, self.x[copy], self.v[copy], self.F[copy])
        return failure((*found, int(status[2])), frame, substeps)

    def _run(self, copies: np.ndarray, substeps: int, progress: Progress) -> np.ndarray:
        """All substeps of a frame in calls short enough to be cancelled between; returns status (A, 4)."""
        status = np.zeros((len(self.x), 4), np.int32)
        todo = np.asarray(copies, dtype=np.int32)
        stride = max(1, min(substeps, _WORK_PER_CALL // self.model.particles))
        while len(todo):
            rows = max(1, min(len(todo), _WORK_PER_CALL // (self.model.particles * stride), _GRID_NODES_AT_ONCE // max(self.capacity, 1)))
            for first in range(0, len(todo), rows):
                some = np.ascontiguousarray(todo[first : first + rows])
                progress.check()
                self._launch(some, substeps, min(substeps, int(status[some, 2].min()) + stride), status)
            full = todo[status[todo, 0] == substep.GRID_FULL]
            burst = status[full, 3] > MOST_NODES
            status[full[burst], 0] = substep.BURST
            full = full[~burst]
            if len(full):
                self._grow(status[full])
                status[full, 0] = substep.RUNNING
            todo = todo[(status[todo, 0] == substep.RUNNING) & (status[todo, 2] < substeps)]
        return status[copies]

    def _grow(self, status: np.ndarray) -> None:
        wanted = int(status[:, 3].max())
        # A third more than asked, so that a body that turns does not ask again at every substep.
        self.capacity = wanted + wanted // 3

    def _launch(self, copies: np.ndarray, substeps: int, until: int, status: np.ndarray) -> None:
        m = self.model
        if not self.capacity:
            extent = np.ceil(np.ptp(self.x, axis=1).max(axis=0) / m.dx) + 4
            self.capacity = int(min(np.prod(extent) * 1.5, MOST_NODES))
        grid = np.empty((len(copies), self.capacity, 4))
        substep.run_substeps(
            m.plastic, m.mass, m.volume, m.mu, m.lam, m.yield_stress, m.viscosity, m.law, m.role,
            m.clamp_lo, m.clamp, m.offset, m.dx, m.frame_dt / substeps,
            copies, until, self.acceleration, self.gradient, self.x, self.v, self.C, self.F, grid, status,
        )  # fmt: skip


class CopiesInTurn(Copies):
    """The same for models with colliders or moving pins: one copy after the other, each on as many cores as it is worth."""

    def failure(self, copy: int, status: np.ndarray, frame: int, substeps: int) -> SimulationError:
        """As `Copies.failure`; here a copy that failed is left as it was."""
        return failure(status, frame, substeps)

    def advance(self, copies: np.ndarray, frame: int, progress: Progress) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `Copies.advance`."""
        body = Body(self.model)
        substeps, status = np.zeros(len(copies), int), np.zeros((len(copies), 4), np.int32)
        for row, b in enumerate(copies):
            state = State(self.x[b], self.v[b], self.C[b], self.F[b])
            after, run, status[row, :3] = body.attempt(state, self.acceleration[b], self.gradient[b], frame, progress)
            substeps[row] = run.substeps
            if after is not None:
                self.x[b], self.v[b], self.C[b], self.F[b] = after.x, after.v, after.C, after.F
        return substeps, status[:, 0], status


def conditioned(model: Model) -> bool:
    """Whether more holds at the nodes than pins that stand still: `Body` knows of it, `Copies` does not."""
    return bool(model.movers) or model.pin_path is not None or model.collider_grid.active or model.grid_force.active
