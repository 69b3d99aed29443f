"""What moves in a box: in the first frames or, for an object that rests at first, later."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from ....progress import Progress
from ....records import Doubt
from ...clip.stored import Frames
from ..background import Plate
from ..cutting import opened
from ..evidence import Contrast, against_plate
from ..motion import Window, cut, paste, window_of, within
from .later import moved_later
from .soon import MOTION_SURE, moving_odds

MOVES = 0.04
"""Fraction of a box that has to change in the clip for the changing pixels to be taken for the object, and the others for still."""

RESTS, MORE = 0.1, 2.0
"""Fraction of a box up to which what moves in the first frames, or is gone later, counts as next to nothing; and how many times as many
pixels must then move later."""

NEARBY = 16
"""Width [px] of the margin round a box that is examined, too."""

Moving = Callable[[Window], np.ndarray]
"""Log odds (h, w) in a window, from the motion of frame 0's pixels there."""


def moving_in(frames: Frames, noise: float) -> Moving:
    """The clip's `moving_odds`, computed once for each window."""
    return cache(lambda window: moving_odds(frames, window, noise))


def moving_from(frames: Frames, inside: np.ndarray, plate: Plate, progress: Progress) -> Moving:
    """What moves in the box `inside` (H, W) bool: in the first frames, or, if that is next to nothing, in any frame.

    If next to nothing moves in the first frames or ever uncovers the background, the object may be at rest, so what moves away later is
    sought. This is taken if it is much more than what moves at first, which then is the rim of a shadow or a hand.
    """
    soon = moving_in(frames, plate.noise)
    if not inside.any():
        return soon
    near = within(window_of(inside, NEARBY), inside)
    # Grid lines and a codec's traces are narrow.
    boxed, behind = cut(inside, near), opened(plate_odds(frames[0], plate, near) > 0.0)
    moves = (boxed & ((soon(near) > 0.0) | behind)).sum()
    if moves > RESTS * boxed.sum():
        return soon
    x0, y0, x1, y1 = window_of(inside, 0)
    wide = within(window_of(inside, max(x1 - x0, y1 - y0, NEARBY)), inside)  # flow needs 12 px
    odds = np.zeros(inside.shape, np.float32)
    paste(odds, moved_later(frames, wide, plate.noise, progress), wide)
    return (lambda window: cut(odds, window)) if (inside & (odds > 0.0)).sum() > max(MORE * moves, MOVES * inside.sum()) else soon


def hardly_moves(frame: np.ndarray, inside: np.ndarray, plate: Plate, moving: Moving) -> Doubt | None:
    """The doubt to report if so little of the box `inside` (H, W) bool moves or is gone later that only colours tell the object from the
    background in `frame`, which is frame 0; else None."""
    near = within(window_of(inside, NEARBY), inside)
    boxed = cut(inside, near)
    if (boxed & (change_odds(frame, plate, moving, near) > 0.0)).sum() > MOVES * boxed.sum():
        return None
    return Doubt(
        1.0,
        "Next to nothing in the box is seen to move, so in the first frame only its colours tell the object from the background.",
        "Look at the outline, and mark it by --mask with a PNG if it is wrong, or take frames in which the object moves.",
    )


def change_odds(frame: np.ndarray, plate: Plate, moving: Moving, window: Window) -> np.ndarray:
    """Log odds (h, w) in `window` for pixels of `frame`, which is frame 0, that move or differ from the background."""
    return moving(window) + plate_odds(frame, plate, window)


def plate_odds(frame: np.ndarray, plate: Plate, window: Window) -> np.ndarray:
    """Log odds (h, w) in `window`: positive where `frame` differs from the background, negative for shadows and blurred rims, 0 where
    nothing differs or the background is unknown."""
    odds, known = against_plate(frame, plate, window, Contrast(), 0.0)
    return np.where(known, np.minimum(odds, MOTION_SURE), 0.0).astype(np.float32)
