"""What speaks for each pixel being the object, in log odds that add up: the background behind it, its colours, the silhouette before.

A sum of such evidence is smoothed along the frame's edges (guided filter, He 2013) and cut at zero: a labelling as a graph cut gives it
(Rhemann 2011) at a fixed, small cost, and with any evidence.
"""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from .background import Plate
from .cutting import enclosed, grown, narrowed, opened, widened
from .motion import Window, cut, window_of
from .rim import core

DIFFERS = 3.0
"""Times the noise from which a pixel differs from the background."""

SURE = 4.0
"""Log odds that the background alone can give: a silhouette far away or a box still outweighs them."""

SMALL = 400
"""Pixels below which most of an object is rim."""

FEW = 900
"""Pixels below which an object has too few colours to be told by them from another thing."""

APART = 4.0
"""Log odds against another thing beside the object."""

CARRIED, CARRIED_BLIND = 2.0, 1.2
"""Most log odds for an expected silhouette, where the background is known and where only colours speak, which are less sure: what is wrong
in it goes away again."""

BESIDE_PLATE = 0.45
"""Weight of colours where the background is known."""

STAYS = 0.7
"""Log odds at its very border for a silhouette that was carried on: what says little does not wear it away."""

RIM = 3.5
"""Pixels over which a lens and a codec spread the object's rim: there the object ends where half of its contrast is left."""

LEVELS = (1.0, 2.0, DIFFERS, 4.5, 6.5, 9.0, 13.0, 18.0, 26.0, 40.0, 60.0)
"""Bounds of the classes of difference from the background [times the noise]."""

LEVEL = np.digitize(np.arange(256) / 4.0, LEVELS).astype(np.uint8)
"""The class of every quarter of the noise: a table is ten times quicker than a search."""

LOW = 3
"""Classes of what does not differ."""

FRONT, BEHIND = (0.25, 0.72, (0.015, 0.015)), (0.75, 0.1, (0.05, 0.1))
"""Usual shares, of an object and of its surroundings: what does not differ, what does, and a shadow that came or went.

How they spread over the classes: evenly, but what differs in the surroundings is halved from each class to the next.
"""

SAMPLES = 0.15
"""Weight of the usual shares, in units of the samples of this clip."""

OWN = 0.35
"""Least part of an object that is no shadow, if what looks like one at its side is to be one."""

COLORS = 12
"""Bins per channel of the colour histograms."""

BIN = np.arange(256, dtype=np.uint16) * COLORS // 256 * np.array([[COLORS**2], [COLORS], [1]], np.uint16)
"""What each channel's value adds to the number of a colour's bin, (3, 256)."""

NO_EDGE = 10.0
"""Grey levels of contrast below which there is no edge."""

COLOR_SURE = 2.5
"""Log odds that a colour can give."""


class Colors:
    """Which colours are the object's rather than its surroundings', from smoothed histograms."""

    def __init__(self, inside: np.ndarray, outside: np.ndarray) -> None:
        """`inside` (N, 3) and `outside` (M, 3) uint8: samples of both."""
        counts = [np.bincount(self._bins(part), minlength=COLORS**3).reshape(3 * (COLORS,)) for part in (inside, outside)]
        density = [_smoothed(one, 0.7, range(3)) / max(one.sum(), 1) + 2e-5 for one in counts]
        self._odds = np.clip(np.log(density[0] / density[1]), -COLOR_SURE, COLOR_SURE).ravel().astype(np.float32)

    @staticmethod
    def _bins(colors: np.ndarray) -> np.ndarray:
        # Of samples (N, 3), OpenCV would take the channels for columns.
        planes = cv2.split(colors if colors.ndim == 3 else colors.reshape(-1, 1, 3))
        red, green, blue = (cv2.LUT(plane, table) for plane, table in zip(planes, BIN))
        return (red + green + blue).reshape(colors.shape[:-1]).astype(np.intp)

    def odds(self, frame: np.ndarray) -> np.ndarray:
        """(h, w) float32 log odds of the colours of `frame` (h, w, 3) uint8."""
        return self._odds[self._bins(frame)]


