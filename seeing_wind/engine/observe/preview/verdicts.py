"""What can be trusted in an observation, what cannot, and what to do about it: one verdict for each item, the worst first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import cv2
import numpy as np

from ...conventions import HELD_PLACE, as_in_file, counted, frame_named, in_units
from ...masks import areas, at_rim, partly_hidden
from ...records import Observation
from ...settings import ObserveSettings
from .held import propose_held, swings

FEWEST = 3
"""Least number of frames in which the object is followed for a recovery."""

FEW_TRACKS = 12
"""Number of tracks in a frame below which a body's bending cannot be told from their errors."""

ON_BOX = 0.04
"""Fraction of the outline on the border of the box from which the box is taken to cut the object."""

SPANS = 0.5
"""Least fraction of a box's width and height that the object found in it spans: boxes are drawn closer round an object."""

HARDLY = 1.5
"""Motion [px] that is lost in the tracks' errors."""

OPEN = 0.5
"""Fraction of the time between frames for which a usual shutter is open."""

GROWS = 0.1
"""Relative change of the object's size in the frame from which it comes nearer or turns: a swing across the view has less."""

SEVERE = 1.0
"""Severity of a verdict from which on the result cannot be trusted."""

LIVES, LEAST = 0.67, 8
"""Median fraction of the clip for which the points of frame 0 are followed, below which the outline may be wrong; and the least number of
points for this. Observed: 0.84 and more on right outlines, 0.25 to 0.50 on ones that are mostly wrong, or wrong in some frames."""

BLURRED = 0.08
"""Blur, in units of the object's shorter side, from which its outline and tracks suffer."""


@dataclass(frozen=True)
class Verdict:
    """The verdict on one item."""

    item: str
    severity: float
    """0 is good; from `SEVERE` on the result cannot be trusted."""
    because: str
    do: str = ""

    @property
    def verdict(self) -> str:
        """good or doubtful."""
        return "doubtful" if self.severity > 0.0 else "good"

    def as_in_file(self, first_frame: int) -> Verdict:
        """The verdict with its frames counted as `conventions.as_in_file` does."""
        return replace(self, because=as_in_file(self.because, first_frame), do=as_in_file(self.do, first_frame))

    def as_json(self) -> dict[str, Any]:
        """All fields, and the verdict in words."""
        return {"verdict": self.verdict, **asdict(self)}


def judge(
    seen: Observation, settings: ObserveSettings, proposed: np.ndarray | None, more: Sequence[Verdict] = (), views: int = 1
) -> list[Verdict]:
    """All verdicts on `seen`, the worst first, with `more` among them.

    Args:
        proposed: (H, W) bool, where the object seems to be held; None if nowhere.
        views: the number of cameras that see the object; two determine its distance.
    """
    found = [
        _outline(seen, settings, proposed),
        _sight(seen),
        _tracks(seen),
        _held(seen, proposed),
        _motion(seen),
        _blur(seen),
        _scale(settings, views),
        _depth_motion(seen),
        *_clip(seen),
        *more,
    ]
    return sorted(found, key=lambda one: -one.severity)


def doubt_remarks(seen: Observation, settings: ObserveSettings, views: int = 1) -> tuple[list[str], list[str]]:
    """The doubtful items of `seen` as sentences for a recovery's notes, the worst first, and after them what else was told of it.

    Those from which on the result cannot be trusted come first, the others are apart.
    """
    proposed = None if seen.pin.any() else propose_held(seen)
    found = [one for one in judge(seen, settings, proposed, views=views) if one.severity > 0.0]
    said = [f"{one.item.capitalize()}: {one.because} {one.do}".strip() for one in found]
    severe = sum(one.severity >= SEVERE for one in found)
    return said[:severe], [*said[severe:], *seen.told]


