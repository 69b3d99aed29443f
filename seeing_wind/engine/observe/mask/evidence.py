"""What speaks for each pixel being the object, in log odds that add up: the background behind it, its colours, the silhouette before.

A sum of such evidence is smoothed along the picture's edges (guided filter, He 2013) and cut at zero: a labelling as a graph cut gives it
(Rhemann 2011) at a fixed, small cost, and with any evidence.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from .background import Plate
from .motion import Window, cut, window_of

DIFFERS = 3.0
"""Times the noise by which a pixel differs from the background for both to be equally likely."""

SURE = 4.0
"""Log odds that the background alone can give: a silhouette far away or a box still outweighs them."""

OUTSIDE = -50.0
"""Log odds of what is certainly not the object."""

USUAL = 0.35
"""Part of an object that looks like the background behind it, as long as little of it was seen before a known background."""

SHADED = 0.35
"""Part of the object that looks like the background in a shadow from which that is no sign of a shadow."""

STAYS = 0.7
"""Log odds at its very border for a silhouette that was carried on: what says little does not wear it away."""

RIM = 3.5
"""Pixels over which a lens and a codec spread the object's rim: there the object ends where half of its contrast is left."""

COLORS = 12
"""Bins per channel of the colour histograms."""

COLOR_SURE = 2.5
"""Log odds that a colour can give."""


class Colors:
    """Which colours are the object's rather than its surroundings', from smoothed histograms."""

    def __init__(self, inside: np.ndarray, outside: np.ndarray) -> None:
        """`inside` (N, 3) and `outside` (M, 3) uint8: samples of both."""
        counts = [np.bincount(self._bins(part), minlength=COLORS**3).reshape(3 * (COLORS,)) for part in (inside, outside)]
        density = [gaussian_filter(one.astype(np.float64), 0.7) / max(one.sum(), 1) + 2e-5 for one in counts]
        self._odds = np.clip(np.log(density[0] / density[1]), -COLOR_SURE, COLOR_SURE).ravel().astype(np.float32)

    @staticmethod
    def _bins(colors: np.ndarray) -> np.ndarray:
        level = colors.astype(np.int32) * COLORS // 256
        return (level[..., 0] * COLORS + level[..., 1]) * COLORS + level[..., 2]

    def odds(self, picture: np.ndarray) -> np.ndarray:
        """(h, w) float32 log odds of the colours of `picture` (h, w, 3) uint8."""
        return self._odds[self._bins(picture)]


@dataclass(frozen=True)
class Looks:
    """How much it speaks against a pixel that it looks like the background, which parts of the object itself may do."""

    same: float
    """Log odds, positive, of what does not differ from the background."""
    shaded: float
    """Of what is the background in a shadow."""


def looks_of(picture: np.ndarray, plate: Plate, mask: np.ndarray) -> Looks:
    """What the object `mask` (H, W) bool of `picture` (H, W, 3) says of itself, as far as the background behind it is known."""
    window = window_of(mask, 0)
    inside = cv2.erode(cut(mask, window).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    known = inside & cut(plate.reliable, window)
    differs = plate.away(picture, window) > DIFFERS * plate.noise
    few = 0.1 * inside.sum() + 1.0

    def part(alike: np.ndarray, usual: float) -> float:
        return float(((alike & known).sum() + usual * few) / (known.sum() + few))

    shaded = part(plate.relit(picture, window) & differs, 0.0)
    return Looks(float(np.clip(-np.log(part(~differs, USUAL)), 0.1, SURE)), 1.5 * SURE if shaded < SHADED else 0.1)


def against_plate(picture: np.ndarray, plate: Plate, window: Window, looks: Looks, least: float = -SURE) -> tuple[np.ndarray, np.ndarray]:
    """Log odds (h, w) in `window` by what differs from the background, and where that is known (h, w) bool.

    A shadow that came or went is background; so is what does not differ, with odds of `least` or more.
    """
    away = plate.away(picture, window)
    known = cut(plate.reliable, window, cv2.BORDER_CONSTANT)
    threshold = DIFFERS * plate.noise
    differs = (away > threshold).astype(np.uint8)
    rim = cv2.distanceTransform(differs, cv2.DIST_L2, 3) <= RIM
    reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * int(RIM) + 1, 2 * int(RIM) + 1))
    half = np.where(rim, np.maximum(0.5 * cv2.dilate(away, reach), threshold), threshold)
    odds = np.clip((away - half) / plate.noise, -SURE, SURE)
    odds = np.where(differs > 0, odds, np.maximum(odds, max(least, -looks.same)))
    relit = plate.relit(picture, window) & (differs > 0)
    return np.where(relit, np.minimum(odds, -looks.shaded), odds).astype(np.float32), known


def against_shape(shape: np.ndarray, band: float) -> np.ndarray:
    """Log odds (h, w) by the distance to the border of an expected silhouette `shape` (h, w) bool.

    For each `band` [px] they fall by 1.5 outside and rise by 3 inside.
    """
    padded = np.pad(shape, 1).astype(np.uint8)
    within = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1]
    beyond = cv2.distanceTransform(1 - padded, cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.clip(np.where(shape, STAYS + 3.0 * within / band, -STAYS - 1.5 * beyond / band), -SURE - 1.0, SURE)


def band_of(area: float) -> float:
    """Pixels by which a silhouette of `area` [px] may be off when it was carried from one picture to the next."""
    return float(np.clip(0.06 * np.sqrt(area), 2.0, 9.0))


def cut_out(odds: np.ndarray, picture: np.ndarray, radius: int = 2, smooth: float = 10.0) -> np.ndarray:
    """(h, w) bool where `odds` (h, w), smoothed along the edges of `picture` (h, w, 3) uint8 in a window of `radius` [px], are positive.

    `smooth` [grey levels]: contrasts below it are no edges.
    """
    guide = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    values = np.clip(odds, -2.0 * SURE, 2.0 * SURE).astype(np.float32)
    size = (2 * radius + 1, 2 * radius + 1)

    def mean(of: np.ndarray) -> np.ndarray:
        return cv2.blur(of, size)

    middle, level = mean(guide), mean(values)
    slope = (mean(guide * values) - middle * level) / (mean(guide * guide) - middle**2 + smooth**2)
    return (mean(slope) * guide + mean(level - slope * middle) > 0.0) & (odds > OUTSIDE / 2)
