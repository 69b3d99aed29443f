"""Evidence that a pixel belongs to the object, in log odds that add up: from the background, the colours, and the expected silhouette.

The sum is smoothed along the frame's edges (guided filter, He 2013) and thresholded at zero: this gives a labelling like a graph cut's
(Rhemann 2011) at a fixed, small cost, whatever the evidence is.
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
"""Difference from the background from which a pixel is taken to differ [times the noise]."""

SURE = 4.0
"""Largest log odds that the background alone can give: the distance from an expected silhouette, or a box, can still outweigh them."""

SMALL = 400
"""Area [px] below which most of an object is rim."""

FEW = 900
"""Area [px] below which an object has too few colours to tell it from another thing."""

APART = 4.0
"""Log odds against a pixel of another thing beside the object."""

CARRIED, CARRIED_BLIND = 2.0, 1.2
"""Largest log odds that an expected silhouette can give, where the background is known and where only the colours, which are less reliable,
are: so small that mistakes in the silhouette are undone again."""

BESIDE_PLATE = 0.45
"""Weight of colours where the background is known."""

STAYS = 0.7
"""Log odds that an expected silhouette gives right at its border, so that weak evidence does not wear it away from frame to frame."""

SEGMENTED, SEGMENTED_BEFORE, SEGMENTED_RIM = 8.0, 4.0, 1.5
"""Log odds that a network's outline gives in its own frame, and after it was carried to later ones; and the distance [px] from its border
at which it gives them. In its own frame it outweighs a background or colours that contradict it, but not both and the silhouette, too."""

RIM = 3.5
"""Width [px] over which a lens and a codec blur the object's rim: within it, the object ends where half of its contrast is left."""

LEVELS = (1.0, 2.0, DIFFERS, 4.5, 6.5, 9.0, 13.0, 18.0, 26.0, 40.0, 60.0)
"""Bounds of the classes of difference from the background [times the noise]."""

LEVEL = np.digitize(np.arange(256) / 4.0, LEVELS).astype(np.uint8)
"""Class of each difference, in quarters of the noise: a table is ten times quicker than a search."""

LOW = 3
"""Number of classes that count as not different."""

FRONT, BEHIND = (0.25, 0.72, (0.015, 0.015)), (0.75, 0.1, (0.05, 0.1))
"""Usual fractions of the pixels of an object, and of its surroundings: not different, different, and (brighter, darker) by a shadow.

Each fraction is spread evenly over its classes, except that of different pixels in the surroundings, which halves from class to class.
"""

SAMPLES = 0.15
"""Weight of the usual fractions, in units of the number of samples from this clip."""

OWN = 0.35
"""Fraction of an object that must remain for what looks like an attached shadow to be taken for one."""

COLORS = 12
"""Bins per channel of the colour histograms."""

BIN = np.arange(256, dtype=np.uint16) * COLORS // 256 * np.array([[COLORS**2], [COLORS], [1]], np.uint16)
"""What each value of each channel adds to the index of a colour's bin, (3, 256)."""

NO_EDGE = 10.0
"""Contrast below which there is no edge [grey levels]."""

COLOR_SURE = 2.5
"""Largest log odds that a colour can give."""


class Colors:
    """Log odds of each colour being the object's rather than its surroundings', from smoothed histograms."""

    def __init__(self, inside: np.ndarray, outside: np.ndarray) -> None:
        """`inside` (N, 3) and `outside` (M, 3) uint8: colours sampled from the object and from its surroundings."""
        counts = [np.bincount(self._bins(part), minlength=COLORS**3).reshape(3 * (COLORS,)) for part in (inside, outside)]
        density = [_smoothed(one, 0.7, range(3)) / max(one.sum(), 1) + 2e-5 for one in counts]
        self._odds = np.clip(np.log(density[0] / density[1]), -COLOR_SURE, COLOR_SURE).ravel().astype(np.float32)

    @staticmethod
    def _bins(colors: np.ndarray) -> np.ndarray:
        # OpenCV would take the channels of samples (N, 3) for columns.
        planes = cv2.split(colors if colors.ndim == 3 else colors.reshape(-1, 1, 3))
        red, green, blue = (cv2.LUT(plane, table) for plane, table in zip(planes, BIN))
        return (red + green + blue).reshape(colors.shape[:-1]).astype(np.intp)

    def odds(self, frame: np.ndarray) -> np.ndarray:
        """(h, w) float32 log odds of the colours of `frame` (h, w, 3) uint8."""
        return self._odds[self._bins(frame)]


