"""The stage *observe*: from a clip to the object's masks, depth and tracks."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from ..errors import ObjectError
from ..masks import Masks, areas
from ..progress import Progress
from ..records import Observation
from ..settings import ObserveSettings
from .clip.camera import find_camera
from .clip.defects import check_pictures, tell_defects
from .clip.depth import object_depth, typical_depth
from .clip.frames import Clip, read_clip
from .clip.lens import Lens
from .clip.opencv_threads import one_thread
from .clip.shake import as_filmed, camera_turns, steadied, turning
from .clip.stored import Frames
from .mask.background import Plate, clean_plate, median_plate, stands_still
from .mask.by_turns import with_background
from .mask.evidence import Looks
from .mask.first_mask import point_list, read_mask
from .mask.follow import MaskFollower, carried
from .mask.from_box import moving_in
from .networks import Followed, check_networks, first_depth, first_outline, network_masks, network_tracks
from .tracks.centroid import centroid_track
from .tracks.file import read_tracks
from .tracks.reseed import Generations
from .tracks.tracker import ENOUGH, find_corners
from .working_size import WorkingSize, working_scale

FEW_PATCHES = 900
"""Pixels (three tracking patches) below which a body's corners are nearly one and the same patch: losing some, all go."""

SILHOUETTE = 0.02
"""A turning body's silhouette has its centroid off the body's own by about this part of its size."""

ROUND_POINT = 0.25
"""About how far the object may reach from a point on it, in units of the picture's shorter side."""


@dataclass(frozen=True)
class _Tracks:
    xy: np.ndarray
    visible: np.ndarray
    sigma: np.ndarray
    on_centroid: np.ndarray


def observe(clip: str | Path, settings: ObserveSettings, progress: Progress) -> Observation:
    """What is seen in `clip` (a video, a folder of pictures, or a pattern), with pixels those of the file.

    Raises:
        ClipError, ObjectError, UsageError: as the parts say (`read_clip`, `first_mask`, `find_camera`, `object_depth`, `read_tracks`).
        Cancelled: at a safe point, at least twice a second.
    """
    with one_thread():
        return _observe(clip, settings, progress)


def _observe(path: str | Path, settings: ObserveSettings, progress: Progress) -> Observation:
    check_networks(settings)
    progress.update(0.0, "reading the clip")

    def resized(height: int, width: int) -> tuple[int, int]:
        return WorkingSize(height, width, working_scale(settings, height, width)).work

    clip = read_clip(path, settings.frames, settings.fps, progress, resized=resized)
    check_pictures(clip.frames, clip.first_frame, progress)
    if clip.frames.shape[1:3] == clip.size:
        return _seen(clip, settings, progress)
    size = WorkingSize(*clip.size, working_scale(settings, *clip.size))
    with tempfile.TemporaryDirectory(prefix="seeing_wind_") as folder:
        seen = _seen(clip, size.settings(settings, clip, Path(folder)), progress)
    return pinned(size.observation(seen, clip), settings.pin)


