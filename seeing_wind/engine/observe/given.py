"""The files that the user gives beside a clip, checked against it before the object is looked for."""

from __future__ import annotations

import numpy as np

from ..errors import ObjectError
from ..progress import Progress
from ..settings import ObserveSettings
from .clip.camera import read_camera
from .clip.depth import read_depth
from .clip.frames import Clip, read_clip
from .mask.first_mask import check_extent, check_outline, point_list, read_mask
from .mask.from_box import pixels_in
from .networks import check_networks
from .tracks.file import checked_tracks, starting_on


def check_clip(path: str, settings: ObserveSettings, progress: Progress) -> tuple[int, int]:
    """Check all that can be checked of a clip and the files that belong to it by reading them once; returns the first and last frame used.

    Raises:
        ClipError, UsageError, ObjectError: as `read_clip`, `check_networks` and `check_given`.
    """
    check_networks(settings)
    clip = read_clip(path, settings.frames, settings.fps, progress, resized=lambda height, width: (1, 1), keep=())
    check_given(settings, clip, progress)
    return clip.first_frame, clip.first_frame + len(clip.frames) - 1


def check_given(settings: ObserveSettings, clip: Clip, progress: Progress) -> None:
    """Check the files, box and points of the settings against the clip, in the file's own pixels.

    Raises:
        UsageError: as `read_mask`, `read_depth`, `read_camera`, `pixels_in`, `point_list`, `checked_tracks` and `starting_on`.
        ObjectError: as `check_extent`, `check_outline`, `refuse_none_held` and `refuse_all_held`.
    """
    (height, width), frames = clip.size, len(clip.frames)
    area = np.ones((height, width), bool)
    if settings.mask is not None:
        mask = read_mask(settings.mask, height, width)
        check_extent(mask)
        area = mask if settings.outline is None and settings.correct is None else area  # these may add to the object
    if settings.outline is not None:
        check_outline(read_mask(settings.outline, height, width, "outline"), settings.outline)
    if settings.pin is not None:
        held = read_mask(settings.pin, height, width, "pin mask") & area
        refuse_none_held(held)
        refuse_all_held(held, area, settings.pin)
    if settings.depth is not None:
        read_depth(settings.depth, height, width)
    if settings.camera is not None:
        read_camera(settings.camera, width, height, frames, clip.first_frame)
    if settings.box is not None:
        pixels_in(settings.box, height, width)
    if settings.points is not None:
        point_list(settings.points, height, width)
    if settings.tracks is not None:
        xy, visible, _ = checked_tracks(settings.tracks, frames, clip.first_frame, progress if settings.frames is None else None)
        starting_on(np.ones((height, width), bool), xy[0], visible[0], settings.tracks)  # wherever the object is


def refuse_none_held(held: np.ndarray) -> None:
    """Raise ObjectError if no pixel of the object is in its held part (H, W) bool."""
    if not held.any():
        raise ObjectError(
            "The pinned pixels do not touch the object.", "Paint the part that is held, over the object in the first frame."
        )


def refuse_all_held(held: np.ndarray, area: np.ndarray, path: str) -> None:
    """Raise ObjectError if the part (H, W) bool held by the PNG file at `path` is all of `area` (H, W) bool, which contains the object."""
    if held.any() and held.sum() == area.sum():
        raise ObjectError(
            f"The pin mask {path} covers the whole object, so nothing of it could move.", "Paint only the part of it that is held in place."
        )
