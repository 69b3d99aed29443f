"""Carrying the object's mask through the clip, one picture at a time."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from ...progress import Progress
from .background import Plate
from .first_mask import LEAST_PIXELS, grab_cut, tidy
from .motion import Flow, FlowSolver, Window, body_shift, cut, paste, window_of

SMALL = 400
"""Pixels below which an object has too few colours and too small an inside for flow and GrabCut."""

LOST = 0.3
"""A mask smaller than this part of what was expected means hidden or gone, and the shape seen last is kept for the search."""

PARTLY = 0.75
"""A small object's mask below this part of its usual size is partly hidden: shape, colours and velocity of the last full sight are kept."""

SHADOW_LIKE = 0.15
"""Part of the object's inside that may look like a shadow on the background before that test is useless for it."""

CLEAR = 0.85
"""Part of the object that differs from a clean background from which that difference is believed more than colours."""

SAME = 0.7
"""Part of the outline of picture 0 that the object must fill to be taken to show that outline still."""

KNOWN = 0.8
"""Part of the object before which the background must be clean for that."""

COLORS = 12
"""Bins per channel of the colour histograms."""


class Colors:
    """Which colours are the object's rather than its surroundings', from smoothed histograms of picture 0."""

    def __init__(self, picture: np.ndarray, mask: np.ndarray) -> None:
        """`picture` (H, W, 3) uint8 and `mask` (H, W) bool."""
        inside, outside = (np.bincount(self._bins(picture[part]), minlength=COLORS**3).reshape(3 * (COLORS,)) for part in (mask, ~mask))
        density = [gaussian_filter(counts.astype(np.float64), 0.7) / counts.sum() for counts in (inside, outside)]
        self._object = (density[0] > density[1] + 1e-7).ravel()

    @staticmethod
    def _bins(colors: np.ndarray) -> np.ndarray:
        level = colors.astype(np.int32) * COLORS // 256
        return (level[..., 0] * COLORS + level[..., 1]) * COLORS + level[..., 2]

    def likely(self, picture: np.ndarray) -> np.ndarray:
        """(h, w) bool: pixels of `picture` (h, w, 3) uint8 whose colour is more frequent on the object."""
        return self._object[self._bins(picture)]


def _fitted(shape: np.ndarray, differs: np.ndarray, around: np.ndarray, band: int) -> np.ndarray:
    """`shape` (a, b) bool moved in a window to where it covers most of `differs` (h, w) bool and leaves least round itself.

    Sought within a quarter of its size of the centre of `around` (h, w) bool; nowhere where the shape does not fit into the window.
    """
    padded = np.pad(shape, band).astype(np.uint8)
    ring = cv2.dilate(padded, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band + 1, 2 * band + 1)))
    template = 2.0 * padded.astype(np.float32) - ring.astype(np.float32)
    if (np.array(template.shape) > differs.shape).any() or not around.any():
        return np.zeros_like(differs)
    score = cv2.matchTemplate(differs.astype(np.float32), template, cv2.TM_CCORR)
    rows, columns = np.nonzero(around)
    middle = np.array([rows.mean(), columns.mean()]) - 0.5 * (np.array(template.shape) - 1.0)
    reach = 0.25 * np.sqrt(shape.sum()) + 2.0
    y, x = np.mgrid[: score.shape[0], : score.shape[1]]
    score[(np.abs(y - middle[0]) > reach) | (np.abs(x - middle[1]) > reach)] = -np.inf
    if not np.isfinite(score).any():
        return np.zeros_like(differs)
    row, column = np.unravel_index(int(np.argmax(score)), score.shape)
    moved = np.zeros_like(differs)
    moved[row : row + padded.shape[0], column : column + padded.shape[1]] = padded > 0
    return moved


