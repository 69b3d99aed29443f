"""How a clip is divided into blocks, and how many modes the force may have: both known before the solve, without loading the solver."""

from __future__ import annotations

import math

from ..records import Particles
from .prior.constants import PRIOR
from .solve.constants import PACE


def blocks(frames: int) -> list[tuple[int, int]]:
    """First and last frame of each block. Blocks have about equal lengths, and neighbours share `PACE.overlap` frames."""
    count = 1 if frames <= PACE.block else math.ceil((frames - PACE.overlap) / (PACE.block - PACE.overlap))
    hop = (frames - PACE.overlap) / count if count > 1 else frames
    return [(round(hop * k), min(frames, round(hop * (k + 1)) + (PACE.overlap if count > 1 else 0))) for k in range(count)]


def most_modes(body: Particles) -> int:
    """Most modes that the force on a body may have."""
    if body.stiffness is None:
        return PRIOR.full_modes
    return min(PRIOR.full_modes, max(PRIOR.fewest_modes, len(body.x) // PRIOR.particles_a_mode))
