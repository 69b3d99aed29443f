"""The user's corrections of the outline in any frame, carried forwards and backwards, each halfway to the next corrected frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ...errors import ObjectError, UsageError
from ...masks import Masks, pixels_of
from ...progress import Journal, Progress
from ..clip.shake import through
from ..clip.stored import Frames
from .background import Plate
from .cutting import LEAST_PIXELS, grab_cut, tidy
from .evidence import FEW, RIM
from .first_mask import SEED
from .follow import MaskFollower, Surroundings
from .motion import FlowSolver, cut, middle_of, paste, window_of, within
from .through import follow_clip

LOCAL = 0.6
"""Distance from a mark up to which the outline is found again, in units of the root of the object's area; beyond, it stays as it is."""

MIDDLE = 2.0
"""Depth of a mistake, in units of the depth at which the mark lies in it: a mark is set in the middle of what is wrong."""

POINT = 0.05
"""Largest radius of the disc that a mark stands for, in units of the root of the object's area."""

CLOSE, ALIKE = 0.1, 0.5
"""Two outlines are wrong in the same way if, within CLOSE of a correction (in units of the root of the object's area), they differ by less
than ALIKE (in units of the correction's area)."""

POINTS = 400
"""Pixels of the object near a correction from which its motion is estimated."""

GRAIN = 8.0
"""Variation of one and the same colour [grey levels]."""

MOST = 0.9
"""Fraction of the object that a mark may change by its colour alone: if it would change more, the colour does not discriminate."""

FLOOD = 8 | (1 << 8) | cv2.FLOODFILL_FIXED_RANGE | cv2.FLOODFILL_MASK_ONLY
"""Flood fill over eight neighbours, comparing with the colour of the starting pixel, and writing ones into the mask only."""

WHERE = "Widen --frames, which counts from 0 as well, or leave that one out of --correct."


@dataclass(frozen=True)
class Marks:
    """The user's marks in one frame."""

    on: np.ndarray
    """(P, 2) [px], on the object."""
    beside: np.ndarray
    """(Q, 2) [px], off the object."""

    def through(self, matrix: np.ndarray) -> Marks:
        """The marks transformed by the homography `matrix` (3, 3)."""
        return Marks(through(matrix, self.on), through(matrix, self.beside))


def marks_of(corrections: tuple[float, ...], first: int, shape: tuple[int, int, int]) -> dict[int, Marks]:
    """The flat `corrections` N X Y ON ... (see `settings.option.MARKS`), sorted by frame of a clip of `shape` (T+1, H, W).

    Args:
        first: index in the file of the clip's frame 0.

    Raises:
        UsageError: a mark whose frame is not in the clip, or that lies outside its frame.
    """
    rows = np.array(corrections, dtype=np.float64).reshape(-1, 4)
    frames, height, width = shape
    for number, x, y, _ in rows:
        if not 0 <= number - first < frames:
            last = first + frames - 1
            raise UsageError(f"--correct: {number:g} lies outside the clip's frames {first} to {last}.", WHERE)
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            raise UsageError(
                f"The correction at {x:g},{y:g} in frame {number:g} of the file lies outside the {width}x{height} frame.",
                "Leave it out of --correct.",
            )
    numbers = rows[:, 0].astype(int)
    return {int(one) - first: Marks(*(rows[(numbers == one) & (rows[:, 3] == on), 1:3] for on in (1, 0))) for one in np.unique(numbers)}


def with_marks(frame: np.ndarray, mask: np.ndarray, marks: Marks, progress: Progress) -> np.ndarray:
    """The object (H, W) bool in `frame` (H, W, 3) uint8, found again near the `marks` by GrabCut, initialised with `mask` (H, W) bool.

    A mark on the object only adds pixels, and a mark beside it only removes some: those connected to the mark, and only about as deep as a
    mistake would be that has the mark in its middle.

    Raises:
        ObjectError: nothing is left.
    """
    size = float(np.sqrt(max(mask.sum(), 1)))
    radius = max(1, round(min(SEED * min(mask.shape), POINT * size)))
    discs = [_discs(points, radius, mask.shape) for points in (marks.on, marks.beside)]
    found = mask
    if size**2 >= FEW:
        begun, sure = mask.copy(), np.zeros_like(mask)
        for points, on in ((marks.on, True), (marks.beside, False)):
            wrong = (mask != on).astype(np.uint8)
            column, row = np.round(points).astype(int).T
            # A mark nearer the outline corrects the rim, where the colours of both sides mix.
            far = cv2.distanceTransform(wrong, cv2.DIST_L2, 5)[row, column] > 2.0 * RIM
            alike = _alike(frame, points[far], radius) & (wrong > 0)
            if alike.sum() < MOST * mask.sum():
                begun[alike], sure[alike] = on, True
        found = _asked(mask, _cut_again(frame, begun, discs, round(max(LOCAL * size, 4 * radius)), progress), marks, discs, sure)
    found = (found | discs[0]) & ~discs[1]
    if found.sum() < LEAST_PIXELS:
        raise ObjectError("The corrections leave nothing of the object.", "Mark points on it, too.")
    return found


