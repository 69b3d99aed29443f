"""Defects of a clip that show in its frames: black frames, a cut to another shot, motion blur, an object that leaves the frame."""

from __future__ import annotations

import cv2
import numpy as np

from ...conventions import frame_named
from ...errors import ClipError
from ...masks import Masks, at_rim, box_of, rows_columns
from ...progress import Progress
from .stored import Frames

BLACK = 12.0
"""Brightest grey level (smoothed) up to which a frame is black: codecs write 16 for black, which is read back as 0 with noise."""

SMALL = (64, 48)
"""Width and height [px] of the copies in which cuts are sought: motion inside a shot changes them little."""

CUT_JUMP = 12.0
"""Mean difference between neighbouring frames [grey levels] from which a cut is possible."""

CUT_RATIO = 6.0
"""Least difference across a cut, in units of the clip's median difference between neighbouring frames."""

CUT_LIKENESS = 0.5
"""Correlation between two frames below which there may be a cut; it stays higher when a light is switched."""

BLURRED = 0.35
"""Sharpness (variance of the Laplacian on the object), relative to the object's best, below which a frame counts as blurred."""

FAST = 0.03
"""The object's step from frame to frame, in units of its size, from which blur is attributed to motion."""


def check_frames(frames: Frames, first_frame: int, progress: Progress) -> None:
    """Raise an error for defects that make any result meaningless.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; first_frame: index in the file of frame 0.

    Raises:
        ClipError: the clip is black, or cuts from one shot to another.
    """
    small = np.empty((len(frames), SMALL[1], SMALL[0]), np.float32)
    for t, frame in enumerate(frames):
        progress.check()
        small[t] = cv2.cvtColor(cv2.resize(frame, SMALL, interpolation=cv2.INTER_AREA), cv2.COLOR_RGB2GRAY)
    bright = small.max(axis=(1, 2))
    if bright.max() < BLACK:
        raise ClipError("The clip is black.", "Was the lens covered? Export it again, or choose another range of --frames.")
    if bright[0] < BLACK:
        light = int(np.flatnonzero(bright >= BLACK)[0])
        raise ClipError(
            f"The clip begins with {light} black frames.", f"Begin where something is seen: --frames {first_frame + light}:..."
        )
    cut = _frame_before_cut(small)
    if cut is not None:
        before, after, last = first_frame + cut, first_frame + cut + 1, first_frame + len(frames) - 1
        shots = [f"--frames {begin}:{end}" for begin, end in ((first_frame, before), (after, last)) if end > begin]
        raise ClipError(
            f"The clip cuts to another shot between its frames {before} and {after}.",
            f"Choose one shot: {' or '.join(shots)}." if shots else "Film it again, or choose another range of --frames.",
        )


def _frame_before_cut(small: np.ndarray) -> int | None:
    """The last frame before the first cut in `small` (T+1, h, w); None if there is no cut."""
    jump = np.abs(np.diff(small, axis=0)).mean(axis=(1, 2))
    usual = float(np.median(jump)) if len(jump) > 2 else 0.0
    for t in np.flatnonzero((jump > CUT_JUMP) & (jump > CUT_RATIO * usual)):
        a, b = small[t] - small[t].mean(), small[t + 1] - small[t + 1].mean()
        likeness = float((a * b).sum() / max(np.sqrt((a**2).sum() * (b**2).sum()), 1e-6))
        if likeness < CUT_LIKENESS:
            return int(t)
    return None


def warn_of_defects(frames: Frames, masks: Masks, progress: Progress) -> None:
    """Warn of defects that make the result less certain: the object reaches over the frame's edge, or is blurred by its motion.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; masks: (T+1, H, W) bool, the object.
    """
    rim = np.array([at_rim(mask) for mask in masks])
    if rim[0]:
        progress.warn("The object reaches over the edge of the first frame: the part outside has no mass in the result.", judged=True)
    elif rim.any():
        progress.warn(f"From {frame_named(int(np.flatnonzero(rim)[0]))} on the object is partly out of view, and fewer points are tracked.")
    blurred = _blurred_frames(frames, masks, progress)
    if len(blurred):
        progress.warn(
            f"The object is blurred by its motion in {len(blurred)} of {len(frames)} frames, first in {frame_named(blurred[0])}: "
            "a shorter exposure gives better tracks."
        )


def _blurred_frames(frames: Frames, masks: Masks, progress: Progress) -> np.ndarray:
    """The numbers of the frames in which the object moves fast and is much less sharp than at its best."""
    sharp, middle = np.full(len(frames), np.nan), np.full((len(frames), 2), np.nan)
    size = float(np.sqrt(max(masks[0].sum(), 1)))
    for t, (frame, mask) in enumerate(zip(frames, masks)):
        progress.check()
        if not mask.any():
            continue
        part = rows_columns(box_of(mask))
        inside = cv2.erode(mask[part].astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=0) > 0
        if inside.sum() < 100:
            continue
        gray = cv2.GaussianBlur(cv2.cvtColor(np.ascontiguousarray(frame[part]), cv2.COLOR_RGB2GRAY), (0, 0), 1.0)
        sharp[t] = cv2.Laplacian(gray, cv2.CV_32F)[inside].var()
        middle[t] = np.flatnonzero(mask.any(axis=0)).mean(), np.flatnonzero(mask.any(axis=1)).mean()
    if np.isfinite(sharp).sum() < 3:
        return np.zeros(0, int)
    step = np.linalg.norm(np.gradient(middle, axis=0), axis=1) / size
    best = np.nanpercentile(sharp, 90)
    # A plain object is never sharp: its Laplacian is only noise.
    return np.flatnonzero((sharp < BLURRED * best) & (step > FAST)) if best > 20.0 else np.zeros(0, int)
