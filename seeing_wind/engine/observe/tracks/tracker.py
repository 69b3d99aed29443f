"""Following up to 200 corners of the object: from frame to frame by flow, anchored to frame 0, checked against their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...masks import at_pixels
from ...record_arrays import from_arrays, to_arrays
from ..mask.cutting import widened
from ..mask.motion import Flow, middle_of
from .anchor import HALF, Patches, align, cut_patches, sample, smooth
from .neighbours import LEAST, disagreement, predict

MOST = 200
"""Largest number of tracks: more cost time and, a few pixels apart, add no information."""

ACCEPT = 0.7
"""Correlation with the template from which an alignment is accepted."""

GOOD = 0.9
"""Correlation from which a frame may become a point's second template."""

FARTHEST = 4.0
"""Largest distance [px] of an alignment from its start."""

ODD = 2.0
"""Distance [px] from the neighbours' prediction from which a point is not visible."""

CHAIN_AGREES = 1.0
"""Distance [px] from the neighbours' prediction within which a point that flow alone has followed stays visible."""

EDGE_ON = 0.25
"""Smaller singular value of a patch's shape below which the surface is seen edge-on and positions slide."""

FLOOR = 0.06
"""Least standard deviation of a track [px]: shading, the codec and the affine model cause errors that residuals do not show."""

CHAIN_STEP = 0.2
"""Standard deviation that one frame-to-frame step without an anchor adds [px]."""

LARGEST = 300.0
"""Square root of the object's area [px] beyond which it is followed in a smaller copy."""

EDGE = 2.24
"""Ratio of a patch's position errors along its two principal directions from which it lies on an edge and slides along it: eigenvalues of
the structure tensor of five to one."""

RIM = 1.5
"""Distance from the outline, in units of half a patch's side, within which such an edge is the outline itself or moves with it."""

ENOUGH = 6
"""Number of visible corner tracks from which they determine the body's motion better than its silhouette does."""

FORGOTTEN = 12
"""Frames out of sight after which a point is given up."""


def find_corners(frame: np.ndarray, mask: np.ndarray, most: int = MOST) -> np.ndarray:
    """Shi-Tomasi corners (K, 2) [px], K <= `most`, well inside `mask` (H, W) bool of `frame` (H, W, 3) uint8 RGB.

    Their least distance is found by bisection, so that the corners spread over the whole object.
    """
    gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
    rim = int(np.clip(0.05 * np.sqrt(np.count_nonzero(mask)), 1, 6))
    inside = cv2.erode(mask.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * rim + 1, 2 * rim + 1)), borderValue=0)
    # goodFeaturesToTrack rates corners relative to the best one inside the mask; `_refined` checks their absolute contrast.
    low, high = 2.0, max(3.0, float(np.sqrt(np.count_nonzero(mask) / most)) * 2.0)
    best = np.zeros((0, 2))
    for _ in range(8):
        middle = 0.5 * (low + high)
        corners = cv2.goodFeaturesToTrack(gray, 4 * most, 0.005, middle, mask=inside, blockSize=7)
        found = np.zeros((0, 2)) if corners is None else corners.reshape(-1, 2).astype(np.float64)
        if len(found) > most:
            low = middle
        else:
            high = middle
        if len(found) >= len(best) or len(best) > most:
            best = found
    return _off_outline(frame, mask, _refined(gray, best[:most]))