def _asked(mask: np.ndarray, found: np.ndarray, marks: Marks, discs: list[np.ndarray], sure: np.ndarray) -> np.ndarray:
    """`mask` (H, W) bool with only those of the changes towards `found` (H, W) bool that the `marks` ask for.

    `discs`: (H, W) bool, the discs round the marks on the object and round those beside it; `sure`: (H, W) bool, pixels whose colour alone
    settles that they change.
    """
    asked = mask.copy()
    for points, on, disc in zip((marks.on, marks.beside), (True, False), discs):
        depth = cv2.distanceTransform((mask != on).astype(np.uint8), cv2.DIST_L2, 5)
        changed = (mask != on) & ((found == on) | disc)
        for x, y in np.round(points).astype(int):
            _, labels = cv2.connectedComponents((changed & (sure | (depth <= MIDDLE * depth[y, x]))).astype(np.uint8), connectivity=4)
            if labels[y, x]:
                asked[labels == labels[y, x]] = on
    return asked


def _alike(frame: np.ndarray, points: np.ndarray, radius: int) -> np.ndarray:
    """(H, W) bool: the regions connected to `points` (P, 2) [px] that have the colour found round them."""
    smooth, found = cv2.GaussianBlur(frame, (0, 0), 1.5), np.zeros((frame.shape[0] + 2, frame.shape[1] + 2), np.uint8)
    for x, y in np.round(points).astype(int):
        place = smooth[max(y - 2 * radius, 0) : y + 2 * radius + 1, max(x - 2 * radius, 0) : x + 2 * radius + 1].reshape(-1, 3)
        if place.std(axis=0).max() < GRAIN:  # where several colours meet, the mark stands for none of them
            cv2.floodFill(smooth, found, (int(x), int(y)), 0, 3 * (2.0 * GRAIN,), 3 * (2.0 * GRAIN,), FLOOD)
    return found[1:-1, 1:-1] > 0


def _cut_again(frame: np.ndarray, mask: np.ndarray, discs: list[np.ndarray], reach: int, progress: Progress) -> np.ndarray:
    """The object (H, W) bool, found again by GrabCut within `reach` [px] of the `discs` on it and beside it, (H, W) bool each; elsewhere
    `mask` (H, W) bool."""
    distance = cv2.distanceTransform(1 - (discs[0] | discs[1]).astype(np.uint8), cv2.DIST_L2, 5)
    near = distance <= reach
    window = within(window_of(mask | near, 20), frame)
    trimap = np.where(mask & ~discs[1], cv2.GC_FGD, cv2.GC_BGD).astype(np.uint8)
    trimap[near & mask], trimap[near & ~mask] = cv2.GC_PR_FGD, cv2.GC_PR_BGD
    trimap[discs[0]], trimap[discs[1]] = cv2.GC_FGD, cv2.GC_BGD
    found = np.zeros_like(mask)
    paste(found, grab_cut(cut(frame, window), cut(trimap, window), 5, progress), window)
    return tidy(found, (mask & ~near) | discs[0])


def _discs(points: np.ndarray, radius: int, shape: tuple[int, ...]) -> np.ndarray:
    found = np.zeros(shape, np.uint8)
    for x, y in np.round(points).astype(int):
        cv2.circle(found, (int(x), int(y)), radius, 1, -1)
    return found > 0


def carried_to_first(frames: Frames, shown: dict[int, np.ndarray], plate: Plate | None, progress: Progress) -> np.ndarray:
    """The object (H, W) bool in frame 0, followed backwards from the earliest frame in `shown`, the user's outlines (H, W) bool by frame.

    Raises:
        ObjectError: the object is lost on the way.
    """
    start = min(shown)
    follower = MaskFollower(frames[start], shown[start], Surroundings(plate), progress)
    mask = follow_clip(lambda t: frames[start - t], start + 1, follower, progress.part(0.08, 0.1), Journal().loop("back"))[start]
    if not mask.any():
        raise ObjectError(
            f"The object is marked in frame {start} and cannot be followed back to the first one.",
            "Begin the clip later with --frames, or mark it in the first frame.",
        )
    return mask


