"""A frame of many copies of one body, in place; or of one body with every substep kept."""

from __future__ import annotations

import numpy as np

from ...progress import Progress
from ..compiler import device
from ..compiler.launch import Launcher
from ..kernels import copies_forward, substep
from ..kernels.copies_forward import CODE, DONE, STATUS, WANTED
from ..kernels.native import aligned
from ..kernels.packed import MOST_NODES as MOST_INDEXED
from ..model import MOST_NODES, Model
from .frame_run import Piece
from .packing import Packing

_WORK_PER_LAUNCH = 2_000_000
"""Particle-substeps between two checks of whether the user has cancelled: a quarter of a second on one core, a second on a busy one."""
_NOT_KEPT = np.zeros((0, 6), np.int32)


class CopiesRun:
    """Runs the substeps of frames of one model, in double precision."""

    def __init__(self, model: Model, most_nodes: int | None = None) -> None:
        """most_nodes: a copy that needs more nodes in its grid has burst; None is `MOST_NODES`."""
        assert model.axes is None, "give Model.upright"
        device.start()
        self.model, self.packing = model, Packing(model, "double", 1)
        self.particle = self.packing.particle.reshape(-1)
        self.bounds = np.zeros(3 * (substep.SOLID_LO + 1), np.int32)
        self.kernel = Launcher(copies_forward.substeps_of_copies, self.packing.real)
        self.most, self.capacity = most_nodes or MOST_NODES, 0
        """Nodes of each grid, at most and at present."""
        self.grid = self.velocity = aligned((0, 4), self.packing.real)

    def make_room(self, nodes: int) -> None:
        """Allow for so many nodes in each grid."""
        self.capacity = max(self.capacity, min(nodes, self.most), 1)

    def make_room_for(self, x: np.ndarray) -> None:
        """Allow for particles x (copies, N, 3) [m] that turn and bend a little."""
        cells = np.ceil(np.ptp(x, axis=1).max(axis=0) / self.model.dx) + 4
        self.make_room(int(min(1.5 * np.prod(cells), self.most)))

    def frame(
        self, state: np.ndarray, force: np.ndarray, copies: int, pieces: list[Piece], substeps: int, progress: Progress,
        boxes: np.ndarray = _NOT_KEPT,
    ) -> np.ndarray:  # fmt: skip
        """A frame of `copies`, each of M particles.

        Args:
            state: (copies 6 M, 4), changed in place. With `boxes`, ((S+1) 6 M, 4): the first state is the start, the others are filled in.
            force: (copies 3 M, 4).
            pieces: boundary conditions at the nodes for consecutive parts of the frame, of equal length.
            boxes: (S, 6) int32 to keep every substep of a single copy; filled with each substep's first node and node counts. `grid`
                (S capacity, 4) then has the substeps' momentum and mass.

        Returns:
            status (copies, STATUS) of `copies_forward`, with the code BURST for a copy that no grid can hold.
        """
        status = np.zeros((copies, STATUS), np.int32)
        if not len(force):  # every particle is HELD
            status[:, DONE] = substeps
            return status
        while True:
            self._fit(copies, len(boxes))
            self._launches(state, force, pieces, substeps, boxes, status, progress)
            full = status[:, CODE] == substep.GRID_FULL
            burst = full & (status[:, WANTED] > min(self.most, MOST_INDEXED // max(len(boxes), 1)))
            status[burst, CODE] = substep.BURST
            full &= ~burst
            if not full.any():
                return status
            wanted = int(status[full, WANTED].max())
            # A third more than needed, so that a body that turns does not need more again at every substep.
            self.make_room(min(wanted + wanted // 3, MOST_INDEXED // max(len(boxes), copies)))
            status[full, CODE] = substep.RUNNING
            if len(boxes):  # the kept grids have moved in memory: begin the frame again
                status[:] = 0

    def _fit(self, copies: int, kept: int) -> None:
        """Make the grids large enough for so many copies, or for so many kept substeps."""
        self.capacity = min(self.capacity, MOST_INDEXED // max(copies, kept))
        if len(self.grid) < max(copies, kept) * self.capacity:
            self.grid = aligned((max(copies, kept) * self.capacity, 4), self.packing.real)
        if kept and len(self.velocity) < self.capacity:
            self.velocity = aligned((self.capacity, 4), self.packing.real)

    def _launches(
        self, state: np.ndarray, force: np.ndarray, pieces: list[Piece], substeps: int, boxes: np.ndarray, status: np.ndarray,
        progress: Progress,
    ) -> None:  # fmt: skip
        """Run every copy as far as it gets, in launches so short that the user can cancel between them."""
        most = max(1, _WORK_PER_LAUNCH * 3 // len(force))
        begin = 0
        for piece, end in zip(pieces, ends_of(len(pieces), substeps)):
            self.bounds[3 * substep.CLAMP_LO :] = piece.lo
            while begin < end:
                begin = min(begin + most, end)
                if not ((status[:, CODE] == substep.RUNNING) & (status[:, DONE] < begin)).any():
                    continue
                progress.check()
                self.kernel(
                    self.model.plastic, begin, self.capacity, self.particle, state, force, piece.pin_velocity, *piece.boundary,
                    piece.lattice, self.bounds, boxes, self.grid, self.velocity if len(boxes) else self.grid, status,
                )  # fmt: skip


def ends_of(pieces: int, substeps: int) -> list[int]:
    """The substep at which each of the `pieces` of a frame ends."""
    return [substeps * (k + 1) // pieces for k in range(pieces)]
