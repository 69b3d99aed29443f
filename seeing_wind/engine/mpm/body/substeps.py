"""One body on all cores: runs its substeps forwards and backwards, and keeps the states that the backward pass needs."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...progress import Progress
from ..compiler import device
from ..compiler.launch import Launcher
from ..failure import diagnosis, failure
from ..kernels import parallel, parallel_adjoint, parallel_forward, substep
from ..kernels.crew import roster
from ..kernels.native import aligned, aligned_copy, aligned_zeros
from ..kernels.packed import MOST_NODES as MOST_INDEXED
from ..kernels.packed import MOST_NODES_ACROSS
from ..model import MOST_NODES, Model
from ..state import State
from .frame_run import FrameRun, Piece
from .packing import Packing, float64

_WORK_PER_LAUNCH, _MOST_PER_LAUNCH = 2_000_000, 64
"""Particle-substeps, and substeps, at most, between two checks of whether the user has cancelled."""


class Body:
    """Runs frames of one model in one precision."""

    def __init__(self, model: Model, precision: str = "double", tasks: int | None = None, workers: int | None = None) -> None:
        """precision: double or single; tasks: parts that may run in parallel, None to choose by the cores and the particles; workers:
        threads that run them, None for one per core."""
        assert model.axes is None, "give Model.upright"
        device.start()
        self.packing = Packing(model, precision, tasks)
        self.model, self.real, self.plastic = model, self.packing.real, model.plastic
        self.grid = self.momentum = self.velocity = self.grid_bar = self.momentum_bar = aligned((0, 4), self.real)
        self.status = np.zeros((self.packing.tasks, 2), np.int32)
        self.workers = min(self.packing.tasks, workers or device.cores())
        self.roster = roster(parallel_forward.PHASES * _MOST_PER_LAUNCH, self.workers)
        self.bounds = np.zeros(parallel.BOUNDS, np.int32)
        """Integers that kernels read, changed in place: lo and dims of the box of nodes in use, `Piece.lo`, those named in `parallel`."""
        self.forward_kernel = Launcher(parallel_forward.substeps, self.real)
        # Without a plastic law the adjoint compiles in a third of the time, and compiling it `sooner` would make it a tenth slower.
        self.adjoint_kernel = Launcher(parallel_adjoint.substep_adjoint, self.real, sooner=self.plastic)

    # -- frames ------------------------------------------------------------------------------------------------------------------

    def frame(
        self,
        state: State,
        acceleration: np.ndarray,
        gradient: np.ndarray | None,
        frame: int,
        progress: Progress,
        stride: Callable[[int], int] = lambda substeps: substeps,
        into: State | None = None,
    ) -> tuple[State, FrameRun]:
        """One frame under acceleration (N, 3) [m/s²], gravity included, and its gradient (N, 3, 3) [1/s²]; if it fails, once more with half
        the dt.

        Args:
            stride: takes the frame's number of substeps to the number of substeps between two states that are kept.
            into: arrays for the state at the frame's end; None makes new ones.

        Raises:
            SimulationError: when the second attempt fails, too.
        """
        for substeps in (self.model.substeps, 2 * self.model.substeps):
            run = self.packing.start(state, acceleration, gradient, frame, substeps)
            status = self.advance(run, 0, substeps, stride(substeps), progress)
            if status[0] == substep.RUNNING:
                return self.packing.unpack(run, run.kept[substeps][0], self.model.offset, state, into), run
        raise failure(status, frame, substeps)

    # -- forwards -----------------------------------------------------------------------------------------------------------------

    def advance(self, run: FrameRun, begin: int, end: int, stride: int, progress: Progress) -> tuple[int, int, int]:
        """Substeps `begin` to `end` from the kept state `begin`; keeps the states at multiples of `stride`, and the last.

        Returns:
            code of `substep` (RUNNING is success), particle of the model, substeps done.
        """
        state, boxes = run.kept[begin]
        if not len(state):  # every particle is HELD
            run.kept[end] = state, boxes
            return substep.RUNNING, -1, end
        s = begin
        while s < end:
            progress.check()
            kept, before = s in run.kept, boxes
            after = aligned(state.shape, state.dtype) if kept else state
            code, particle, boxes, done = self._substeps(run, s, 1 if kept else self._stretch(run, s, end, stride), state, after, boxes)
            if code != substep.RUNNING:
                return code, particle, s + max(done - 1, 0)
            if kept and stride == 1 and 4 * (nodes := math.prod(bounds(before)[1])) <= len(run.order):
                run.grids[s] = aligned_copy(self.momentum[:nodes])
            state, s = after, s + done
            if s == end or s % stride == 0:
                run.kept[s] = state, boxes
        return substep.RUNNING, -1, end

    def _stretch(self, run: FrameRun, s: int, end: int, stride: int) -> int:
        """Number of substeps from s on that one launch can do: up to the next state to be kept, all in the same piece of the frame."""
        most = min(end - s, stride - s % stride, _MOST_PER_LAUNCH, max(1, _WORK_PER_LAUNCH // len(run.order)))
        return next((k for k in range(1, most) if run.piece(s + k) is not run.piece(s)), most)

    def _substeps(
        self, run: FrameRun, s: int, count: int, state: np.ndarray, after: np.ndarray, boxes: np.ndarray
    ) -> tuple[int, int, np.ndarray, int]:
        """Up to `count` substeps from `state` into `after`, which must be the same array if `count` is more than one.

        Returns:
            code, particle, boxes of `after`, substeps done. `boxes` is overwritten with the boxes of `after` unless state `s` is kept.
        """
        piece = run.piece(s)
        if not self._fit_grids(piece, boxes):
            return *self._diagnosis(substep.BURST, run, piece, state), boxes, 0
        if s in run.kept:
            boxes = boxes.copy()
        self.status[:] = 0
        self._launch(run, piece, state, after, boxes, count)
        done = int(self.bounds[parallel.DONE])
        if self.status.any():
            code = int(self.status[np.flatnonzero(self.status[:, 0])[0], 0])
            return *self._diagnosis(code, run, piece, after), boxes, done
        s += done
        if s < run.substeps and run.piece(s) is not piece:
            boxes = self.packing.boxes(run, after, run.piece(s).offset)
        return substep.RUNNING, -1, boxes, done

    def _diagnosis(self, code: int, run: FrameRun, piece: Piece, packed: np.ndarray) -> tuple[int, int]:
        """`failure.diagnosis` of a packed state (6 M, 4): the code, and the number of the particle in the model."""
        columns = float64(packed).reshape(-1, 2, 3, 4)  # of F with x, of C with v
        F, (x, v) = columns[:, 0, :, :3].swapaxes(1, 2), (columns[:, k, :, 3] for k in (0, 1))
        code, worst = diagnosis(code, float(piece.lattice[4] / piece.lattice[3]), x, v, F)
        return code, int(run.order[worst])

    def _launch(self, run: FrameRun, piece: Piece, state: np.ndarray, after: np.ndarray, boxes: np.ndarray, count: int) -> None:
        """Launch `count` substeps, after `_fit_grids` of `boxes`; 0 runs one substep as far as the nodes' velocities."""
        self.roster[: parallel_forward.PHASES * max(count, 1)] = 0
        self.forward_kernel(
            self.plastic, count, self.workers, self.roster, run.first, run.particle, state, after, run.force,
            piece.pin_velocity, *piece.boundary, piece.lattice, self.bounds, boxes, self.status, self.grid, self.momentum, self.velocity,
        )  # fmt: skip

    def _fit_grids(self, piece: Piece, boxes: np.ndarray) -> bool:
        """Set the bounds to those of `boxes` and make the grids large enough, with room to grow; False if no grid may be so large."""
        lo, dims = bounds(boxes)
        wanted, plane = math.prod(dims), dims[1] * dims[2]
        if wanted > MOST_NODES or max(dims[1:]) > MOST_NODES_ACROSS:
            return False
        sizes = (boxes[:, 3] - boxes[:, 0] + 3).astype(np.int64) * plane
        room = int(sizes.sum())
        if room > MOST_INDEXED:
            return False
        boxes[:, parallel.ORIGIN] = np.cumsum(sizes) - sizes - (boxes[:, 0] - lo[0]).astype(np.int64) * plane
        if wanted > len(self.velocity):
            self.momentum, self.velocity = (aligned((wanted + wanted // 3, 4), self.real) for _ in range(2))
        if room > len(self.grid):
            self.grid = aligned((min(room + room // 3, MOST_INDEXED), 4), self.real)
        self.bounds[:3], self.bounds[3:6], self.bounds[6:12] = lo, dims, piece.lo
        self.bounds[parallel.CAPACITY :] = min(len(self.velocity), MOST_NODES), len(self.grid), 0, 0
        return True

    # -- backwards ----------------------------------------------------------------------------------------------------------------

    def pull_back(self, run: FrameRun, bar: np.ndarray, material: bool, progress: Progress) -> tuple[np.ndarray, np.ndarray]:
        """Turn the derivative `bar` (6 M, 4) by the state at the frame's end into that by its start, in place.

        States that were not kept are simulated again, a stretch at a time.

        Args:
            bar: laid out as `packed.states`, and `aligned`.
            material: whether the derivative by `particle` is wanted.

        Returns:
            The derivatives by `run.force` and by `run.particle`; the latter is zero unless `material`.
        """
        force_bar, particle_bar = aligned_zeros(run.force.shape, self.real), np.zeros_like(run.particle)
        end = run.substeps if len(bar) else 0
        while end:
            begin = max(s for s in run.kept if s < end)
            length = end - begin
            if length > 1:
                self.advance(run, begin, end, 1 if length <= sparse_stride(run.substeps) else sparse_stride(length), progress)
                continue
            progress.check()
            self._substep_adjoint(run, begin, bar, force_bar, particle_bar, material)
            del run.kept[end]
            run.grids.pop(begin, None)
            end = begin
        return force_bar, particle_bar

    def _substep_adjoint(
        self, run: FrameRun, s: int, bar: np.ndarray, force_bar: np.ndarray, particle_bar: np.ndarray, material: bool
    ) -> None:
        state, boxes = run.kept[s]
        piece = run.piece(s)
        self._fit_grids(piece, boxes)
        if len(self.grid_bar) < len(self.grid):
            self.grid_bar = aligned(self.grid.shape, self.real)
        if len(self.momentum_bar) < len(self.velocity):
            self.momentum_bar = aligned(self.velocity.shape, self.real)
        momentum = run.grids.get(s)
        if momentum is None:
            self._launch(run, piece, state, state, boxes, 0)
            momentum = self.momentum
        self.roster[: parallel_adjoint.PHASES] = 0
        self.adjoint_kernel(
            self.plastic, int(material), self.workers, self.roster, run.first, run.particle, state, run.kept[s + 1][0], run.force,
            bar, force_bar, particle_bar, *piece.boundary, piece.lattice, self.bounds, boxes,
            self.grid_bar, momentum, self.velocity, self.momentum_bar,
        )  # fmt: skip


def bounds(boxes: np.ndarray) -> tuple[list[int], list[int]]:
    """First node and node counts, three each, of the box of nodes that the particles of all tasks touch; boxes (tasks, BOX)."""
    # In Python's integers, because the box of an exploding body overflows 32 bits.
    first_and_last = list(zip(*boxes.tolist()))
    lo = [min(nodes) for nodes in first_and_last[:3]]
    return lo, [max(nodes) - low + 3 for nodes, low in zip(first_and_last[3:6], lo)]


def sparse_stride(substeps: int) -> int:
    """Substeps between two kept states, so that these and the states of one stretch between them are fewest in total: the square root."""
    return math.isqrt(substeps - 1) + 1
