"""What stays the same during a simulation: bodies, lattice and time. `model_for` chooses them from a material."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .lattice.boundary import FREE
from .lattice.colliders import NO_COLLIDERS, Collider, ColliderGrid
from .laws.plasticity import VON_MISES

MOST_NODES = 30_000_000
"""Nodes of one grid (1 GB). A body spread over more has burst."""


@dataclass(frozen=True)
class Model:
    """Bodies, grid and time of one simulation. `model_for` builds it."""

    mass: np.ndarray
    """(N,) [kg]."""
    volume: np.ndarray
    """(N,) rest volume [m³]."""
    mu: np.ndarray
    """(N,) [Pa]."""
    lam: np.ndarray
    """(N,) [Pa]."""
    yield_stress: np.ndarray
    """(N,) [Pa]; plastic laws only."""
    viscosity: np.ndarray
    """(N,) [Pa s]; of an elastic law its shear viscosity, see `laws.viscous`; of the viscoplastic one that of its flow."""
    law: np.ndarray
    """(N,) int32, a value of `constitutive.LAWS`."""
    role: np.ndarray
    """(N,) int32: FREE, PINNED or HELD of `boundary`."""
    clamp_lo: np.ndarray
    """(3,) int32, first node of the box `clamp`."""
    clamp: np.ndarray
    """(a, b, c) int32, 1 for the nodes that stand still."""
    offset: np.ndarray
    """(3,) position of the lattice's node (0, 0, 0) [m]."""
    dx: float
    """Grid spacing [m]."""
    frame_dt: float
    """One frame [s]."""
    substeps: int
    """Per frame."""
    gravity: np.ndarray
    """(3,) [m/s²], apart from the external acceleration; (T, N, 3) in a frame of reference that accelerates, by frame and particle."""
    collider_grid: ColliderGrid = NO_COLLIDERS
    """Planes, and meshes as the lattice's nodes see them."""
    movers: tuple[Collider, ...] = ()
    """All colliders, if any of them moves: they are sampled as the frames go by. `collider_grid` has those that stand still, then."""
    part: tuple[int, int] = (0, 1)
    """Which of how many equal parts of a frame it advances: `frame_dt` and `substeps` are a part's, paths are by whole frames."""
    pin_path: np.ndarray | None = None
    """(T+1, M, 3) [m] where the M pinned particles are at every frame; None is where they start."""
    pin_rest: np.ndarray | None = None
    """(N, 3) [m] all particles at rest; only with `pin_path`."""
    clamp_depth: float = 0.0
    """Cells below the border of the pinned material at which it begins to be held."""
    axes: np.ndarray | None = None
    """(3, 3) the lattice's axes as columns, None for the world's. What says where nodes are (offset, clamp, pin_path, pin_rest,
    collider_grid) is in coordinates along them; `rollout` and its kin turn what they get and what they give back."""
    refined: float = 1.0
    """How many times as many substeps it has as it would need to be stable."""

    def upright(self) -> Model:
        """The same in the lattice's own coordinates."""
        return self if self.axes is None else replace(self, axes=None, gravity=self.gravity @ self.axes)

    def gravity_in(self, frame: int) -> np.ndarray:
        """(3,) or (N, 3) [m/s²] in frame number `frame`."""
        return self.gravity if self.gravity.ndim == 1 else self.gravity[frame]

    def from_frame(self, first: int) -> Model:
        """The same, its frames counted from `first` on."""
        return self if self.gravity.ndim == 1 else replace(self, gravity=self.gravity[first:])

    @property
    def particles(self) -> int:
        """N."""
        return len(self.mass)

    @property
    def plastic(self) -> bool:
        """Whether any particle has a plastic law."""
        return bool((self.law >= VON_MISES).any())

    @property
    def pinned(self) -> np.ndarray:
        """(N,) bool, the particles that keep their place."""
        return self.role != FREE