def _outline(seen: Observation, settings: ObserveSettings, proposed: np.ndarray | None) -> Verdict:
    mask = np.asarray(seen.masks[0])
    rim = mask & (cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) == 0)
    length = max(int(rim.sum()), 1)
    within = "frame"
    if settings.box is not None and settings.mask is None:
        within = "box and the frame"
        x0, y0, x1, y1 = settings.box
        rows, columns = np.nonzero(rim)
        on_box = (columns <= x0 + 1) | (columns >= x1 - 1) | (rows <= y0 + 1) | (rows >= y1 - 1)
        # Where a side of the box is the frame's edge, the outline is judged below.
        inner = (columns > 1) & (rows > 1) & (columns < mask.shape[1] - 2) & (rows < mask.shape[0] - 2)
        part = float((on_box & inner).sum() / length)
        if part > ON_BOX:
            return Verdict("outline", 1.0 + part, f"{100 * part:.0f} % of it lies on the box, which cuts the object.", "Draw a larger box.")
        across = (np.ptp(columns) + 1) / (x1 - x0), (np.ptp(rows) + 1) / (y1 - y0)
        if len(rows) and min(across) < SPANS:
            filled = 100 * mask.sum() / ((x1 - x0) * (y1 - y0))
            return Verdict(
                "outline", 0.9, f"Only {filled:.0f} % of the box is found to move; the rest is taken for the background.",
                "If more belongs to the object, correct the outline, or give that of frame 0 by --mask; else draw the box closer.",
            )  # fmt: skip
    edge = np.ones_like(mask)
    edge[1:-1, 1:-1] = False
    touching = edge & mask
    if proposed is not None:
        touching &= ~proposed
    if seen.pin.any():
        touching &= cv2.dilate(seen.pin.astype(np.uint8), np.ones((9, 9), np.uint8)) == 0
    if touching.sum() > 3:
        return Verdict(
            "outline", 0.8, "It touches the frame's edge, so a part of the object is out of sight.", "Take frames that show all of it."
        )
    early = seen.visible[:, seen.visible[0] & ~seen.on_centroid]
    if early.shape[1] >= LEAST and (life := float(np.median(early.mean(axis=0)))) < LIVES:
        return Verdict(
            "outline", 0.7, f"Half of the points on it are lost within {100 * life:.0f} % of the clip: either the object turns, or a part "
            "of the outline does not move with it.",
            "Look at it in the film. If it is wrong, correct it, or give that of frame 0 by --mask.",
        )  # fmt: skip
    return Verdict("outline", 0.0, f"It lies within the {within}.")


def _sight(seen: Observation) -> Verdict:
    shown = int(np.count_nonzero(seen.visible.any(axis=1)))
    if shown < FEWEST:
        # the silhouette's centroid is followed only where nothing cuts the silhouette off
        what = "The object is wholly in view" if seen.on_centroid.all() else "Points of the object are followed"
        few = f"{what} in {counted(shown, 'frame')}, and a force needs {FEWEST}: fewer show no acceleration."
        return Verdict("sight", 2.0, few, "Use a longer clip or a wider --frames range.")
    lost = np.flatnonzero(areas(seen.masks) == 0)
    if len(lost):
        return Verdict(
            "sight",
            0.5 + len(lost) / len(seen.masks),
            f"The object is out of sight in {len(lost)} of {len(seen.masks)} frames, first in {frame_named(lost[0])}.",
            f"End the clip before that with --frames {seen.first_frame}:{seen.first_frame + max(int(lost[0]) - 1, 1)}.",
        )
    return Verdict("sight", 0.0, "The object is seen in every frame.")


def _tracks(seen: Observation) -> Verdict:
    if seen.on_centroid.all():
        return Verdict(
            "tracks",
            0.6,
            "Only the middle of the outline is followed, so turning and bending stay unknown.",
            "Film closer, or an object with more pattern.",
        )
    least = int(seen.visible[:, ~seen.on_centroid].sum(axis=1).min())
    if least < FEW_TRACKS:
        return Verdict(
            "tracks",
            1.0 - 0.5 * least / FEW_TRACKS,
            f"Only {least} {'point is' if least == 1 else 'points are'} followed in the worst frame.",
            "Film closer, or shorten the clip.",
        )
    return Verdict("tracks", 0.0, f"At least {least} points are followed in every frame.")


def _held(seen: Observation, proposed: np.ndarray | None) -> Verdict:
    if seen.pin.any():
        return Verdict(HELD_PLACE, 0.0, "It is marked.")
    if proposed is None:
        return Verdict(HELD_PLACE, 0.0, "The object seems to be free.")
    rows, columns = np.nonzero(proposed)
    at = f"{columns.mean():.0f}, {rows.mean():.0f}"
    return Verdict(
        HELD_PLACE,
        1.2,
        f"The object never leaves the place at {at} px, and none is marked.",
        "If it is held, give held.png of this take with --pin.",
    )


