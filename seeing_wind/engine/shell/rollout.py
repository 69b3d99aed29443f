"""A frame of a shell's motion: as many substeps as it takes."""

from __future__ import annotations

import math

import numpy as np

from ..errors import SimulationError
from .model import Shell, State
from .obstacle import Obstacle
from .substep import Load, advance

LONGEST = 0.006
"""s of a substep at most: a second-order rule that long still swings what a clip shows, and a sheet in free fall goes its own thickness."""


def substeps_for(fps: float) -> int:
    """Substeps a frame."""
    return max(2, math.ceil(1.0 / (fps * LONGEST)))


def advance_frame(
    shell: Shell, state: State, *, frame: int, fps: float, substeps: int, gravity: np.ndarray, load: Load | None = None,
    pin_path: np.ndarray | None = None, obstacles: tuple[Obstacle, ...] = (),
) -> State:  # fmt: skip
    """The state a frame later.

    Args:
        state: at the frame's start, with a past of the same substep.
        pin_path: (T+1, P, 3) where the pinned vertices are at every picture [m]; None leaves them where they are.
        gravity, load, obstacles: as of `advance`.

    Raises:
        SimulationError: see `advance`; it names the frame and the substep.
    """
    for substep in range(substeps):
        pins = None
        if pin_path is not None:
            share = (substep + 1) / substeps
            pins = (1.0 - share) * pin_path[frame] + share * pin_path[frame + 1]
        try:
            state, _ = advance(
                shell, state, dt=1.0 / (fps * substeps), gravity=gravity, frame=frame, load=load, pins=pins, obstacles=obstacles
            )
        except SimulationError as error:
            raise SimulationError(error.message, error.hint, frame=frame, substep=substep, quantity=error.quantity) from error
    return state
