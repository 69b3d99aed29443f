"""Why a run stopped, as an error message."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..conventions import frame_named
from ..errors import SimulationError
from .kernels import substep

_REASONS = {
    substep.NOT_FINITE: ("has a velocity that is not finite", "velocity"),
    substep.TOO_FAST: ("moved more than one grid cell in one substep", "velocity"),
    substep.INVERTED: ("was turned inside out", "det F"),
    substep.BURST: ("flew off so far that the grid no longer fits in memory", "position"),
}


def failure(status: Sequence[int] | np.ndarray, frame: int, substeps: int) -> SimulationError:
    """The error for a status that begins with a code of `substep`, a particle (-1: unknown), and the substep out of `substeps`."""
    code, particle, at = (int(number) for number in status[:3])
    reason, quantity = _REASONS[code]
    who = f"Particle {particle}" if particle >= 0 else "A particle"
    return SimulationError(
        f"{who} {reason} in {frame_named(frame)}, substep {at} of {substeps}.",
        "Lower the force, the gravity or Young's modulus, or use fewer particles.",
        frame=frame, substep=at, particle=particle, quantity=quantity,
    )  # fmt: skip


def diagnosis(code: int, dt_over_dx: float, x: np.ndarray, v: np.ndarray, F: np.ndarray) -> tuple[int, int]:
    """The code of the failure and the worst particle, from x (N, 3), v (N, 3) and F (N, 3, 3) after the substep that failed.

    Neighbouring particles usually fail in the same substep, and kernels report whichever came last.

    Args:
        code: the code of `substep` that the kernel reported.
        dt_over_dx: the substep over the grid spacing [s/m].
    """
    if code == substep.BURST:
        return code, int(((x - np.median(x, axis=0)) ** 2).sum(axis=1).argmax())
    finite = np.isfinite(v).all(axis=1) & np.isfinite(F).all(axis=(1, 2))
    if not finite.all():
        return substep.NOT_FINITE, int(np.flatnonzero(~finite)[0])
    speed = np.abs(v).max(axis=1)  # its square may overflow
    if code in (substep.TOO_FAST, substep.INVERTED) and np.sqrt(3.0) * speed.max() * dt_over_dx > 1.0:
        return substep.TOO_FAST, int(speed.argmax())
    return code, int(np.linalg.det(F).argmin() if code == substep.INVERTED else speed.argmax())