def _motion(seen: Observation) -> Verdict:
    _, swing = swings(seen)
    if not len(swing):
        place = np.where(seen.visible[..., None], seen.xy, np.nan)
        swing = np.nanmax(np.linalg.norm(place - place[:1], axis=-1), axis=0)
    most = float(np.nanpercentile(swing, 90)) if len(swing) else 0.0
    if most < HARDLY:
        return Verdict(
            "motion",
            1.5,
            f"It moves by {most:.1f} px, no more than the tracks' errors.",
            "Choose a part of the clip in which it moves more, or film closer.",
        )
    return Verdict("motion", 0.0, f"It moves by {most:.0f} px.")


def _blur(seen: Observation) -> Verdict:
    both = seen.visible[1:] & seen.visible[:-1]
    steps = np.linalg.norm(np.diff(seen.xy, axis=0), axis=-1)[both]
    fast = float(np.percentile(steps, 90)) if len(steps) else 0.0
    rows, columns = np.nonzero(np.asarray(seen.masks[0]))
    side = float(min(np.ptp(rows), np.ptp(columns))) + 1.0
    blur = OPEN * fast
    if blur > max(BLURRED * side, 3.0):
        return Verdict(
            "blur", min(blur / side, 0.9),
            f"It moves by up to {fast:.0f} px a frame. If the shutter was open for half a frame, its rim is blurred by {blur:.0f} px.",
            "Film with a shorter exposure or more frames a second.",
        )  # fmt: skip
    return Verdict("blur", 0.0, f"It moves by up to {fast:.1f} px a frame.")


def _scale(settings: ObserveSettings, views: int) -> Verdict:
    if settings.distance:
        # The panel always gives a distance, whether the user has looked at it or not.
        away = in_units(settings.distance, "m")
        return Verdict("scale", 0.0, f"It is taken to be {away} from the camera: at twice that, it would be twice as large and as fast.")
    if settings.pixels_per_metre or settings.depth or settings.depth_model or (settings.camera and views > 1):
        return Verdict("scale", 0.0, "It is given.")
    if settings.camera:
        because = "The camera is known, but not the object's distance, so it is taken to be as far away as the world's origin."
        return Verdict("scale", 0.9, because, "Give --distance, --depth or a second --view.")
    return Verdict("scale", 0.9, "No length is known, so forces are off by one unknown factor.", "Give --pixels-per-metre or --distance.")


def _depth_motion(seen: Observation) -> Verdict:
    """Motion in depth, from the tracks' distances from their centroid, or from the outline's area if there are too few tracks."""
    early = np.flatnonzero(seen.visible[0] & ~seen.on_centroid)
    grown = []
    for xy, visible in zip(seen.xy[1:, early], seen.visible[1:, early]):
        if visible.sum() >= FEW_TRACKS:
            spans = [np.linalg.norm(points[visible] - points[visible].mean(axis=0), axis=1) for points in (xy, seen.xy[0, early])]
            grown.append(float(spans[0].sum() / max(spans[1].sum(), 1e-9)))
    if not grown:
        sizes = areas(seen.masks)
        whole = (sizes > 0) & ~partly_hidden(sizes) & ~np.array([at_rim(mask) for mask in seen.masks])
        grown = [float(np.sqrt(size / sizes[0])) for size in sizes[1:][whole[1:]]]
    most = max(grown, key=lambda one: abs(np.log(one)), default=1.0)
    if abs(np.log(most)) <= np.log1p(GROWS):
        return Verdict("motion in depth", 0.0, "It stays about as large, so it moves across the view.")
    return Verdict(
        "motion in depth", 0.5, f"It {'grows' if most > 1.0 else 'shrinks'} to {100 * most:.0f} % of its first size: it moves along the "
        "view, turns, stretches or is partly hidden, which one camera cannot tell apart.", "Film across the motion, or add a second view.",
    )  # fmt: skip


def _clip(seen: Observation) -> list[Verdict]:
    return [Verdict("clip", one.severity, one.because, one.do) for one in seen.doubts or ()]
