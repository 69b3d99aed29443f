"""Fewer particles for a mesh than in the full result, for a preview, as long as they take up about the same space.

How a body bends depends on the space that its particles take up, and this changes in jumps with the spacing of the lattice. With three
particles across instead of six, a rod's bending is off by 2 %; with five that take up a fifth more than its width, it bends a quarter less.
So a coarser lattice is used only if it takes up as much space as the full one.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ..fill import Filling, fill

STEP = 0.1
"""Difference between consecutive factors on the spacing that are tried."""
ALIKE = 0.1
"""Largest relative difference in the space that the particles take up: about the error of the full result's own."""


def fill_coarser(vertices: np.ndarray, triangles: np.ndarray, coarseness: float) -> tuple[Filling, float]:
    """Fill a mesh as `fill` does, with particles up to `coarseness` times as far apart.

    An open surface keeps its particles, as it is as thick as two of them; so does a closed body that is thinner than its particles.

    Args:
        vertices: (V, 3) [m]; triangles: (M, 3).
        coarseness: 1 or more.

    Returns:
        The particles, and the factor on their spacing that was reached; a note says if it is clearly less than was asked for.

    Raises:
        UsageError: as in `fill`.
    """
    full = fill(vertices, triangles)
    if coarseness <= 1.0:
        return full, 1.0
    for factor in [] if full.layered else np.arange(coarseness, 1.0 + 0.5 * STEP, -STEP).tolist():
        coarse = fill(vertices, triangles, spacing=factor * full.particles.spacing)
        if not coarse.layered and abs(_room(coarse) / _room(full) - 1.0) <= ALIKE:
            said = [] if factor > 0.75 * coarseness else [f"too thin for a coarser preview than {factor:.1f} times the particles' spacing"]
            return dataclasses.replace(coarse, notes=[*coarse.notes, *said]), factor
    return dataclasses.replace(full, notes=[*full.notes, "too thin for a coarser preview: it has as many particles as in full"]), 1.0


def _room(filling: Filling) -> float:
    """Space that the particles take up, each a cube of one spacing [m³]."""
    return len(filling.particles.x) * filling.particles.spacing**3
