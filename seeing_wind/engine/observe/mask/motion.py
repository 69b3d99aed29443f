"""How the object moved between two frames: first one shift for the whole object, then dense optical flow round that shift; and windows."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...masks import Masks, box_of

Window = tuple[int, int, int, int]
"""x0, y0, x1, y1 [px], x1 and y1 exclusive; may reach outside the frame."""

TEMPLATE = 40
"""Pixels along the longer side of the template that the whole-body search uses."""

FLOW_PIXELS = 260_000
"""Window area [px] beyond which flow is computed on a smaller copy, to keep a frame under half a second."""

ROUGH_PIXELS = 30_000
"""The same where approximate motion is enough: a silhouette and anchored tracks are refined afterwards anyway."""


@dataclass(frozen=True)
class Flow:
    """Motion from one frame to the next inside a window, at the resolution at which it was computed."""

    x0: float
    y0: float
    """The window's top left corner [px]."""
    motion: np.ndarray
    """(h, w, 2) float32 [px], at h rows of w samples that cover the window."""
    scale: tuple[float, float] = (1.0, 1.0)
    """Distance [px] between neighbouring samples, along x and y."""

    def at(self, xy: np.ndarray) -> np.ndarray:
        """Motion (K, 2) [px] at the points `xy` (K, 2) [px], interpolated bilinearly; outside the window, that of its rim."""
        if not len(xy):
            return np.zeros((0, 2))
        local = ((xy - [self.x0, self.y0] + 0.5) / self.scale - 0.5).astype(np.float32).reshape(-1, 1, 2)
        # remap's maps are limited to 32767 rows; tracks are hundreds.
        return cv2.remap(self.motion, local, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(-1, 2).astype(np.float64)

    def over(self, window: Window) -> np.ndarray:
        """Motion (h, w, 2) float32 [px] of all pixels in `window`, interpolated as in `at`."""
        size = (window[2] - window[0], window[3] - window[1])
        low = [(start - begin + 0.5) / one - 0.5 for start, begin, one in zip(window, (self.x0, self.y0), self.scale)]
        inverse = np.array([[1.0 / self.scale[0], 0.0, low[0]], [0.0, 1.0 / self.scale[1], low[1]]])
        return cv2.warpAffine(self.motion, inverse, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE)

    def of(self, part: np.ndarray, window: Window) -> np.ndarray:
        """Motion (N, 2) float32 [px] of the pixels of `part` (h, w) bool in `window`, row by row."""
        # Both components as one complex number: NumPy selects these ten times as fast as pairs.
        return self.over(window).view(np.complex64)[..., 0][part].view(np.float32).reshape(-1, 2)


def window_of(mask: np.ndarray, margin: int) -> Window:
    """The bounding box of `mask` (H, W) bool, `margin` pixels wider on each side."""
    x0, y0, x1, y1 = box_of(mask)
    return x0 - margin, y0 - margin, x1 + margin, y1 + margin


def shifted(window: Window, dx: int, dy: int) -> Window:
    """`window` moved by `dx` and `dy` pixels."""
    x0, y0, x1, y1 = window
    return x0 + dx, y0 + dy, x1 + dx, y1 + dy


def window_of_all(masks: Masks, margin: int) -> Window:
    """The smallest window that contains all `masks` (T+1, H, W), at least one of them not empty, `margin` pixels wider on each side."""
    seen = masks.windows[masks.windows[:, 2] > 0].astype(int)
    (x0, y0), (x1, y1) = seen[:, :2].min(axis=0) - margin, seen[:, 2:].max(axis=0) + margin
    return int(x0), int(y0), int(x1), int(y1)


def joined(window: Window, other: Window) -> Window:
    """The smallest window that contains both `window` and `other`."""
    (x0, y0, x1, y1), (a0, b0, a1, b1) = window, other
    return min(x0, a0), min(y0, b0), max(x1, a1), max(y1, b1)


def placed(part: np.ndarray, window: Window, where: Window) -> np.ndarray:
    """`part` (h, w) bool, given in `window`, in the window `where`; False where `part` has no pixels."""
    values = np.zeros((where[3] - where[1], where[2] - where[0]), bool)
    if part.size:
        paste(values, part, shifted(window, -where[0], -where[1]))
    return values


def within(window: Window, frame: np.ndarray) -> Window:
    """The part of `window` that lies in `frame` (H, W, ...); without area if none does."""
    height, width = frame.shape[:2]
    x0, y0, x1, y1 = window
    return min(max(x0, 0), width), min(max(y0, 0), height), max(min(x1, width), 0), max(min(y1, height), 0)


def band_of(area: float) -> float:
    """Distance [px] by which the border of a silhouette of `area` [px] may be off after it was carried from one frame to the next."""
    return float(np.clip(0.06 * np.sqrt(area), 2.0, 9.0))


def middle_of(mask: np.ndarray) -> np.ndarray:
    """The centroid x, y (2,) [px] of `mask` (H, W) bool, which is not empty."""
    x0, y0, x1, y1 = window_of(mask, 0)
    moments = cv2.moments(mask[y0:y1, x0:x1].astype(np.uint8), binaryImage=True)
    return np.array([x0 + moments["m10"] / moments["m00"], y0 + moments["m01"] / moments["m00"]])


def median_of(values: np.ndarray) -> float:
    """The median of `values` (N,), N > 0. The same as NumPy's, which partitions at three places and takes ten times as long."""
    middle = len(values) // 2
    ordered = np.partition(values, middle)
    return float(ordered[middle] if len(values) % 2 else 0.5 * (ordered[:middle].max() + ordered[middle]))


def cut(frame: np.ndarray, window: Window, border: int = cv2.BORDER_REPLICATE) -> np.ndarray:
    """The part of `frame` (H, W, ...) in `window`; outside the frame its rim is repeated (zeros with cv2.BORDER_CONSTANT)."""
    height, width = frame.shape[:2]
    x0, y0, x1, y1 = window
    # Clipped so that the slice is never empty: a window far outside is filled from the rim's nearest pixels.
    a0, b0 = min(max(x0, 0), width - 1), min(max(y0, 0), height - 1)
    a1, b1 = max(min(x1, width), a0 + 1), max(min(y1, height), b0 + 1)
    part = frame[b0:b1, a0:a1]
    pads = (max(0, b0 - y0), max(0, y1 - b1), max(0, a0 - x0), max(0, x1 - a1))
    if any(pads):
        values = part.astype(np.uint8) if part.dtype == bool else part
        part = cv2.copyMakeBorder(values, *pads, borderType=border).astype(frame.dtype)
    top, left = max(0, y0 - b0), max(0, x0 - a0)
    return part[top : top + y1 - y0, left : left + x1 - x0]


def paste(target: np.ndarray, values: np.ndarray, window: Window) -> None:
    """Write `values` (h, w), given in `window`, into `target` (H, W), without what lies outside it."""
    height, width = target.shape[:2]
    x0, y0, x1, y1 = window
    a0, b0, a1, b1 = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
    if a1 > a0 and b1 > b0:
        target[b0:b1, a0:a1] = values[b0 - y0 : b1 - y0, a0 - x0 : a1 - x0]


def body_shift(
    template: np.ndarray,
    weight: np.ndarray,
    origin: tuple[int, int],
    frame: np.ndarray,
    expected: np.ndarray,
    reach: float,
) -> np.ndarray:
    """The shift (2,) [px] that carries the whole object into the next frame.

    Masked template matching: root mean squared colour difference, plus a mild pull towards the expected shift.

    Args:
        template: (h, w, 3) uint8, the pixels of the object's bounding box in the frame before.
        weight: (h, w) bool, the object in it.
        origin: x, y [px] of the template's top left corner in its frame.
        frame: (H, W, 3) uint8, the next frame.
        expected: (2,) [px], the expected shift.
        reach: [px] searched on each side of the expected shift.
    """
    scale = min(1.0, TEMPLATE / max(weight.shape))
    reach = int(np.ceil(reach))
    base = np.round(expected).astype(int)
    height, width = weight.shape
    x0, y0 = origin[0] + base[0] - reach, origin[1] + base[1] - reach
    window = (x0, y0, x0 + width + 2 * reach, y0 + height + 2 * reach)
    size = (max(3, round(width * scale)), max(3, round(height * scale)))
    room = (max(size[0], round((width + 2 * reach) * scale)), max(size[1], round((height + 2 * reach) * scale)))
    object_colors = cv2.resize(template, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    inside = cv2.resize(weight.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    search = cv2.resize(cut(frame, window), room, interpolation=cv2.INTER_AREA).astype(np.float32)
    colour_mask = np.repeat(inside[..., None], 3, axis=2)
    cost = cv2.matchTemplate(search, object_colors, cv2.TM_SQDIFF, mask=colour_mask) / max(float((colour_mask**2).sum()), 1e-6)
    cost = np.sqrt(np.maximum(cost, 0.0))
    step = (window[2] - window[0]) / room[0]
    y, x = np.mgrid[: cost.shape[0], : cost.shape[1]]
    shifts = np.stack([x * step - reach, y * step - reach], axis=-1)
    # The pull costs five grey levels at the rim of the search: it only decides between nearly equal matches.
    cost += 5.0 * np.linalg.norm(shifts, axis=-1) / max(reach, 1)
    row, column = np.unravel_index(int(np.argmin(cost)), cost.shape)
    return base + shifts[row, column]


class FlowSolver:
    """Dense inverse search flow (Kroeger 2016) round a known shift, in the object's window only."""

    def __init__(self, *, rough: bool = False) -> None:
        """`rough`: approximate motion is enough."""
        self._pixels = ROUGH_PIXELS if rough else FLOW_PIXELS
        self._solver = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        self._solver.setFinestScale(0)
        if rough:
            self._solver.setPatchStride(4)
            self._solver.setGradientDescentIterations(16)
            self._solver.setVariationalRefinementIterations(2)

    def between(self, before: np.ndarray, after: np.ndarray, window: Window, shift: np.ndarray) -> Flow:
        """Flow in `window` from the grey frame `before` to `after`, both (H, W) uint8; the object moves by about `shift` (2,) [px]."""
        dx, dy = (int(value) for value in np.round(shift))
        x0, y0, x1, y1 = window
        first, second = cut(before, window), cut(after, (x0 + dx, y0 + dy, x1 + dx, y1 + dy))
        scale = min(1.0, float(np.sqrt(self._pixels / first.size)))
        height, width = first.shape
        if scale < 1.0:
            size = (round(width * scale), round(height * scale))
            first, second = (cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in (first, second))
        motion = self._solver.calc(np.ascontiguousarray(first), np.ascontiguousarray(second), None)
        factor = (width / first.shape[1], height / first.shape[0])
        return Flow(x0, y0, motion * np.array(factor, np.float32) + np.array([dx, dy], np.float32), factor)
