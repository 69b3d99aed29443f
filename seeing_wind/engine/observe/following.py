"""Following the object through the clip: its masks and its tracks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..conventions import frame_named
from ..errors import ObjectError
from ..masks import Masks, areas
from ..progress import Journal, Progress
from ..records import Recognised
from .clip.frames import Clip
from .clip.lens import Lens
from .clip.stored import Frames
from .mask.background import Plate
from .mask.follow import MaskFollower
from .mask.through import Follower, follow_clip
from .networks import Outlined, network_masks, network_tracks
from .outline import Outline
from .tracks.centroid import centroid_track
from .tracks.file import read_tracks
from .tracks.recognise import are_lost, recognise
from .tracks.reseed import Generations
from .tracks.tracker import ENOUGH, find_corners

FEW_PATCHES = 900
"""Area [px] (three tracking patches) below which all corners of a body share nearly one patch: when some are lost, all are."""

SEEN_AT_ALL, COMING_BACK, SPELL = 0.5, 0.5, 5.0
"""Corners are flicker of something see-through, shiny or blurred if, in the clip's first half, they are visible for a smaller fraction of
the time than SEEN_AT_ALL and for fewer than SPELL frames in a row, and if more than the fraction COMING_BACK of the losses is followed by
a return. On a body that turns, lost corners stay lost for half a turn; those of flags were visible for 8 frames or more between folds."""

SILHOUETTE = 0.02
"""Distance between the centroid of a turning body's silhouette and the body's own, in units of its size."""


@dataclass(frozen=True)
class Tracks:
    """Tracks of K points through T+1 frames; the fields are those of `records.Observation`."""

    xy: np.ndarray
    visible: np.ndarray
    sigma: np.ndarray
    on_centroid: np.ndarray
    recognised: Recognised | None = None
    corners: np.ndarray | None = None
    """(T+1, C) bool: where the tracks come from a file or a network, in which frames corners of the object in frame 0 are followed all the
    same, to see whether its outline can be relied on."""


def follow(clip: Clip, outline: Outline, lens: Lens, progress: Progress, journal: Journal) -> tuple[Masks, Tracks]:
    """Masks (T+1, H, W) and tracks of the object, in one pass over the clip, or two if its silhouette has to serve as a track.

    Raises:
        ObjectError: the object is lost right after frame 0. UsageError: a tracks file that cannot be used.
        ModelError, MissingPackage: a network that cannot be used.
    """
    frames, settings, mask, outlines = clip.frames, outline.settings, outline.mask, outline.corrected
    given: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    if settings.tracks:
        xy, visible, sigma = read_tracks(settings.tracks, len(frames), clip.first_frame, lens.filmed_map(mask), progress)
        given = (lens.straight_points(xy), visible, sigma)
    elif settings.track_model:
        given = network_tracks(settings.track_model, frames, mask, progress)
    corners = find_corners(frames[0], mask)
    # A body of a few patches or corners is followed by its silhouette once they are lost: new corners would be as few.
    reseed = given is None and len(corners) >= ENOUGH and int(mask.sum()) >= FEW_PATCHES
    points = Generations(frames[0], mask, corners, reseed=reseed)
    if settings.mask_model:
        outlines = journal.once("masks", Masks, lambda: network_masks(settings.mask_model or "", frames, mask, progress.part(0.1, 0.7)))
    follower: Follower
    if outlines is None:
        follower = MaskFollower(frames[0], mask, outline.known, progress)
    else:
        follower = Outlined(frames[0], outlines)
    masks = follow_clip(frames.__getitem__, len(frames), follower, progress.part(0.3, 0.9), journal.loop("follow"), points)
    _tell_lost(areas(masks) > 0, progress)
    if given is not None:
        return masks, Tracks(*given, np.zeros(given[0].shape[1], bool), corners=points.tracks()[1])
    found = _tracks_of(points, len(corners), frames, masks, outline.known.still, progress)
    if settings.recognise and len(corners) >= ENOUGH and not found.on_centroid.all() and are_lost(found.visible):
        found = replace(found, recognised=recognise(frames, masks, progress.part(0.9, 0.95)))
    return masks, found


def _tracks_of(points: Generations, first: int, frames: Frames, masks: Masks, plate: Plate | None, progress: Progress) -> Tracks:
    """The points' tracks, of which `first` begin in frame 0; if these are too few, the silhouette's centroid joins or replaces them."""
    xy, visible, sigma = points.tracks()
    seen = areas(masks) > 0
    # Later tracks do not count: only those from frame 0 have a certain place on the body.
    early, half = visible[:, :first], max(2, len(frames) // 2)
    enough = early.sum(axis=1) >= ENOUGH
    last = bool(enough[seen].all())
    few = not last and (enough[:half].mean() < 0.75 or masks[0].sum() < FEW_PATCHES)
    if few or flickers(early, half):
        return _centroid_alone(frames, masks, plate, progress)
    found = Tracks(xy, visible, sigma, np.zeros(xy.shape[1], bool))
    return found if last else _with_centroid(frames, masks, plate, found, enough, progress)


def flickers(visible: np.ndarray, half: int) -> bool:
    """Whether corners that should stay visible come and go, see `SEEN_AT_ALL`. `visible`: (T+1, K) bool; `half`: half of the frames."""
    lost, back = visible[:-1] & ~visible[1:], ~visible[:-1] & visible[1:]
    early = visible[:half]
    brief = early.sum() < SPELL * lost[: half - 1].sum()
    return bool(early.mean() < SEEN_AT_ALL and brief and back.sum() > COMING_BACK * lost.sum())


def _tell_lost(seen: np.ndarray, progress: Progress) -> None:
    """Warn of frames in which the object is not `seen` (T+1,) bool. Raises ObjectError if it is seen in frame 0 only."""
    if not seen[1:].any():
        raise ObjectError(
            "The object is lost right after the first frame.",
            "Mark it more closely, start where it is in full view, or choose a slower clip.",
        )
    if not seen.all():
        lost = np.flatnonzero(~seen)
        progress.warn(f"The object is out of sight in {len(lost)} of {len(seen)} frames, first in {frame_named(lost[0])}.", judged=True)


def _centroid_alone(frames: Frames, masks: Masks, plate: Plate | None, progress: Progress) -> Tracks:
    """The silhouette's centroid in place of corner tracks."""
    place, visible, sigma = centroid_track(frames, masks, plate)
    progress.warn(
        "The object is too small or too plain, or its surface too fickle, for single points to be followed. Its silhouette's centroid is "
        "followed instead, so its rotation stays unknown.",
        judged=True,
    )
    return Tracks(place[:, None], visible[:, None], sigma[:, None], np.ones(1, bool))


def _with_centroid(frames: Frames, masks: Masks, plate: Plate | None, corners: Tracks, enough: np.ndarray, progress: Progress) -> Tracks:
    """The `corners` tracks with the silhouette's centroid as one more, visible in the frames without `enough` (T+1,) bool corners.

    Corners get lost when they turn out of sight (a sheet seen edge-on), so the centroid gets the larger sigma of a turning silhouette.
    """
    place, visible, sigma = centroid_track(frames, masks, plate)
    joins = visible & ~enough
    progress.warn(
        f"Too few points of the object are seen in {int((~enough).sum())} of {len(frames)} frames; "
        "there the silhouette's centroid is followed.",
        judged=True,
    )
    sigma = np.hypot(sigma, SILHOUETTE * np.sqrt(areas(masks).max()))
    return Tracks(
        np.concatenate([corners.xy, place[:, None]], axis=1),
        np.concatenate([corners.visible, joins[:, None]], axis=1),
        np.concatenate([corners.sigma, sigma[:, None]], axis=1),
        np.append(corners.on_centroid, True),
    )
