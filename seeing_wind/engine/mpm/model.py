"""What stays the same during a simulation: bodies, lattice and time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .lattice.boundary import FREE
from .lattice.colliders import NO_COLLIDERS, Collider, ColliderGrid
from .laws.plasticity import VON_MISES

MOST_NODES = 30_000_000
"""Nodes of one grid, at most (1 GB). A body spread over more has burst."""


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
    """(N,) [Pa s]; the shear viscosity under an elastic law, see `laws.viscous`; that of the flow under the viscoplastic law."""
    law: np.ndarray
    """(N,) int32, a value of `constitutive.LAWS`."""
    role: np.ndarray
    """(N,) int32: FREE, PINNED or HELD of `boundary`."""
    clamp_lo: np.ndarray
    """(3,) int32, first node of the box `clamp`."""
    clamp: np.ndarray
    """(a, b, c) int32, 1 for clamped nodes."""
    offset: np.ndarray
    """(3,) position of the lattice's node (0, 0, 0) [m]."""
    dx: float
    """Grid spacing [m]."""
    frame_dt: float
    """Length of a frame [s]; see `part`."""
    substeps: int
    """Substeps per frame; see `part`."""
    gravity: np.ndarray
    """(3,) [m/s²], apart from the external acceleration; (T, N, 3), by frame and particle, in an accelerated frame of reference."""
    collider_grid: ColliderGrid = NO_COLLIDERS
    """Planes, and meshes sampled at the lattice's nodes."""
    movers: tuple[Collider, ...] = ()
    """All colliders if any of them moves, else empty. They are sampled during each frame; `collider_grid` then has only the still ones."""
    part: tuple[int, int] = (0, 1)
    """(i, n): the model advances the i-th of n equal parts of a frame. `frame_dt` and `substeps` are those of a part, paths have one entry
    per whole frame."""
    pin_path: np.ndarray | None = None
    """(T+1, M, 3) [m] where the M pinned particles are at every frame; None is where they start."""
    pin_rest: np.ndarray | None = None
    """(N, 3) [m] all particles at rest; only with `pin_path`."""
    clamp_depth: float = 0.0
    """Clamp depth: how far below the border of the pinned material the clamp begins [cells]."""
    axes: np.ndarray | None = None
    """(3, 3) the lattice's axes as columns, None for the world's. Positions on the lattice (offset, clamp, pin_path, pin_rest,
    collider_grid) are in coordinates along them; `rollout` and similar functions convert their arguments and results."""
    refined: float = 1.0
    """Number of substeps over the number that stability needs."""

    def upright(self) -> Model:
        """The same model in the lattice's own coordinates."""
        return self if self.axes is None else replace(self, axes=None, gravity=self.gravity @ self.axes)

    def gravity_in(self, frame: int) -> np.ndarray:
        """(3,) or (N, 3) [m/s²] in frame number `frame`."""
        return self.gravity if self.gravity.ndim == 1 else self.gravity[frame]

    def from_frame(self, first: int) -> Model:
        """The same model with its frames counted from `first` on."""
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
        """(N,) bool, the particles whose motion is given."""
        return self.role != FREE