class Contrast:
    """How an object and its surroundings differ from the background, learnt from one frame.

    The surroundings differ, too: by shadows, gleams, and what a codec leaves round all that moves. How much of each there is belongs to
    the clip, so shares of classes are counted: eleven bounds of difference, each with and without a change of light.
    """

    def __init__(self, plate: Plate | None = None, seen: Iterable[tuple[np.ndarray, np.ndarray]] = ()) -> None:
        """`seen`: frames (H, W, 3) uint8 before `plate`, each with the object (H, W) bool in it; without them, what is usual."""
        inside, beside = [np.zeros(0, np.uint8)], [np.zeros(0, np.uint8)]
        for frame, mask in seen:
            assert plate is not None  # without one, nothing can be seen before it
            window = window_of(mask, 8 + int(0.35 * np.sqrt(np.count_nonzero(mask))))
            classes, known = _classes(*plate.compared(frame, window), plate.noise), cut(plate.reliable, window, cv2.BORDER_CONSTANT)
            whole = cut(mask, window, cv2.BORDER_CONSTANT)
            shape = _unshaded(whole, classes % 3 > 0)
            # What lies beyond the steepest edges may be a shadow or a codec's smear that was taken in. The rim is both.
            own = shape & core(cv2.GaussianBlur(cut(frame, window), (0, 0), 1.0), whole)
            inside.append(classes[narrowed(own, 1) & known])
            beside.append(classes[~widened(shape, 2) & ~enclosed(shape) & known])
        front = self._learnt(np.concatenate(inside), self._usual(*FRONT, 1.0))
        behind = self._learnt(np.concatenate(beside), self._usual(*BEHIND, 0.5))
        self._odds = np.zeros(256, np.float32)  # as OpenCV wants its tables
        self._odds[: front.size] = np.clip(np.log(front / behind), -SURE, SURE).ravel()

    def odds(self, away: np.ndarray, light: np.ndarray, noise: float) -> np.ndarray:
        """(h, w) float32 log odds of what `Plate.compared` gives."""
        return cv2.LUT(_classes(away, light, noise), self._odds)

    @staticmethod
    def _usual(same: float, differs: float, relit: tuple[float, float], fall: float) -> np.ndarray:
        """Shares (levels, 3): light unchanged, brighter, darker."""
        high = len(LEVELS) + 1 - LOW
        spread = fall ** np.arange(high)
        shares = np.full((LOW + high, 3), 1e-4)
        shares[:LOW, 0], shares[LOW:, 0], shares[LOW:, 1:] = same / LOW, differs * spread / spread.sum(), np.array(relit) / high
        return shares

    @staticmethod
    def _learnt(classes: np.ndarray, usual: np.ndarray) -> np.ndarray:
        counts = _smoothed(np.bincount(classes, minlength=usual.size).reshape(usual.shape), 0.6, (0,))
        weight = SAMPLES * counts.sum() + 10.0
        return (counts + weight * usual) / (counts.sum() + weight)


def _smoothed(counts: np.ndarray, bins: float, axes: Iterable[int]) -> np.ndarray:
    """A histogram blurred by `bins` along some of its axes, float64; SciPy's filter is the same, but slow to import."""
    size, smooth = 2 * round(4.0 * bins) + 1, counts.astype(np.float64)
    for axis in axes:
        rows = np.ascontiguousarray(np.moveaxis(smooth, axis, 0).reshape(smooth.shape[axis], -1))
        rows = cv2.GaussianBlur(rows, (1, size), sigmaX=bins, sigmaY=bins, borderType=cv2.BORDER_REFLECT)
        smooth = np.moveaxis(rows.reshape(np.moveaxis(smooth, axis, 0).shape), 0, axis)
    return smooth


def _classes(away: np.ndarray, light: np.ndarray, noise: float) -> np.ndarray:
    """Class (h, w) uint8 of a difference `away` (h, w) float32 and a change of `light` (h, w) int8."""
    level = cv2.LUT(np.minimum(away * np.float32(4.0 / noise), np.float32(255.0)).astype(np.uint8), LEVEL)
    turned = light + np.int8(3) * (light < 0).view(np.int8)
    return np.uint8(3) * level + (turned * (level >= LOW).view(np.int8)).view(np.uint8)


