"""Outline, tracks, held places and a scale bar, drawn over pictures of the clip."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ...records import Observation
from .verdicts import Verdict

OUTLINE, TRACK, HELD, PROPOSED, TEXT = (80, 255, 80), (255, 200, 0), (255, 80, 60), (255, 120, 255), (255, 255, 255)
"""Colours, RGB."""

TAIL = 8
"""Pictures of a track that are drawn behind its point."""

NICE = (1.0, 2.0, 5.0)
"""Leading digits of a scale bar's length."""


def drawn(seen: Observation, picture: np.ndarray, t: int, proposed: np.ndarray | None) -> np.ndarray:
    """`picture` (H, W, 3) uint8 RGB, picture t of the clip, with all that was seen in it."""
    canvas = picture.copy()
    width = max(1, round(min(canvas.shape[:2]) / 400))
    _outline(canvas, np.asarray(seen.masks[t]), OUTLINE, width)
    for held, color in ((seen.pin, HELD), (proposed, PROPOSED)):
        if held is not None and held.any():
            canvas[held] = (0.4 * canvas[held] + 0.6 * np.array(color)).astype(np.uint8)
            _outline(canvas, cv2.dilate(held.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0, color, width)
    for k in np.flatnonzero(seen.visible[t]):
        since = [s for s in range(max(0, t - TAIL), t + 1) if seen.visible[s, k]]
        path = np.round(seen.xy[since, k]).astype(np.int32)
        cv2.polylines(canvas, [path.reshape(-1, 1, 2)], False, TRACK, width, cv2.LINE_AA)
        cv2.circle(canvas, (int(path[-1, 0]), int(path[-1, 1])), width + 1, TRACK, -1, cv2.LINE_AA)
    _scale_bar(canvas, _pixels_per_metre(seen), width)
    return canvas


def with_verdicts(picture: np.ndarray, verdicts: Sequence[Verdict]) -> np.ndarray:
    """`picture` (H, W, 3) with the verdicts in lines below it."""
    size = float(np.clip(picture.shape[1] / 1400, 0.4, 0.8))
    line = round(34 * size)
    lines: list[tuple[str, tuple[int, int, int]]] = []
    for one in verdicts:
        color = TEXT if one.severity == 0.0 else (255, 190, 80) if one.severity < 1.0 else (255, 100, 90)
        lines += [(part, color) for part in _wrapped(f"{one.item}: {one.verdict}. {one.because} {one.do}".strip(), picture.shape[1], size)]
    board = np.full((line * len(lines) + 10, picture.shape[1], 3), 28, np.uint8)
    for row, (text, color) in enumerate(lines):
        cv2.putText(board, text, (8, line * (row + 1) - 6), cv2.FONT_HERSHEY_SIMPLEX, size, color, 1, cv2.LINE_AA)
    return np.vstack([picture, board])


def _wrapped(text: str, width: int, size: float) -> list[str]:
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        fits = cv2.getTextSize(longer, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0] < width - 16
        lines = [*lines[:-1], longer] if fits or not lines[-1] else [*lines, f"    {word}"]
    return lines


def _outline(canvas: np.ndarray, mask: np.ndarray, color: tuple[int, int, int], width: int) -> None:
    lines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(canvas, lines, -1, color, width, cv2.LINE_AA)


def _pixels_per_metre(seen: Observation) -> float:
    depth = seen.depth[np.isfinite(seen.depth)]
    return float(seen.camera.fx / np.median(depth)) if len(depth) else 0.0


def _scale_bar(canvas: np.ndarray, pixels_per_metre: float, width: int) -> None:
    if pixels_per_metre <= 0.0:
        return
    longest = 0.25 * canvas.shape[1] / pixels_per_metre
    power = 10.0 ** np.floor(np.log10(longest))
    length = max(digit * power for digit in NICE if digit * power <= longest)
    y, x0, x1 = canvas.shape[0] - 14, 12, 12 + round(length * pixels_per_metre)
    for color, thick in (((0, 0, 0), 3 * width + 2), (TEXT, width + 1)):
        cv2.line(canvas, (x0, y), (x1, y), color, thick)
        words = f"{length:g} m" if length >= 1.0 else f"{100 * length:g} cm"
        cv2.putText(canvas, words, (x0, y - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.5 * max(1, width), color, thick, cv2.LINE_AA)
