"""Outline, tracks, held places and a scale bar, drawn over frames of the clip."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ...conventions import in_figures
from ...records import Observation
from .verdicts import Verdict

OUTLINE, TRACK, HELD, PROPOSED, TEXT = (80, 255, 80), (255, 200, 0), (255, 80, 60), (255, 120, 255), (255, 255, 255)
"""Colours, RGB."""

TAIL = 8
"""Number of earlier frames over which a track is drawn behind its point."""

FONT = cv2.FONT_HERSHEY_SIMPLEX
BESIDE, NARROW = 8, 400
"""Margin on either side of the text, and the width below which its lines are not indented [px]."""

NICE = (1.0, 2.0, 5.0)
"""Leading digits of a scale bar's length."""


class Canvas:
    """Draws an observation over frames of its clip, at any size."""

    def __init__(self, seen: Observation, proposed: np.ndarray | None, size: tuple[int, int]) -> None:
        """`proposed` (H, W) bool: where the object seems to be held; `size`: height and width [px] of the frames to draw over."""
        self._seen = seen
        self._shape = size[::-1]
        scale = np.array(self._shape) / (seen.camera.width, seen.camera.height)
        self._xy = (seen.xy + 0.5) * scale - 0.5
        self._width = max(1, round(min(size) / 400))
        held = [(place, color) for place, color in ((seen.pin, HELD), (proposed, PROPOSED)) if place is not None and place.any()]
        self._held = [(self._resize(place), color) for place, color in held]
        depth = seen.depth[np.isfinite(seen.depth)]
        self._pixels_per_metre = float(seen.camera.fx * scale[0] / np.median(depth)) if len(depth) else 0.0

    def draw_seen(self, frame: np.ndarray, t: int) -> np.ndarray:
        """Frame t of the clip with all that was seen in it, (h, w, 3) uint8 RGB; `frame`: the same, straightened, without it."""
        canvas, width = frame.copy(), self._width
        _outline(canvas, self._resize(np.asarray(self._seen.masks[t])), OUTLINE, width)
        for held, color in self._held:
            canvas[held] = (0.4 * canvas[held] + 0.6 * np.array(color)).astype(np.uint8)
            _outline(canvas, cv2.dilate(held.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0, color, width)
        since = max(0, t - TAIL)
        seen, paths = self._seen.visible[since : t + 1], np.round(self._xy[since : t + 1]).astype(np.int32)
        points = np.flatnonzero(seen[-1])
        cv2.polylines(canvas, [paths[seen[:, k], k].reshape(-1, 1, 2) for k in points], False, TRACK, width, cv2.LINE_AA)
        for x, y in paths[-1, points]:
            cv2.circle(canvas, (int(x), int(y)), width + 1, TRACK, -1, cv2.LINE_AA)
        _scale_bar(canvas, self._pixels_per_metre, width)
        return canvas

    def _resize(self, mask: np.ndarray) -> np.ndarray:
        return cv2.resize(mask.astype(np.uint8) * 255, self._shape, interpolation=cv2.INTER_AREA) >= 128


def with_verdicts(frame: np.ndarray, verdicts: Sequence[Verdict]) -> np.ndarray:
    """`frame` (H, W, 3) uint8 RGB with the verdicts as lines of text below it, none of which is wider than the frame."""
    size = float(np.clip(frame.shape[1] / 1400, 0.4, 0.8))
    line, room = round(34 * size), frame.shape[1] - 2 * BESIDE
    lines: list[tuple[str, tuple[int, int, int]]] = []
    for one in verdicts:
        color = TEXT if one.severity == 0.0 else (255, 190, 80) if one.severity < 1.0 else (255, 100, 90)
        lines += [(part, color) for part in _wrap(f"{one.item}: {one.verdict}. {one.because} {one.do}".strip(), room, size)]
    board = np.full((line * len(lines) + 10, frame.shape[1], 3), 28, np.uint8)
    above = round(24 * size) + 3  # as far as capital letters rise above the line, and a little more
    for row, (text, color) in enumerate(lines):
        cv2.putText(board, text, (BESIDE, line * row + above), FONT, size, color, 1, cv2.LINE_AA)
    return np.vstack([frame, board])


def _wrap(text: str, room: int, size: float) -> list[str]:
    """A text as lines of at most `room` pixels, of which all but the first are indented unless the frame is narrow."""
    indent, lines = "    " if room >= NARROW else "", [""]
    for word in text.split():
        rest = word
        while rest:
            begun = lines[-1].strip() != ""
            longer = f"{lines[-1]} {rest}" if begun else lines[-1] + rest
            if _width(longer, size) <= room:
                lines[-1], rest = longer, ""
            elif begun:
                lines.append(indent)
            else:  # a word wider than the frame
                fits = max((end for end in range(1, len(rest)) if _width(lines[-1] + rest[:end], size) <= room), default=1)
                lines[-1], rest = lines[-1] + rest[:fits], rest[fits:]
    return lines


def _width(text: str, size: float) -> int:
    return int(cv2.getTextSize(text, FONT, size, 1)[0][0])


def _outline(canvas: np.ndarray, mask: np.ndarray, color: tuple[int, int, int], width: int) -> None:
    lines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(canvas, lines, -1, color, width, cv2.LINE_AA)


def bar_label(length: float) -> str:
    """A scale bar's `length` [m] as a ruler would have it: in mm below 10 cm, in cm below 1 m, else in m."""
    unit, scale = ("mm", 1e-3) if length < 0.0999 else ("cm", 1e-2) if length < 0.999 else ("m", 1.0)
    return f"{in_figures(length / scale)} {unit}"


def _scale_bar(canvas: np.ndarray, pixels_per_metre: float, width: int) -> None:
    if pixels_per_metre <= 0.0:
        return
    longest = 0.25 * canvas.shape[1] / pixels_per_metre
    power = 10.0 ** np.floor(np.log10(longest))
    length = max(digit * power for digit in NICE if digit * power <= longest)
    y, x0, x1 = canvas.shape[0] - 14, 12, 12 + round(length * pixels_per_metre)
    for color, thick in (((0, 0, 0), 3 * width + 2), (TEXT, width + 1)):
        cv2.line(canvas, (x0, y), (x1, y), color, thick)
        words = bar_label(length)
        cv2.putText(canvas, words, (x0, y - 8), FONT, 0.5 * max(1, width), color, thick, cv2.LINE_AA)