def _unshaded(shape: np.ndarray, relit: np.ndarray) -> np.ndarray:
    """The object `shape` (h, w) bool without what hangs on it and may be its shadow; all of it where little else would be left.

    What is `relit` but enclosed by the rest is no shadow: a shadow lies beside the thing that casts it.
    """
    size = max(3, int(0.1 * np.sqrt(np.count_nonzero(shape)))) | 1
    own = opened(shape & ~relit).astype(np.uint8)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    own = np.pad(cv2.morphologyEx(np.pad(own, size), cv2.MORPH_CLOSE, kernel)[size:-size, size:-size], 1)
    _, labels = cv2.connectedComponents(1 - own, connectivity=4)
    filled = (labels != labels[0, 0])[1:-1, 1:-1] & shape
    return filled if np.count_nonzero(filled) > OWN * np.count_nonzero(shape) else shape


def against_plate(
    frame: np.ndarray, plate: Plate, window: Window, contrast: Contrast, least: float = -SURE
) -> tuple[np.ndarray, np.ndarray]:
    """Log odds (h, w) in `window` by what differs from the background, and where that is known (h, w) bool.

    What does not differ speaks against the object with `least` at most. At a rim, the object ends at half of its contrast.
    """
    away, light = plate.compared(frame, window)
    known = cut(plate.reliable, window, cv2.BORDER_CONSTANT)
    odds = contrast.odds(away, light, plate.noise)
    if least > -SURE:
        odds = np.where(away < DIFFERS * plate.noise, np.maximum(odds, least), odds)
    depth = cv2.distanceTransform((odds > 0.0).astype(np.uint8), cv2.DIST_L2, 3)
    reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * int(RIM) + 1, 2 * int(RIM) + 1))
    inside = cv2.dilate(away, reach)
    half = np.clip((away - 0.5 * inside) / plate.noise, -SURE, SURE)
    return np.where(depth <= RIM, np.minimum(odds, half), odds).astype(np.float32, copy=False), known


def against_shape(shape: np.ndarray, band: float) -> np.ndarray:
    """Log odds (h, w) by the distance to the border of an expected silhouette `shape` (h, w) bool.

    For each `band` [px] they fall by 1.5 outside and rise by 3 inside. What ends at the edge of the window is taken to go on there.
    """
    one = shape.astype(np.uint8)
    within = cv2.distanceTransform(one, cv2.DIST_L2, 5)
    beyond = cv2.distanceTransform(1 - one, cv2.DIST_L2, 5)
    # Each distance is 0 on the other's side.
    odds = cv2.addWeighted(within, 3.0 / band, beyond, -1.5 / band, -STAYS) + one * np.float32(2.0 * STAYS)
    return np.clip(odds, -SURE - 1.0, SURE)


def weighed(
    expected: np.ndarray,
    seen: tuple[np.ndarray, np.ndarray] | None,
    colors: np.ndarray,
    other: np.ndarray,
    motion: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Log odds (h, w) by all evidence: that of an `expected` silhouette, what `against_plate` has `seen` if a background is known, that of
    `colors` and of `motion`, (h, w) each, and `other` (h, w) bool, another thing.

    Where the background is known, it says more than colours and motion do. But it does not tell the object from another thing beside it.
    """
    if seen is None:
        return np.minimum(expected, CARRIED_BLIND) + colors
    behind, known = seen
    beside = grown(other)
    known = known & ~((behind > 0.0) & beside)
    there = np.minimum(expected, CARRIED) + behind + BESIDE_PLATE * colors
    return np.where(known, there, np.minimum(expected, CARRIED_BLIND) + colors + motion * ~beside) - APART * other


def cut_out(odds: np.ndarray, frame: np.ndarray, area: float) -> np.ndarray:
    """(h, w) bool where `odds` (h, w), smoothed along the edges of `frame` (h, w, 3) uint8, are positive: He's guided filter.

    It is narrow for an expected `area` [px] that is SMALL: on the round rim of a small thing, what surrounds it is the majority.
    """
    guide = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    values, across = np.clip(odds, -2.0 * SURE, 2.0 * SURE).astype(np.float32), 3 if area < SMALL else 5

    def mean(of: np.ndarray) -> np.ndarray:
        return cv2.blur(of, (across, across))

    middle, level = mean(guide), mean(values)
    slope = (mean(guide * values) - middle * level) / (mean(guide * guide) - middle**2 + NO_EDGE**2)
    return mean(slope) * guide + mean(level - slope * middle) > 0.0
