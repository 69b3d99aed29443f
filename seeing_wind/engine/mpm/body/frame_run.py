"""The inputs of one frame of a body, and the states kept of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Piece:
    """The boundary conditions during a part of a frame, as arguments of the kernels."""

    offset: np.ndarray
    """(3,) a node of the lattice, relative to the model's offset [m]."""
    lattice: np.ndarray
    """(5,) `offset`, dx [m] and dt [s] in the kernels' precision."""
    pin_velocity: np.ndarray
    """(M, 3) of the particles in the order of the run, or one row (1, 3) of zeros [m/s]."""
    lo: np.ndarray
    """(6,) int32, first nodes of the boxes of clamped and solid nodes."""
    boundary: tuple[np.ndarray, ...]
    """clamp, clamp_velocity, planes, solid; see `conditions.boundary_velocity`."""


@dataclass
class FrameRun:
    """One frame's particles, in the order in which they are simulated, and the states kept of the frame."""

    order: np.ndarray
    """(M,) int32, each particle's number in the model; HELD particles are left out."""
    first: np.ndarray
    """(tasks + 1,) int32, each task's first particle."""
    particle: np.ndarray
    """(8 M,), see `packed.constants`."""
    force: np.ndarray
    """(3 M, 4), see `packed.forces`."""
    pieces: list[Piece]
    """Consecutive pieces of equal length."""
    substeps: int
    kept: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    """Packed state (6 M, 4) and boxes (tasks, BOX) before substep s; the key of the frame's end is `substeps`."""
    grids: dict[int, np.ndarray] = field(default_factory=dict)
    """Momentum and mass (nodes, 4) of the nodes in substep s, kept where they take no more than one number per particle."""

    @property
    def bytes(self) -> int:
        """Size of all that is kept, without the state at the frame's end, which is the start of the next frame."""
        states = sum(state.nbytes for s, (state, _) in self.kept.items() if s < self.substeps)
        return states + sum(grid.nbytes for grid in self.grids.values())

    def piece(self, s: int) -> Piece:
        """The piece to which substep s belongs."""
        return self.pieces[min(((s + 1) * len(self.pieces) - 1) // self.substeps, len(self.pieces) - 1)]