def _wide(mask: np.ndarray, band: int) -> np.ndarray:
    """The parts of `mask` (h, w) bool that a disc of radius `band` [px] fits into."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band + 1, 2 * band + 1))
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc) > 0


class MaskFollower:
    """Follows one object: whole-body search, flow, then GrabCut in a band round the carried silhouette.

    Where the camera stands still, `plate` tells pixels that did not change (never object, away from its inside) and gives a small
    object, of too few pixels for colours, its silhouette.

    Attributes:
        flow: motion from the picture before to the newest one; None after `hidden`.
        velocity: (2,) [px per frame], the whole body's.
        hidden: the object was not found in the newest picture.
    """

    def __init__(self, picture: np.ndarray, mask: np.ndarray, plate: Plate | None, progress: Progress) -> None:
        """`picture` (H, W, 3) uint8 RGB and `mask` (H, W) bool of picture 0; `progress` is asked several times a picture."""
        self._progress = progress
        self._plate = plate
        self._solver = FlowSolver()
        self._colors = Colors(picture, mask)
        self._gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        self._shape_window: Window = window_of(mask, 0)
        self._shape = cut(mask, self._shape_window)
        self._first_shape = self._shape
        self._template = cut(picture, self._shape_window).copy()
        self._steps = 0
        self._missed = 0
        self.mask = mask
        self.velocity = np.zeros(2)
        self.hidden = False
        self.flow: Flow | None = None

    def advance(self, picture: np.ndarray) -> np.ndarray:
        """The mask (H, W) bool of the next `picture` (H, W, 3) uint8 RGB; all False when the object is hidden or gone."""
        gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        changed = self._changed(picture)
        shift = self._search(picture, changed)
        self._progress.check()
        window = self._shape_window
        side = max(window[2] - window[0], window[3] - window[1])
        margin = int(np.clip(0.25 * side, 12, 80))
        wide = (window[0] - margin, window[1] - margin, window[2] + margin, window[3] + margin)
        self.flow = None if self.hidden else self._solver.between(self._gray, gray, wide, shift)
        self._progress.check()
        carried, where = self._carry(shift, margin)
        found = self._silhouette(picture, changed, carried, where)
        self._remember(picture, gray, shift, carried, found, where)
        mask = np.zeros(gray.shape, bool)
        if not self.hidden:
            paste(mask, found, where)
        self.mask = mask
        return mask

    def _changed(self, picture: np.ndarray) -> np.ndarray | None:
        """Evidence (H, W) float32 in 0..1 that a pixel is not background: 0.5 at five times the noise."""
        if self._plate is None:
            return None
        return np.clip(self._plate.difference(picture) / (10.0 * self._plate.noise), 0.0, 1.0)

    def _search(self, picture: np.ndarray, changed: np.ndarray | None) -> np.ndarray:
        size = float(np.sqrt(self._shape.sum()))
        # Nothing is known of the first step; a small thing may leap several of its own widths, a large one only part of its own.
        reach = max(24.0, 4.0 * size if self._shape.sum() < SMALL else 0.7 * size) if self._steps == 0 else max(12.0, 0.5 * size)
        if self.hidden:
            reach = max(reach, 1.5 * size) * (1 + min(self._missed, 4))
        origin = (self._shape_window[0], self._shape_window[1])
        # A plate that holds only part of the object's path as clean would pull towards that part.
        clean = self._plate is not None and cut(self._plate.reliable, self._shape_window).mean() > 0.9
        return body_shift(self._template, self._shape, origin, picture, changed if clean else None, self.velocity, min(reach, 200.0))

    def _carry(self, shift: np.ndarray, margin: int) -> tuple[np.ndarray, Window]:
        """The last silhouette moved by the flow (or the shift), in a window round its new place."""
        dx, dy = (int(value) for value in np.round(shift))
        x0, y0, x1, y1 = self._shape_window
        where = (x0 + dx - margin, y0 + dy - margin, x1 + dx + margin, y1 + dy + margin)
        carried = np.zeros((where[3] - where[1], where[2] - where[0]), np.uint8)
        if self.flow is None or self._shape.sum() < SMALL:
            carried[margin : margin + y1 - y0, margin : margin + x1 - x0] = self._shape
            return carried > 0, where
        rows, columns = np.nonzero(self._shape)
        motion = self.flow.motion[rows + y0 - self.flow.y0, columns + x0 - self.flow.x0]
        landed = np.round(np.stack([columns + x0, rows + y0], axis=1) + motion).astype(int) - [where[0], where[1]]
        inside = (landed >= 0).all(axis=1) & (landed[:, 0] < carried.shape[1]) & (landed[:, 1] < carried.shape[0])
        carried[landed[inside, 1], landed[inside, 0]] = 1
        # Pixels drift apart where the object grows: close the gaps.
        carried = cv2.morphologyEx(carried, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        return cv2.morphologyEx(carried, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0, where

    def _silhouette(self, picture: np.ndarray, changed: np.ndarray | None, carried: np.ndarray, where: Window) -> np.ndarray:
        crop = cut(picture, where)
        visible = cut(np.ones(picture.shape[:2], bool), where, cv2.BORDER_CONSTANT)
        evidence = cut(changed, where, cv2.BORDER_CONSTANT) if changed is not None else None
        clean = cut(self._plate.reliable, where) if self._plate is not None else np.zeros(carried.shape, bool)
        area = max(float(carried.sum()), 1.0)
        if area < SMALL and evidence is not None and clean[carried].mean() > 0.8:
            near = cv2.dilate(carried.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
            return tidy((evidence > 0.5) & near & visible, carried)
        band = int(np.clip(0.06 * np.sqrt(area), 2, 9))
        trimap = self._trimap(carried, evidence, clean, band)
        relit = self._plate.relit(picture, where) if self._plate is not None else np.zeros(carried.shape, bool)
        self._use_light(relit, carried, trimap)
        if evidence is not None:
            self._let_grow(crop, clean & (evidence > 0.9), trimap)
        trimap[~visible] = cv2.GC_BGD
        found = tidy(grab_cut(crop, trimap, 2, self._progress), carried & visible)
        return found if evidence is None else self._kept_true(found, evidence, clean, clean & (evidence > 0.5) & ~relit, band)

    def _kept_true(self, found: np.ndarray, evidence: np.ndarray, clean: np.ndarray, differs: np.ndarray, band: int) -> np.ndarray:
        """`found` (h, w) without the drift of a silhouette that is carried on, where the object stands out from a clean background.

        What differs from the background within the outline of picture 0, moved to where it fits best, is the object: a highlight or blur
        that was lost comes back. Where the silhouette has outgrown that outline, what does not differ is not: background that came along.
        """
        outline = _fitted(self._first_shape, differs, found, band)
        known = outline & clean
        if known.sum() < max(KNOWN * outline.sum(), LEAST_PIXELS) or differs[known].mean() < CLEAR:
            return found
        if (found & outline).sum() < SAME * outline.sum():
            return found
        # Pieces narrower than the band are left alone: the rim, where half-covered pixels differ or not.
        lost = _wide(differs & outline & ~found, band)
        if found.sum() <= outline.sum():
            return tidy(found | lost, found)
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band + 1, 2 * band + 1))
        off = cv2.dilate(outline.astype(np.uint8), disc) == 0
        return tidy((found & ~_wide(found & off & clean & (evidence <= 0.9), band)) | lost, found)

    @staticmethod
    def _trimap(carried: np.ndarray, evidence: np.ndarray | None, clean: np.ndarray, band: int) -> np.ndarray:
        """GrabCut labels: sure inside and outside a band round the carried silhouette, unchanged pixels of a clean plate being outside."""
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band + 1, 2 * band + 1))
        shape = carried.astype(np.uint8)
        inner, outer = cv2.erode(shape, disc) > 0, cv2.dilate(shape, disc) > 0
        trimap = np.full(carried.shape, cv2.GC_BGD, np.uint8)
        trimap[outer] = cv2.GC_PR_BGD
        trimap[carried] = cv2.GC_PR_FGD
        trimap[inner] = cv2.GC_FGD
        if evidence is not None:
            unchanged = clean & (evidence < 0.2)
            trimap[~inner & unchanged] = cv2.GC_BGD
            # Inside, chance likeness of colours is possible, so the colours round it decide.
            trimap[inner & unchanged] = cv2.GC_PR_BGD
        return trimap

    @staticmethod
    def _use_light(relit: np.ndarray, carried: np.ndarray, trimap: np.ndarray) -> None:
        """Label shadows that came or went (`relit`) as background, unless the object itself has the background's tint."""
        inner = trimap == cv2.GC_FGD
        if relit[inner if inner.any() else carried].mean() < SHADOW_LIKE:
            trimap[relit & ~inner] = cv2.GC_BGD

    def _let_grow(self, crop: np.ndarray, changed: np.ndarray, trimap: np.ndarray) -> None:
        """Offer changed pixels of the object's colours that adjoin it: turning from its edge, it grows faster than the band."""
        alike = cv2.morphologyEx((changed & self._colors.likely(crop)).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
        joined = alike | ((trimap & 1) > 0)
        count, labels = cv2.connectedComponents(joined.astype(np.uint8), connectivity=4)
        own = np.zeros(count, bool)
        own[np.unique(labels[(trimap & 1) > 0])] = True
        own[0] = False
        trimap[own[labels] & ((trimap & 1) == 0)] = cv2.GC_PR_FGD

    def _remember(
        self, picture: np.ndarray, gray: np.ndarray, shift: np.ndarray, carried: np.ndarray, found: np.ndarray, where: Window
    ) -> None:
        area = float(found.sum())
        self.hidden = area < max(LOST * carried.sum(), min(LEAST_PIXELS, 0.5 * carried.sum()))
        self._missed = self._missed + 1 if self.hidden else 0
        self._gray = gray
        self._steps += 1
        if self.hidden or (self._shape.sum() < SMALL and area < PARTLY * self._shape.sum()):
            # The last full sight moves on: by the velocity when nothing was seen, by the search when something was.
            x0, y0, x1, y1 = self._shape_window
            dx, dy = (int(value) for value in np.round(self.velocity if self._steps > 1 else shift))
            self._shape_window = (x0 + dx, y0 + dy, x1 + dx, y1 + dy)
            return
        center = np.array([np.nonzero(found)[1].mean() + where[0], np.nonzero(found)[0].mean() + where[1]])
        x0, y0, _, _ = self._shape_window
        rows, columns = np.nonzero(self._shape)
        self.velocity = center - [columns.mean() + x0, rows.mean() + y0]
        local = window_of(found, 0)
        self._shape_window = (local[0] + where[0], local[1] + where[1], local[2] + where[0], local[3] + where[1])
        self._shape = cut(found, local)
        self._template = cut(picture, self._shape_window).copy()
