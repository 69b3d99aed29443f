"""What stopped a run, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import SimulationError
from . import substep

_REASONS = {
    substep.NOT_FINITE: ("has a velocity that is not finite", "velocity"),
    substep.TOO_FAST: ("moved more than one grid cell in one substep", "velocity"),
    substep.INVERTED: ("was turned inside out", "det F"),
    substep.BURST: ("flew off so far that the grid no longer fits in memory", "position"),
}


def failure(status: Sequence[int] | np.ndarray, frame: int, substeps: int) -> SimulationError:
    """The error for a status that begins with code (of `substep`), particle (-1 for none in particular) and substep of `substeps`."""
    code, particle, at = (int(number) for number in status[:3])
    reason, quantity = _REASONS[code]
    who = f"Particle {particle}" if particle >= 0 else "A particle"
    return SimulationError(
        f"{who} {reason} in frame {frame}, substep {at} of {substeps}.",
        "Allow more substeps a frame, lower the force or Young's modulus, or use fewer particles.",
        frame=frame, substep=at, particle=particle, quantity=quantity,
    )  # fmt: skip


def check_start(**arrays: np.ndarray) -> None:
    """SimulationError when a start value (..., N, 3) or (..., N, 3, 3) is not finite; the arrays by what they are."""
    for name, array in arrays.items():
        # The sum is quick, but finite numbers may have one that is not.
        if not np.isfinite(array.sum()) and not np.isfinite(array).all():
            matrix = name in ("affine_velocity", "deformation")
            particle = int(np.argwhere(~np.isfinite(array))[0, array.ndim - (3 if matrix else 2)])
            name = name.replace("_", " ")
            message = f"The {name} of particle {particle} at the start is not finite."
            raise SimulationError(message, "Check the body and its initial velocity.", particle=particle, quantity=name)
