"""A body's particles in the layout of the kernels, and back: sorted by cell, divided into tasks, in rows of one precision.

Positions are stored relative to the lattice, so that single precision loses no digits to a large offset.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from ..compiler import device
from ..compiler.launch import Launcher
from ..compiler.precision import dtype_of
from ..kernels import packed, parallel
from ..kernels.native import aligned
from ..kernels.pack import combine_forces, pack, pack_forces, unpack
from ..lattice.boundary import HELD
from ..lattice.kinematics import Conditions, conditions_for
from ..model import Model
from ..state import State
from .frame_run import FrameRun, Piece

_LEAST_PER_TASK = 2000
"""Particles below which another task costs more than it saves."""
_TASKS_PER_CORE, _LEAST_PER_SPARE_TASK, _MOST_SPARE_TASKS = 8, 5000, 16
"""Large bodies get more tasks than there are cores, so that no worker waits long for a core that is busy with other programs."""


class Packing:
    """The layout of one model's particles, without those that are HELD, in one precision."""

    def __init__(self, model: Model, precision: str, tasks: int | None) -> None:
        """The arguments are those of `Body`."""
        self.model, self.real = model, dtype_of(precision)
        self.active = np.flatnonzero(model.role != HELD).astype(np.int32)
        count = len(self.active)
        self.tasks = max(1, min(tasks or tasks_for(count), count))
        columns = {
            packed.MASS: model.mass, packed.VOLUME: model.volume, packed.MU: model.mu, packed.LAM: model.lam,
            packed.YIELD_STRESS: model.yield_stress, packed.VISCOSITY: model.viscosity, packed.LAW: model.law, packed.ROLE: model.role,
        }  # fmt: skip
        self.particle = np.empty((count, len(columns)), self.real)
        for place, column in columns.items():
            self.particle[:, place] = column if count == model.particles else column[self.active]

    def start(self, state: State, acceleration: np.ndarray, gradient: np.ndarray | None, frame: int, substeps: int) -> FrameRun:
        """A frame about to start from `state` under acceleration (N, 3) [m/s²], gravity included, and its gradient (N, 3, 3) [1/s²]."""
        m = self.model
        conditions = conditions_for(m, frame, state)
        by_cell = self._by_cell(state.x if len(self.active) == m.particles else state.x[self.active], conditions[0].offset)
        order = self.active[by_cell]
        first = np.linspace(0, len(order), self.tasks + 1).astype(np.int32)
        pieces = [self.piece(c, order, m.frame_dt / substeps) for c in conditions]
        particle, force = self.particle.take(by_cell, axis=0).reshape(-1), self.forces(order, acceleration, gradient)
        run = FrameRun(order, first, particle, force, pieces, substeps)
        rows = self.packed(order, state, m.offset)
        run.kept[0] = rows, self.boxes(run, rows, pieces[0].offset)
        return run

    def forces(self, order: np.ndarray, acceleration: np.ndarray, gradient: np.ndarray | None) -> np.ndarray:
        """Rows (3 M, 4) of `packed.forces` for the particles `order` (M,), from acceleration (N, 3) and gradient (N, 3, 3)."""
        force = aligned((3 * len(order), 4), self.real)
        slopes = np.empty((0, 3, 3)) if gradient is None else float64(gradient)
        launched_in(self.real, pack_forces)(order, float64(acceleration), slopes, force)
        return force

    def combined(self, phi: np.ndarray, dphi: np.ndarray, gravity: np.ndarray, coefficients: np.ndarray, state: np.ndarray) -> np.ndarray:
        """Rows (copies 3 M, 4) of `packed.forces` from coefficients in a basis, see `pack.combine_forces`."""
        force = aligned((3 * len(phi) * len(coefficients), 4), self.real)
        launched_in(self.real, combine_forces)(phi, dphi, gravity, coefficients, state, force)
        return force

    def packed(self, order: np.ndarray, state: State, offset: np.ndarray) -> np.ndarray:
        """The particles `order` (M,) of the state as rows (6 M, 4) of `packed.states`, positions relative to offset (3,)."""
        rows = aligned((6 * len(order), 4), self.real)
        parts = (float64(array) for array in (state.x, state.v, state.C, state.F))
        launched_in(self.real, pack)(order, *parts, offset, rows)
        return rows

    def _by_cell(self, x: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """The order (M,) that sorts positions x (M, 3) [m] by cell, with z varying fastest."""
        if not len(x):
            return np.zeros(0, np.int64)
        key, size = np.zeros(len(x), np.int64), 1
        for axis in (2, 1, 0):
            cell = np.floor((x[:, axis] - offset[axis]) * (1.0 / self.model.dx)).astype(np.int64)
            cell -= cell.min()
            key += size * cell
            size *= int(cell.max()) + 1
        # NumPy sorts 16 bits by radix, several times faster than 64.
        order = np.argsort((key & 0xFFFF).astype(np.uint16), kind="stable")
        if size > 0x10000:
            order = order[np.argsort(key[order] >> 16, kind="stable")]
        return order

    def piece(self, c: Conditions, order: np.ndarray, dt: float) -> Piece:
        """The conditions c as arguments of the kernels, for particles simulated in this order in substeps of dt [s]."""

        def real(array: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(array, dtype=self.real)

        planes = c.planes.copy()
        planes[:, 3] -= planes[:, :3] @ self.model.offset  # positions are relative to the lattice here
        offset = c.offset - self.model.offset
        return Piece(
            offset=offset,
            lattice=real(np.array([*offset, self.model.dx, dt])),
            pin_velocity=real(c.pin_velocity if len(c.pin_velocity) == 1 else c.pin_velocity[order]),
            lo=np.concatenate([c.clamp_lo, c.solid_lo]).astype(np.int32),
            boundary=(c.clamp, real(c.clamp_velocity), real(planes), real(c.solid)),
        )

    def boxes(self, run: FrameRun, packed: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """(tasks, BOX) int32: first and last of the first nodes of each task's particles, and 0 for ORIGIN, which is set later."""
        if not len(packed):
            return np.zeros((self.tasks, parallel.BOX), np.int32)
        x = np.ascontiguousarray(packed.reshape(-1, 6, 4)[:, :3, 3].T)
        rows = [x[:, a:b] for a, b in zip(run.first, run.first[1:])]
        reach = np.array([[row.min(axis=1), row.max(axis=1)] for row in rows])  # rounding preserves order: the outermost stay outermost
        # The same arithmetic as in the kernels, operation by operation: a particle on a cell's border must fall on the same side.
        inv_dx = np.ones(1, self.real) / np.full(1, self.model.dx, self.real)
        base = np.floor((reach - offset.astype(self.real)) * inv_dx - np.full(1, 0.5, self.real)).astype(np.int32)
        return np.concatenate([base[:, 0], base[:, 1], np.zeros_like(base[:, 0, :1])], axis=1)

    def unpack(self, run: FrameRun, packed: np.ndarray, offset: np.ndarray, before: State, into: State | None = None) -> State:
        """The inverse of `packed`: the state of all particles, in the model's order and in float64; HELD ones as in `before`."""
        into = into or State(*(np.empty_like(array) for array in (before.x, before.v, before.C, before.F)))
        if len(run.order) < self.model.particles:
            for array, start in ((into.x, before.x), (into.v, before.v), (into.C, before.C), (into.F, before.F)):
                array[:] = start
        self.write(run.order, packed, offset, into)
        return into

    def write(self, order: np.ndarray, packed: np.ndarray, offset: np.ndarray, into: State) -> None:
        """Write rows (6 M, 4) of `packed.states` into the particles `order` (M,) of `into`; the others are left alone."""
        launched_in(self.real, unpack)(order, packed, offset, into.x, into.v, into.C, into.F)


def tasks_for(count: int) -> int:
    """Number of tasks for a body of `count` particles."""
    cores = device.cores()
    spare = min(_TASKS_PER_CORE * cores, count // _LEAST_PER_SPARE_TASK, _MOST_SPARE_TASKS) if cores > 1 else 1
    return max(1, min(cores, count // _LEAST_PER_TASK), spare)


@functools.cache
def launched_in(real: np.dtype, kernel: Callable[..., None]) -> Launcher:
    """The launcher of a kernel in the precision `real`; all bodies share it."""
    return Launcher(kernel, real, native=False, keeps=False)


def float64(array: np.ndarray) -> np.ndarray:
    """The array in double precision, contiguous in C order."""
    return np.ascontiguousarray(array, dtype=np.float64)
