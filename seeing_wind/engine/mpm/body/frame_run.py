"""What one frame of a body is run with, and what is kept of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Piece:
    """What holds at the nodes for a share of a frame, as arguments of the kernels."""

    offset: np.ndarray
    """(3,) a node of the lattice, relative to the model's [m]."""
    lattice: np.ndarray
    """(5,) the same, dx [m] and dt [s] in the kernels' precision."""
    pin_velocity: np.ndarray
    """(M, 3) of the particles in their order, or one row (1, 3) of zeros [m/s]."""
    lo: np.ndarray
    """(6,) int32, first nodes of the boxes of clamped and solid nodes."""
    boundary: tuple[np.ndarray, ...]
    """clamp, clamp_velocity, planes, solid; see `conditions.boundary_velocity`."""


@dataclass
class FrameRun:
    """One frame's particles in the order in which they were simulated, and the states kept of it."""

    order: np.ndarray
    """(M,) int32, which particle of the model each one is; held ones are left out."""
    first: np.ndarray
    """(tasks + 1,) int32, each task's first particle."""
    particle: np.ndarray
    """(8 M,), see `packed.constants`."""
    force: np.ndarray
    """(3 M, 4), see `packed.forces`."""
    pieces: list[Piece]
    """One after the other, of equal length."""
    substeps: int
    kept: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    """Packed state (6 M, 4) and boxes (tasks, BOX) before substep s; the frame's end has the number `substeps`."""
    grids: dict[int, np.ndarray] = field(default_factory=dict)
    """Momentum and mass (nodes, 4) of the nodes in substep s, where they take less than a number per particle."""

    @property
    def bytes(self) -> int:
        """Size of what is kept of all substeps; the frame's end belongs to the next."""
        states = sum(state.nbytes for s, (state, _) in self.kept.items() if s < self.substeps)
        return states + sum(grid.nbytes for grid in self.grids.values())

    def piece(self, s: int) -> Piece:
        """What holds in substep s."""
        return self.pieces[min(((s + 1) * len(self.pieces) - 1) // self.substeps, len(self.pieces) - 1)]