class Contrast:
    """How much an object and its surroundings each differ from the background, learnt from one or more frames.

    The surroundings differ, too: by shadows, reflections, and the artefacts that a codec leaves round all that moves. How common these are
    depends on the clip, so pixels are counted in classes: levels of difference, each with and without a change of light.
    """

    def __init__(self, plate: Plate | None = None, seen: Iterable[tuple[np.ndarray, np.ndarray]] = ()) -> None:
        """`seen`: frames (H, W, 3) uint8 to compare with `plate`, each with the object's mask (H, W) bool; without any, the usual fractions
        are taken."""
        inside, beside = [np.zeros(0, np.uint8)], [np.zeros(0, np.uint8)]
        for frame, mask in seen:
            assert plate is not None  # without one, there is nothing to compare with
            window = window_of(mask, 8 + int(0.35 * np.sqrt(np.count_nonzero(mask))))
            classes, known = _classes(*plate.compared(frame, window), plate.noise), cut(plate.reliable, window, cv2.BORDER_CONSTANT)
            whole = cut(mask, window, cv2.BORDER_CONSTANT)
            shape = _unshaded(whole, classes % 3 > 0)
            # What lies beyond the steepest edges may be a shadow or a codec's smear that got into the mask. The rim mixes both sides.
            own = shape & core(cv2.GaussianBlur(cut(frame, window), (0, 0), 1.0), whole)
            inside.append(classes[narrowed(own, 1) & known])
            beside.append(classes[~widened(shape, 2) & ~enclosed(shape) & known])
        front = self._learnt(np.concatenate(inside), self._usual(*FRONT, 1.0))
        behind = self._learnt(np.concatenate(beside), self._usual(*BEHIND, 0.5))
        self._odds = np.zeros(256, np.float32)  # the size that OpenCV's look-up tables must have
        self._odds[: front.size] = np.clip(np.log(front / behind), -SURE, SURE).ravel()

    def odds(self, away: np.ndarray, light: np.ndarray, noise: float) -> np.ndarray:
        """(h, w) float32 log odds for the difference `away` and change of `light` that `Plate.compared` returns; `noise`: the plate's."""
        return cv2.LUT(_classes(away, light, noise), self._odds)

    @staticmethod
    def _usual(same: float, differs: float, relit: tuple[float, float], fall: float) -> np.ndarray:
        """Usual fractions (levels, 3), by level of difference and by light: unchanged, brighter, darker."""
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
    """Class (h, w) uint8 of each difference `away` (h, w) float32 [grey levels] and change of `light` (h, w) int8: 3 level + light."""
    level = cv2.LUT(np.minimum(away * np.float32(4.0 / noise), np.float32(255.0)).astype(np.uint8), LEVEL)
    turned = light + np.int8(3) * (light < 0).view(np.int8)
    return np.uint8(3) * level + (turned * (level >= LOW).view(np.int8)).view(np.uint8)


def _unshaded(shape: np.ndarray, relit: np.ndarray) -> np.ndarray:
    """The object `shape` (h, w) bool without what is attached to it and may be its shadow; all of it if little else would be left.

    `relit`: (h, w) bool, where the light changed. Pixels of it that the rest encloses are kept: a shadow lies beside what casts it.
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
    """Log odds (h, w) in `window` from the difference to the background, and (h, w) bool, where the background is known.

    Pixels that do not differ get log odds of at least `least`. At its rim, the object ends where half of its contrast is left.
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
    """Log odds (h, w) from the distance to the border of an expected silhouette `shape` (h, w) bool.

    They fall by 1.5 outside and rise by 3 inside for each `band` [px]. A shape that reaches the window's edge is taken to go on there.
    """
    one = shape.astype(np.uint8)
    within = cv2.distanceTransform(one, cv2.DIST_L2, 5)
    beyond = cv2.distanceTransform(1 - one, cv2.DIST_L2, 5)
    # Each distance is 0 on the other side of the border.
    odds = cv2.addWeighted(within, 3.0 / band, beyond, -1.5 / band, -STAYS) + one * np.float32(2.0 * STAYS)
    return np.clip(odds, -SURE - 1.0, SURE)


def against_network(outline: np.ndarray, fresh: bool) -> np.ndarray:
    """Log odds (h, w) from a network's `outline` (h, w) bool, which is `fresh` if it is of this frame."""
    one = outline.astype(np.uint8)
    inside, beyond = (cv2.distanceTransform(side, cv2.DIST_L2, 3) for side in (one, 1 - one))
    # The border lies half a pixel before the first pixel of either side.
    ahead = np.where(outline, inside - 0.5, 0.5 - beyond)
    return (SEGMENTED if fresh else SEGMENTED_BEFORE) * np.clip(ahead / SEGMENTED_RIM, -1.0, 1.0).astype(np.float32)


def total_odds(
    expected: np.ndarray,
    seen: tuple[np.ndarray, np.ndarray] | None,
    colors: np.ndarray,
    other: np.ndarray,
    motion: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Log odds (h, w) from all evidence together.

    Where the background is known, it is better evidence than colours and motion. But it does not tell the object from other things.

    Args:
        expected: (h, w), log odds of the expected silhouette; seen: what `against_plate` returns, None without a background.
        colors, motion: (h, w), log odds; other: (h, w) bool, another thing.
    """
    if seen is None:
        return np.minimum(expected, CARRIED_BLIND) + colors
    behind, known = seen
    beside = grown(other)
    known = known & ~((behind > 0.0) & beside)
    there = np.minimum(expected, CARRIED) + behind + BESIDE_PLATE * colors
    return np.where(known, there, np.minimum(expected, CARRIED_BLIND) + colors + motion * ~beside) - APART * other


def cut_out(odds: np.ndarray, frame: np.ndarray, area: float) -> np.ndarray:
    """(h, w) bool where `odds` (h, w), smoothed along the edges of `frame` (h, w, 3) uint8 by a guided filter (He 2013), are positive.

    The filter is narrower for an expected `area` [px] below SMALL: round a small object's rim, most pixels are background.
    """
    guide = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    values, across = np.clip(odds, -2.0 * SURE, 2.0 * SURE).astype(np.float32), 3 if area < SMALL else 5

    def mean(of: np.ndarray) -> np.ndarray:
        return cv2.blur(of, (across, across))

    middle, level = mean(guide), mean(values)
    slope = (mean(guide * values) - middle * level) / (mean(guide * guide) - middle**2 + NO_EDGE**2)
    return mean(slope) * guide + mean(level - slope * middle) > 0.0