def _refined(gray: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The corners (K, 2) [px] with real contrast: the smaller eigenvalue of the structure tensor exceeds that of the codec's noise."""
    if not len(corners):
        return corners
    strength = cv2.cornerMinEigenVal(cv2.GaussianBlur(gray, (0, 0), 1.0), 7, ksize=3)
    values = sample(strength.astype(np.float32), corners[:, None, :])[:, 0]
    # 1e-4 is a step of about five grey levels across the block.
    return corners[values > 1e-4]


def _off_outline(frame: np.ndarray, mask: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """The corners (K, 2) [px] that are not parts of the object's outline; all of them if too few would be left.

    The weak corners of a plain body lie on its rim, where the outline and reflections do not move with the body when it turns.
    """
    if not len(corners):
        return corners
    view = _View.of(mask)
    first, inside = view.smaller(frame, mask)
    xy = view.inward(corners)
    variance = np.linalg.eigvalsh(cut_patches(first, cv2.GaussianBlur(inside.astype(np.float32), (0, 0), 1.0), xy).covariance)
    depth = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    fixed = (variance[:, 1] < EDGE**2 * variance[:, 0]) | (sample(depth, xy[:, None, :])[:, 0] > RIM * HALF)
    return corners[fixed] if fixed.sum() >= ENOUGH else corners


@dataclass(frozen=True)
class _View:
    """The working copy of the clip in which an object is followed: smaller where the object is large."""

    size: tuple[int, int]
    """Width and height [working px]."""
    scale: np.ndarray
    """(2,) file pixels per working pixel."""

    @staticmethod
    def of(mask: np.ndarray) -> _View:
        """The working copy for an object `mask` (H, W) bool."""
        factor = max(1.0, float(np.sqrt(np.count_nonzero(mask))) / LARGEST)
        size = (round(mask.shape[1] / factor), round(mask.shape[0] / factor))
        return _View(size, np.array(mask.shape[::-1]) / size)

    def smaller(self, frame: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The smoothed grey frame (h, w) and the mask (h, w) bool at the working size."""
        if self.size != mask.shape[::-1]:
            frame = cv2.resize(frame, self.size, interpolation=cv2.INTER_AREA)
            mask = cv2.resize(mask.astype(np.uint8), self.size, interpolation=cv2.INTER_NEAREST) > 0
        return smooth(frame), mask

    def inward(self, xy: np.ndarray) -> np.ndarray:
        """Working pixels (..., 2) of file pixels xy (..., 2); pixel centres are at integers in both."""
        return (xy + 0.5) / self.scale - 0.5

    def outward(self, xy: np.ndarray) -> np.ndarray:
        """File pixels (..., 2) of working pixels xy (..., 2)."""
        return (xy + 0.5) * self.scale - 0.5


class Tracker:
    """Follows points from frame 0 on.

    Patches and thresholds are in working pixels: a large object is followed in a smaller copy of the clip, where a patch contains as much
    of its pattern as on a small object. Positions in and out are the file's.

    Attributes:
        visible: (K,) bool, in the newest frame.
    """

    def __init__(self, frame: np.ndarray, mask: np.ndarray, corners: np.ndarray) -> None:
        """`frame` (H, W, 3) uint8 RGB, `mask` (H, W) bool and `corners` (K, 2) [px] are those of the frame in which the points begin."""
        count = len(corners)
        self._view = _View.of(mask)
        first, inside = self._view.smaller(frame, mask)
        self._rest = self._view.inward(corners)
        self._patches = cut_patches(first, cv2.GaussianBlur(inside.astype(np.float32), (0, 0), 1.0), self._rest)
        self._second: Patches = self._patches
        self._second_affine = np.tile(np.eye(2), (count, 1, 1))
        self._second_sigma = np.zeros(count)
        self._reach = max(30.0, 0.5 * float(np.sqrt(np.count_nonzero(inside))))
        self._affine = np.tile(np.eye(2), (count, 1, 1))
        self._unseen = np.zeros(count, int)
        self._center = middle_of(inside)
        self._xy = self._rest.copy()
        self._sigma = np.full(count, FLOOR)
        self.visible = np.ones(count, bool)

    @property
    def xy(self) -> np.ndarray:
        """(K, 2) [px], positions in the newest frame."""
        return self._view.outward(self._xy)

    @property
    def sigma(self) -> np.ndarray:
        """(K,) [px], their standard deviations."""
        return self._sigma * self._view.scale.mean()

    def advance(self, frame: np.ndarray, flow: Flow | None, mask: np.ndarray) -> None:
        """Follow the points into the next `frame` (H, W, 3) uint8 RGB with its `mask` (H, W) bool, by the `flow` from the frame before.

        While the object is hidden (an empty mask), no point is visible; when it is back, the points start moved by its centroid's shift.
        """
        now, mask = self._view.smaller(frame, mask)
        if not len(self._xy) or not mask.any():
            self.visible = np.zeros(len(self._xy), bool)
            self._unseen = self._unseen + 1
            return
        center, before = middle_of(mask), self._center
        self._center = center
        if flow is None or not self.visible.any():
            back = (self._unseen > 0) & (self._unseen <= FORGOTTEN)
            start, known = self._xy + (center - before), back | self.visible
        else:
            start, known = self._xy + flow.at(self.xy) / self._view.scale, self.visible
        guess, affine, support = predict(self._rest, start, known, self._affine, self._reach)
        # A point out of sight has no flow of its own: it starts where its neighbours predict it.
        lost = ~known
        start[lost] = guess[lost]
        wanted = ~lost | ((support >= LEAST) & (self._unseen <= FORGOTTEN))
        xy, shape, sigma, anchored = self._anchor(now, start, affine, wanted)
        predicted, _, support = predict(self._rest, xy, anchored, shape, self._reach)
        off = disagreement(xy, predicted, support)
        good = anchored & (off < ODD)
        # A point whose alignment failed or disagrees stays visible if the neighbours confirm where flow put it.
        chain = ~good & self.visible & (support >= LEAST) & (disagreement(start, predicted, support) < CHAIN_AGREES)
        xy[chain] = start[chain]
        sigma[chain] = np.hypot(self._sigma[chain], CHAIN_STEP)
        flat = np.linalg.svd(shape, compute_uv=False)[:, 1] < EDGE_ON
        seen = (good | chain) & ~flat & self._on_object(xy, mask)
        self._xy = np.where(seen[:, None], xy, predicted)
        self._affine = np.where(seen[:, None, None], shape, affine)
        self.visible = seen
        self._unseen = np.where(seen, 0, self._unseen + 1)
        self._sigma = np.maximum(sigma, FLOOR)

    def state(self) -> dict[str, np.ndarray]:
        """All that later frames depend on, besides the arguments of the constructor."""
        second = {} if self._second is self._patches else to_arrays(self._second, "second.")
        return second | {
            "second_affine": self._second_affine,
            "second_sigma": self._second_sigma,
            "affine": self._affine,
            "unseen": self._unseen,
            "center": self._center,
            "xy": self._xy,
            "sigma": self._sigma,
            "visible": self.visible,
        }

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Continue as the tracker that returned `state`, constructed with the same arguments, would have."""
        if "second.values" in state:
            self._second = from_arrays(Patches, state, "second.")
        self._second_affine, self._second_sigma = state["second_affine"], state["second_sigma"]
        self._affine, self._unseen, self._center = state["affine"], state["unseen"], state["center"]
        self._xy, self._sigma, self.visible = state["xy"], state["sigma"], state["visible"]

    def _anchor(
        self, now: np.ndarray, start: np.ndarray, affine: np.ndarray, wanted: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Align the `wanted` points with frame 0 or, failing that, with their second templates: positions (K, 2), shapes (K, 2, 2), sigmas
        (K,), and which points were aligned (K,) bool."""
        xy, shape, sigma = start.copy(), affine.copy(), self._sigma.copy()
        anchored = np.zeros(len(start), bool)
        for second in (False, True):
            todo = np.flatnonzero(wanted & ~anchored)
            if not len(todo):
                break
            patches = (self._second if second else self._patches).take(todo)
            base = self._second_affine[todo] if second else np.tile(np.eye(2), (len(todo), 1, 1))
            found = align(patches, now, start[todo], np.matmul(affine[todo], np.linalg.inv(base)))
            accept = (found.ncc > ACCEPT) & (np.linalg.norm(found.xy - start[todo], axis=1) < FARTHEST)
            here = todo[accept]
            xy[here], shape[here] = found.xy[accept], np.matmul(found.affine[accept], base[accept])
            own = found.sigma[accept]
            sigma[here] = np.hypot(own, self._second_sigma[here]) if second else own
            anchored[here] = True
            if not second:
                self._renew(now, here[found.ncc[accept] > GOOD], xy, shape, sigma)
        return xy, shape, sigma, anchored

    def _renew(self, now: np.ndarray, index: np.ndarray, xy: np.ndarray, shape: np.ndarray, sigma: np.ndarray) -> None:
        """Make this frame the second template of the points `index`: the last frame in which they still looked as in frame 0."""
        if not len(index):
            return
        fresh = cut_patches(now, np.ones_like(now), xy[index])
        old = self._second
        if old is self._patches:
            old = Patches(old.values.copy(), old.weight.copy(), old.descent.copy(), old.covariance.copy())
            self._second = old
        old.values[index], old.weight[index] = fresh.values, fresh.weight
        old.descent[index], old.covariance[index] = fresh.descent, fresh.covariance
        self._second_affine[index] = shape[index]
        self._second_sigma[index] = sigma[index]

    @staticmethod
    def _on_object(xy: np.ndarray, mask: np.ndarray) -> np.ndarray:
        return at_pixels(widened(mask, 2), xy)
