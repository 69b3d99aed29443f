"""The object's outline in frame 0, the user's corrections of it in any frame, and the background."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import UsageError
from ..masks import Masks
from ..progress import Journal, Progress
from ..records import Doubt
from ..settings import ObserveSettings
from .clip.shake import homography, through_mask
from .mask.background import median_plate
from .mask.by_turns import sought_in_box, with_background
from .mask.carried import Segmenter, alike
from .mask.corrected import Marks, carried_to_first, marks_of, with_corrections
from .mask.first_mask import check_outline, read_mask
from .mask.follow import Surroundings
from .mask.from_box import box_round, with_network
from .mask.moving.in_box import hardly_moves, moving_from
from .mask.moving.registered import registered
from .models.segment_anything import SegmentAnything
from .networks import first_outline
from .steady import Steady, marked, marked_area

SAME = 0.75
"""Least overlap of a network's outline of frame 0 with the object's mask there for the network to be asked in later frames."""


@dataclass(frozen=True)
class Outline:
    """The object's outline."""

    mask: np.ndarray
    """(H, W) bool, in frame 0."""
    corrected: Masks | None
    """In all frames, if the user corrected any; else None."""
    known: Surroundings
    """The background, and other things beside the object."""
    settings: ObserveSettings
    """The settings, with the box in which the object was sought."""
    doubts: list[Doubt]


def find_outline(steady: Steady, progress: Progress, journal: Journal) -> Outline:
    """The object's outline: as the user drew it, or else what moves where the user marked the object.

    Raises:
        ObjectError, UsageError: see `first_outline` and `mask/corrected.py`.
        ModelError, MissingPackage: a network that cannot be used.
    """
    progress.update(0.08, "finding the object")
    network = None if steady.settings.outline_model is None else SegmentAnything(steady.settings.outline_model)
    frames, settings, around, plate = steady.clip.frames, steady.settings, steady.around, steady.plate
    shown, marks = _corrections(steady)
    if shown and not marked(settings):
        # The object is only marked in a later frame: it is followed back to frame 0, and sought there in a box round that place.
        settings = replace(settings, box=box_round(carried_to_first(frames, shown, plate, progress)))
        around = marked_area(settings, *frames.shape[1:3])
    boxed = around if settings.box is not None else np.zeros_like(around)
    still, behind = frames, plate
    if plate is None and sought_in_box(settings) and (views := registered(frames, boxed, progress)) is not None:
        still, behind = views, median_plate(views, progress)
    moving = None if behind is None else moving_from(still, boxed, behind, progress)
    doubts: list[Doubt] = []
    if behind is not None and moving is not None and boxed.any():
        doubts += [one for one in (hardly_moves(still[0], boxed, behind, moving),) if one is not None]
    unaided = first_outline(settings, still, behind, moving, steady.lens, progress)
    mask = shown.get(0, unaided)
    progress.update(0.1, "following the object")
    known = Surroundings()
    if behind is not None and moving is not None:
        unaided, known = with_background(still, unaided, behind, moving, settings, around, progress, journal)
        mask = shown.get(0, unaided)
        if plate is None:
            known = Surroundings(known.plate, panned=True)
        elif 0 in shown:
            # The background, and the object's contrast to it, are learnt once more from the outline that the user has drawn.
            drawn = replace(settings, box=None)
            mask, again = with_background(frames, shown[0], behind, moving, drawn, shown[0], progress, journal)
            known = replace(again, other=known.other)
    if network is not None:
        progress.update(0.1, "outlining the object by a network")
        unaided, asked = _with_network(network, still[0], unaided, shown.get(0), settings, known, progress)
        mask, known = shown.get(0, unaided), replace(known, network=asked, frames=len(frames))
    corrected = with_corrections(frames, mask, unaided, shown, marks, known, progress, journal)
    return Outline(mask if corrected is None else corrected[0], corrected, known, settings, doubts)


def _with_network(
    network: Segmenter,
    frame: np.ndarray,
    mask: np.ndarray,
    drawn: np.ndarray | None,
    settings: ObserveSettings,
    known: Surroundings,
    progress: Progress,
) -> tuple[np.ndarray, Segmenter | None]:
    """The object (H, W) bool in `frame` (H, W, 3) uint8 RGB, which is frame 0; and the network, if it is to be asked in later frames.

    It is not if it outlines something else here than the object: it would soon lead away from it.

    Args:
        mask: (H, W) bool, the object as it was found without the network; drawn: (H, W) bool, as the user drew it.
    """
    if settings.mask is None and (settings.depth is None or settings.box is not None):
        outline = network.outline(frame, mask, settings.box if settings.box is not None else box_round(mask))
        if outline is not None and alike(mask, outline):
            if drawn is None:
                return mask, network
        elif outline is not None:
            mask = with_network(frame, mask, outline, known.plate, known.contrast, progress)
    seen = mask if drawn is None else drawn
    outline = network.outline(frame, seen)
    if outline is None or np.count_nonzero(outline & seen) < SAME * np.count_nonzero(outline | seen):
        progress.warn("The network outlines something else than the object, or the object is too small for it, so it is not used.")
        return mask, None
    return mask, network


def _corrections(steady: Steady) -> tuple[dict[int, np.ndarray], dict[int, Marks]]:
    """The outline (H, W) bool that the user gave, and the marks that correct outlines, both by frame of the clip.

    Raises:
        UsageError: an outline or a mark outside the clip. ObjectError: an outline of too few pixels.
    """
    settings, clip, lens, turns = steady.settings, steady.clip, steady.lens, steady.turns
    count, height, width = clip.frames.shape[:3]
    marks = marks_of(settings.correct or (), clip.first_frame, (count, height, width))
    still = {t: np.eye(3) if turns is None else homography(turns[t], lens.camera) for t in range(count)}
    marks = {
        t: Marks(lens.straight_points(one.on), lens.straight_points(one.beside)).through(still[t]) for t, one in marks.items()
    }
    if settings.outline is None:
        return {}, marks
    place, last = settings.outline_frame - clip.first_frame, clip.first_frame + count - 1
    if not 0 <= place < count:
        raise UsageError(
            f"--outline-frame: {settings.outline_frame} lies outside the clip's frames {clip.first_frame} to {last}.",
            "Count from 0, as --frames does.",
        )
    outline = lens.straight_map(read_mask(settings.outline, height, width, "outline"))
    check_outline(outline, settings.outline)
    return {place: through_mask(outline, still[place])}, marks
