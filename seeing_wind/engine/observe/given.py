"""The files that the user gives beside a clip, checked against it before the object is looked for."""

from __future__ import annotations

import numpy as np

from ..errors import ObjectError
from ..progress import Progress
from ..settings import ObserveSettings
from .clip.camera import read_camera
from .clip.depth import read_depth
from .clip.frames import Clip, read_clip
from .mask.cutting import widened
from .mask.first_mask import check_extent, check_outline, point_list, read_mask
from .mask.from_box import pixels_in
from .networks import check_networks
from .tracks.file import checked_tracks, starting_on, tell_left_out

SLACK = 3
"""Distance [px] by which the object's edge may be off its mask or box once the frame is straightened or made smaller."""


def check_clip(path: str, settings: ObserveSettings, progress: Progress) -> tuple[int, int]:
    """Check all that can be checked of a clip and the files that belong to it by reading them once; returns the first and last frame used.

    Raises:
        ClipError, UsageError, ObjectError: as `read_clip`, `check_networks` and `check_given`.
    """
    check_networks(settings)
    clip = read_clip(path, settings.frames, settings.fps, progress, resized=lambda height, width: (1, 1), keep=())
    check_given(settings, clip, progress, foretell=True)
    return clip.first_frame, clip.first_frame + len(clip.frames) - 1


def check_given(settings: ObserveSettings, clip: Clip, progress: Progress, foretell: bool = False) -> None:
    """Check the files, box and points of the settings against the clip, in the file's own pixels.

    Args:
        foretell: whether to warn of tracks beside the object's mask; else `read_tracks` does so, once the object is known.

    Raises:
        UsageError: as `read_mask`, `read_depth`, `read_camera`, `pixels_in`, `point_list`, `checked_tracks` and `starting_on`.
        ObjectError: as `check_extent`, `check_outline`, `refuse_none_held` and `refuse_all_held`.
    """
    (height, width), frames = clip.size, len(clip.frames)
    area = np.ones((height, width), bool)
    grows = settings.outline is not None or settings.correct is not None  # these may add to the object
    if settings.mask is not None:
        mask = read_mask(settings.mask, height, width)
        check_extent(mask)
        area = area if grows else mask
    around = area
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
        box = pixels_in(settings.box, height, width)
        around = area if grows else box
    if settings.points is not None:
        point_list(settings.points, height, width)
    if settings.tracks is not None:
        xy, visible, _ = checked_tracks(settings.tracks, frames, clip.first_frame, progress if settings.frames is None else None)
        on = starting_on(widened(around, SLACK), xy[0], visible[0], settings.tracks)
        if foretell and settings.mask is not None:
            tell_left_out(on, progress)


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