def corrected(frames: Frames, masks: Masks, better: dict[int, np.ndarray], progress: Progress) -> Masks:
    """The `masks` (T+1, H, W) of `frames` (T+1, H, W, 3), with the corrections by the `better` masks (H, W) bool, keyed by frame, carried
    to the other frames.

    The pixels added and removed in a corrected frame move with the object near them, halfway to the next corrected frame: an outline tends
    to be wrong in the same way in successive frames. All else stays as it was found in each frame. Where a frame's outline differs from
    the one that was corrected by more than half of the correction's area, it is wrong in another way and stays as it is.
    """
    at, found = sorted(better), {t: better[t] for t in better}
    ends = [(one + other) // 2 for one, other in zip(at, at[1:])]
    for start, low, high in zip(at, [0, *(end + 1 for end in ends)], [*ends, len(frames) - 1]):
        changes = [(part, True) for part in _parts(better[start] & ~masks[start])]
        changes += [(part, False) for part in _parts(masks[start] & ~better[start])]
        for way in (range(start + 1, high + 1), range(start - 1, low - 1, -1)) if changes else ():
            found |= _mended(frames, masks, better[start], changes, way, progress)
    return Masks.of(found[t] if t in found else masks[t] for t in range(len(frames)))


def _parts(mask: np.ndarray) -> list[np.ndarray]:
    """The connected components of `mask` (H, W) bool, (H, W) bool each, without specks."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    return [labels == one for one in range(1, count) if stats[one, cv2.CC_STAT_AREA] >= LEAST_PIXELS]


def _mended(
    frames: Frames, masks: Masks, shape: np.ndarray, changes: list[tuple[np.ndarray, bool]], way: range, progress: Progress
) -> dict[int, np.ndarray]:
    """The masks (H, W) bool by frame, for the frames in `way`, with the `changes` carried along.

    `changes`: the regions (H, W) bool, each with whether it was added, that turned the mask of the frame before `way` into `shape` (H, W)
    bool.
    """
    size, outline = float(np.sqrt(shape.sum())), masks[way.start - way.step]
    reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, 2 * (2 * round(max(CLOSE * size, 3.0)) + 1,))
    around = [cv2.dilate(part.astype(np.uint8), reach) > 0 for part, _ in changes]
    distance = cv2.distanceTransform(1 - np.any([part for part, _ in changes], axis=0).astype(np.uint8), cv2.DIST_L2, 5)
    near = shape & (distance <= LOCAL * size)
    points = pixels_of(near if near.any() else shape)
    points = points[np.linspace(0, len(points) - 1, min(POINTS, len(points))).astype(int)]
    before, last = cv2.cvtColor(frames[way.start - way.step], cv2.COLOR_RGB2GRAY), outline
    solver, total, found = FlowSolver(rough=True), np.eye(3), dict[int, np.ndarray]()
    for t in way:
        progress.check()
        gray, mask = cv2.cvtColor(frames[t], cv2.COLOR_RGB2GRAY), masks[t]
        if not mask.any() or not last.any():
            break  # out of sight; the object may look different when it comes back
        here = through(total, points)
        low, high = np.floor(here.min(axis=0)).astype(int) - 24, np.ceil(here.max(axis=0)).astype(int) + 25
        window = (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
        moved = here + solver.between(before, gray, window, middle_of(mask) - middle_of(last)).at(here)
        cv2.setRNGSeed(0)
        fit, _ = cv2.estimateAffinePartial2D(here, moved, ransacReprojThreshold=1.5)
        if fit is None:
            break
        total = np.vstack([fit, [0.0, 0.0, 1.0]]) @ total
        differs, mended = _moved(outline, total) ^ mask, mask.copy()
        for (part, added), place in zip(changes, around):
            part, place = _moved(part, total), _moved(place, total)
            if (differs & place).sum() < ALIKE * part.sum():
                mended[part] = added
        found[t] = mended
        before, last = gray, mask
    return found


def _moved(mask: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """A mask (H, W) bool through an affine map (3, 3)."""
    return cv2.warpAffine(mask.astype(np.float32), matrix[:2], mask.shape[::-1]) > 0.5


def with_corrections(
    frames: Frames,
    mask: np.ndarray,
    unaided: np.ndarray,
    shown: dict[int, np.ndarray],
    marks: dict[int, Marks],
    known: Surroundings,
    progress: Progress,
    journal: Journal,
) -> Masks | None:
    """The masks (T+1, H, W) followed from `mask` (H, W) bool in frame 0, then corrected by the user's outlines and marks; None if there are
    neither.

    Args:
        unaided: (H, W) bool, the mask of frame 0 found without the user's corrections there: comparing both shows what goes wrong.
        shown: the user's outlines (H, W) bool by frame; marks: the user's marks by frame.
    """
    if not shown and not marks:
        return None
    follower = MaskFollower(frames[0], mask, known, progress)
    found = follow_clip(frames.__getitem__, len(frames), follower, progress.part(0.2, 0.3), journal.loop("follow to correct"))
    found = Masks.of(found[t] if t else unaided for t in range(len(found)))
    marked = {t: with_marks(frames[t], shown.get(t, found[t]), each, progress) for t, each in marks.items()}
    return corrected(frames, found, shown | marked, progress)