def _seen(clip: Clip, settings: ObserveSettings, progress: Progress) -> Observation:
    """The observation of a clip at the size at which it is."""
    pictures, height, width = clip.frames.shape[:3]
    around = _marked_area(settings, height, width)
    known_depth, depth_name = first_depth(settings, clip, progress)
    depth_of_object = typical_depth(known_depth, around)
    camera, distance = find_camera(settings, width, height, pictures, clip.first_frame, depth_of_object, progress)
    lens = Lens(camera)
    clip, settings = replace(clip, frames=lens.straight(clip.frames, progress)), _straight(settings, lens)
    around = lens.straight_map(around)
    progress.update(0.05, "looking at the background")
    still = stands_still(clip.frames, camera, around)
    turns = None if still or settings.camera is not None else camera_turns(clip.frames, camera, around, progress)
    if turns is not None:
        progress.warn("The camera is not quite still; it is taken to turn in the hand, and its turns are taken out.")
        still = True
        clip = replace(clip, frames=steadied(clip.frames, turns, camera, progress))
    elif not still and settings.camera is None:
        progress.warn("The camera moves, and without --camera its motion is taken for the object's.")
    plate = median_plate(clip.frames, progress) if still else None
    median = None if plate is None else plate.color
    progress.update(0.08, "finding the object")
    moving = None if plate is None else moving_in(clip.frames, plate.noise)
    mask = first_outline(settings, clip.frames, plate, moving, lens, progress)
    progress.update(0.1, "following the object")
    looks = None
    if plate is not None and moving is not None:
        mask, plate, looks = with_background(clip.frames, mask, plate, moving, settings, around, progress)
    pin = _pin(settings.pin, mask, lens)
    depth = object_depth(_depth_map(known_depth, mask, distance, lens, settings), depth_name, mask, distance, progress)
    masks, tracks = _follow(clip, mask, plate, looks, lens, settings, progress)
    tell_defects(clip.frames, masks, progress)
    progress.update(0.95, "background")
    background = clean_plate(clip.frames, masks, median, progress)
    xy = tracks.xy
    if turns is not None:
        steady_xy, masks = as_filmed(xy, masks, turns, camera)
        # Tracks from a file are in the filmed pixels already.
        xy = steady_xy if settings.tracks is None else xy
        camera = turning(camera, turns)
    progress.update(1.0, f"{len(tracks.on_centroid)} tracks")
    return Observation(
        clip=clip.path,
        fps=clip.fps,
        first_frame=clip.first_frame,
        camera=camera,
        image=np.array(clip.frames[0]),
        background=background,
        masks=masks,
        depth=depth,
        pin=pin,
        xy=xy,
        visible=tracks.visible,
        sigma=tracks.sigma,
        on_centroid=tracks.on_centroid,
    )


def _depth_map(depth: np.ndarray | None, mask: np.ndarray, distance: float, lens: Lens, settings: ObserveSettings) -> np.ndarray | None:
    """The known depth (H, W) over the straightened picture; a network's is scaled to the distance that the user gave."""
    if depth is None:
        return None
    straight = lens.straight_map(depth, np.inf)
    typical = typical_depth(straight, mask)
    if settings.depth is None and (settings.distance or settings.pixels_per_metre) and typical:
        straight = straight * np.float32(distance / typical)
    return straight


def _straight(settings: ObserveSettings, lens: Lens) -> ObserveSettings:
    """The settings with their box or points in the pinhole's pixels."""
    if not lens.bends:
        return settings
    if settings.box is not None:
        return replace(settings, box=lens.straight_box(settings.box))
    if settings.points is not None and len(settings.points) % 2 == 0:
        straight = lens.straight_points(np.array(settings.points, dtype=np.float64).reshape(-1, 2))
        return replace(settings, points=tuple(float(value) for value in straight.ravel()))
    return settings


def _marked_area(settings: ObserveSettings, height: int, width: int) -> np.ndarray:
    """(H, W) bool: about where a mask, box or points say that the object is; nowhere without them."""
    if settings.mask:
        return read_mask(settings.mask, height, width)
    area = np.zeros((height, width), np.uint8)
    if settings.box is not None and np.isfinite(settings.box).all():
        low, high = np.floor(settings.box[:2]), np.ceil(settings.box[2:])
        x0, y0, x1, y1 = (int(value) for value in np.clip([*low, *high], 0, max(height, width)))
        area[y0 : y1 + 1, x0 : x1 + 1] = 1
    elif settings.box is None and settings.points is not None:
        for x, y in np.round(point_list(settings.points, height, width)).astype(int):
            cv2.circle(area, (int(x), int(y)), round(ROUND_POINT * min(height, width)), 1, -1)
    return area > 0


def pinned(seen: Observation, pin: str | None) -> Observation:
    """The same observation with what the PNG `pin` holds, in the file's own pixels; nothing without one.

    Raises:
        UsageError: no such picture, or of another size. ObjectError: it does not touch the object.
    """
    return replace(seen, pin=_pin(pin, np.asarray(seen.masks[0]), Lens(seen.camera)))


def _pin(path: str | None, mask: np.ndarray, lens: Lens) -> np.ndarray:
    """(H, W) bool, the held part of the object."""
    if path is None:
        return np.zeros_like(mask)
    pin = lens.straight_map(read_mask(path, mask.shape[0], mask.shape[1], "pin mask")) & mask
    if not pin.any():
        raise ObjectError(
            "The pinned pixels do not touch the object.", "Paint the part that is held, over the object in the first picture."
        )
    return pin


