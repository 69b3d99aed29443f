"""The files that the user gives beside a clip, checked against it before the object is looked for."""

from __future__ import annotations

from ..progress import Progress
from ..settings import ObserveSettings
from .clip.camera import read_camera
from .clip.depth import read_depth
from .clip.frames import Clip, read_clip
from .mask.first_mask import point_list, read_mask
from .mask.from_box import pixels_in
from .networks import check_networks
from .tracks.file import checked_tracks


def check_clip(path: str, settings: ObserveSettings, progress: Progress) -> tuple[int, int]:
    """Check all that can be checked of a clip and the files that belong to it by reading them once; returns the first and last frame used.

    Raises:
        ClipError, UsageError: as `read_clip`, `check_networks` and `check_given`.
    """
    check_networks(settings)
    clip = read_clip(path, settings.frames, settings.fps, progress, resized=lambda height, width: (1, 1), keep=())
    check_given(settings, clip, progress)
    return clip.first_frame, clip.first_frame + len(clip.frames) - 1


def check_given(settings: ObserveSettings, clip: Clip, progress: Progress) -> None:
    """Check the files, box and points of the settings against the clip, in the file's own pixels.

    Raises:
        UsageError: as `read_mask`, `read_depth`, `read_camera`, `pixels_in`, `point_list` and `checked_tracks`.
    """
    (height, width), frames = clip.size, len(clip.frames)
    for file, what in ((settings.mask, "mask"), (settings.outline, "outline"), (settings.pin, "pin mask")):
        if file is not None:
            read_mask(file, height, width, what)
    if settings.depth is not None:
        read_depth(settings.depth, height, width)
    if settings.camera is not None:
        read_camera(settings.camera, width, height, frames, clip.first_frame)
    if settings.box is not None:
        pixels_in(settings.box, height, width)
    if settings.points is not None:
        point_list(settings.points, height, width)
    if settings.tracks is not None:
        checked_tracks(settings.tracks, frames, clip.first_frame, progress if settings.frames is None else None)
