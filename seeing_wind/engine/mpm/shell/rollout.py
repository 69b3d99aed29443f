"""A frame of a shell's motion, in substeps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...errors import SimulationError
from .model import Shell, State, with_past
from .obstacle import Obstacle
from .substep import Load, advance

LONGEST = 0.006
"""Longest substep [s]: with it the second-order rule still resolves the oscillations that a clip shows, and from rest a sheet falls no
farther than about its own thickness."""

HALVINGS = 3
"""How often a substep without a solution is halved, at most."""


def substeps_for(fps: float, coarseness: float = 1.0) -> int:
    """Substeps per frame, each of at most `LONGEST` times the coarseness."""
    return max(2, math.ceil(1.0 / (fps * LONGEST * coarseness)))


def advance_frame(
    shell: Shell, state: State, *, frame: int, fps: float, substeps: int, gravity: np.ndarray, load: Load | None = None,
    pin_path: np.ndarray | None = None, obstacles: tuple[Obstacle, ...] = (),
) -> State:  # fmt: skip
    """The state a frame later.

    Args:
        state: at the frame's start; its earlier time must be one substep before.
        pin_path: (T+1, P, 3) where the pinned vertices are at every frame [m]; None leaves them where they are.
        gravity, load, obstacles: as in `advance`.

    Raises:
        SimulationError: see `advance`; it names the frame and the substep.
    """
    dt = 1.0 / (fps * substeps)
    for substep in range(substeps):
        pins = None
        if pin_path is not None:
            share = (substep + 1) / substeps
            pins = (1.0 - share) * pin_path[frame] + share * pin_path[frame + 1]
        try:
            around = dict(gravity=gravity, frame=frame, load=load)
            state = _advance_in_halves(shell, state, dt, pins, around, obstacles, (frame + (substep + 1) / substeps, 1.0 / fps), HALVINGS)
        except SimulationError as error:
            raise SimulationError(error.message, error.hint, frame=frame, substep=substep, quantity=error.quantity) from error
    return state


def _advance_in_halves(
    shell: Shell, state: State, dt: float, pins: np.ndarray | None, around: dict[str, Any], obstacles: tuple[Obstacle, ...],
    until: tuple[float, float], more: int,
) -> State:  # fmt: skip
    """The state a substep later; a substep without a solution is halved, up to `more` times over.

    around: further arguments of `advance`; until: the time at the substep's end [frames], and the length of a frame [s].
    """
    try:
        return advance(shell, state, dt=dt, pins=pins, obstacles=tuple(one.at(*until) for one in obstacles), **around)[0]
    except SimulationError:
        if not more:
            raise
    half = 0.5 * dt
    middle = None if pins is None else 0.5 * (state.x[shell.pinned] + pins)
    first = with_past(state.x, state.v, (state.v - state.v_before) / dt, half)
    first = _advance_in_halves(shell, first, half, middle, around, obstacles, (until[0] - half / until[1], until[1]), more - 1)
    second = _advance_in_halves(shell, first, half, pins, around, obstacles, until, more - 1)
    return with_past(second.x, second.v, (second.v - second.v_before) / half, dt)