def _follow(
    clip: Clip, mask: np.ndarray, plate: Plate | None, looks: Looks | None, lens: Lens, settings: ObserveSettings, progress: Progress
) -> tuple[Masks, _Tracks]:
    """Masks (T+1, H, W) and tracks, in one pass over the clip, or two where the body's silhouette has to serve as a track."""
    frames = clip.frames
    given: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    if settings.tracks:
        xy, visible, sigma = read_tracks(settings.tracks, len(frames), clip.first_frame, lens.filmed_map(mask), progress)
        given = (lens.straight_points(xy), visible, sigma)
    elif settings.track_model:
        given = network_tracks(settings.track_model, frames, mask, progress)
    corners = find_corners(frames[0], mask) if given is None else np.zeros((0, 2))
    # A body of a few patches or corners is followed by its silhouette where they are lost: new ones would be as few.
    reseed = len(corners) >= ENOUGH and int(mask.sum()) >= FEW_PATCHES
    points = Generations(frames[0], mask, corners, reseed=reseed)
    steps: Iterator[tuple[np.ndarray, MaskFollower | Followed]] = (
        network_masks(settings.mask_model, frames, mask, progress)
        if settings.mask_model
        else carried(frames, len(frames), mask, plate, progress, 0.3, 0.9, looks)
    )

    def followed() -> Iterator[np.ndarray]:
        yield mask
        for t, (new, follower) in enumerate(steps, start=1):
            points.advance(frames[t], follower.flow, new)
            yield new

    masks = Masks.of(followed())
    seen = areas(masks) > 0
    _tell_lost(seen, progress)
    if given is not None:
        return masks, _Tracks(*given, np.zeros(given[0].shape[1], bool))
    xy, visible, sigma = points.tracks()
    found = _Tracks(xy, visible, sigma, np.zeros(xy.shape[1], bool))
    # Later tracks do not count: only those of picture 0 say for certain where on the body they are.
    enough = visible[:, : len(corners)].sum(axis=1) >= ENOUGH
    if enough[seen].all():
        return masks, found
    return masks, _with_centroid(frames, masks, plate, found, enough, progress)


def _tell_lost(seen: np.ndarray, progress: Progress) -> None:
    """Say where the object is out of sight: `seen` (T+1,) bool. Raises ObjectError where that is everywhere but in picture 0."""
    if not seen[1:].any():
        raise ObjectError(
            "The object is lost right after the first picture.",
            "Mark it more closely, start where it is in full view, or choose a slower clip.",
        )
    if not seen.all():
        lost = np.flatnonzero(~seen)
        progress.warn(f"The object is out of sight in {len(lost)} of {len(seen)} pictures, first in picture {lost[0]}.")


def _with_centroid(
    frames: Frames, masks: Masks, plate: Plate | None, corners: _Tracks, enough: np.ndarray, progress: Progress
) -> _Tracks:
    """The silhouette's centroid instead of the corner tracks, or after them.

    Not `enough` (T+1,) corners for most of the clip's first half, or a tiny body: the centroid alone. Corners that turn out of sight
    later (a sheet seen edge-on): the centroid joins where they are too few, with the larger sigma of a silhouette that turns.
    """
    place, visible, sigma = centroid_track(frames, masks, plate)
    if enough[: max(2, len(frames) // 2)].mean() < 0.75 or masks[0].sum() < FEW_PATCHES:
        progress.warn(
            "The object is too small or too plain for single points, so its silhouette's centroid is followed: its rotation stays unknown."
        )
        return _Tracks(place[:, None], visible[:, None], sigma[:, None], np.ones(1, bool))
    joins = visible & ~enough
    progress.warn(
        f"Too few points of the object are seen in {int((~enough).sum())} of {len(frames)} pictures; "
        "there the silhouette's centroid is followed."
    )
    sigma = np.hypot(sigma, SILHOUETTE * np.sqrt(areas(masks).max()))
    return _Tracks(
        np.concatenate([corners.xy, place[:, None]], axis=1),
        np.concatenate([corners.visible, joins[:, None]], axis=1),
        np.concatenate([corners.sigma, sigma[:, None]], axis=1),
        np.append(corners.on_centroid, True),
    )
