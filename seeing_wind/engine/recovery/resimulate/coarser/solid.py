"""Fewer particles for a mesh than in the full result, for a preview: as few as leave it as large and as thick.

What matters for how a body bends is the room that its particles take up, which a lattice of another spacing changes in jumps. A rod of six
particles across goes on with three, 2 % off in how far it bends; with five that take up a fifth more than its width it bends by a quarter
less. So a coarser lattice counts only if it takes up as much room as the full one.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ..fill import Filling, fill

STEP = 0.1
"""Between two factors on the spacing that are tried."""
ALIKE = 0.1
"""By which part the room that the particles take up may differ: about as much as the full result's own is off."""


def fill_coarser(vertices: np.ndarray, triangles: np.ndarray, coarseness: float) -> tuple[Filling, float]:
    """Fill a mesh as `fill` does, with particles up to `coarseness` times as far apart.

    An open surface keeps its particles, for it is as thick as two of them; so does a closed one that is thinner than they are.

    Args:
        vertices: (V, 3) [m]; triangles: (M, 3).
        coarseness: 1 or more.

    Returns:
        The particles, and the factor on their spacing that was reached. A note says where that is less than was asked for.

    Raises:
        UsageError: as `fill`.
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
    """What the particles take up [m³], each a cube of its spacing."""
    return len(filling.particles.x) * filling.particles.spacing**3
