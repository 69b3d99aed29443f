"""Preparing a clip: frames without lens distortion, and as far as possible from a camera that stands still; and the background."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ..progress import Journal, Progress
from ..records import Doubt
from ..settings import ObserveSettings
from .clip.camera import find_camera
from .clip.depth import typical_depth
from .clip.filmed.surroundings import camera_doubts
from .clip.frames import Clip
from .clip.lens import Lens
from .clip.shake import camera_turns, stabilise
from .clip.stillness import path_doubt, stands_still
from .mask.background import Plate, median_plate
from .mask.first_mask import point_list, read_mask
from .networks import first_depth

MOVES_DO = "Film from a tripod, or give the camera's path with --camera."
ROUND_POINT = 0.25
"""About how far the object may reach from a point marked on it, in units of the frame's shorter side."""


@dataclass(frozen=True)
class Steady:
    """A prepared clip: what is known before the object is looked for."""

    clip: Clip
    """The clip, with lens distortion and camera turns removed from its frames."""
    settings: ObserveSettings
    """The settings, with box and points in the straightened pixels."""
    lens: Lens
    distance: float
    """The object's distance from the camera [m]."""
    depth: np.ndarray | None
    """(H, W) [m] of frame 0 as it was filmed; None where unknown."""
    depth_name: str
    """Where the depth is from, for messages."""
    around: np.ndarray
    """(H, W) bool: about where the object is according to the user."""
    turns: np.ndarray | None
    """(T+1, 3, 3) the camera's turns that were removed from the frames; None if there were none."""
    plate: Plate | None
    """The background; None if the camera moves."""
    doubts: list[Doubt]
    asked: Future[list[Doubt]] | None
    """Further doubts, still being computed; None if there is nothing to compute."""


def steady_clip(clip: Clip, settings: ObserveSettings, progress: Progress, journal: Journal, beside: Executor) -> Steady:
    """Prepare a clip; doubts about the camera's focus and shutter are computed in the executor `beside`."""
    count, height, width = clip.frames.shape[:3]
    around = marked_area(settings, height, width)
    depth, depth_name = first_depth(settings, clip, progress)
    camera, distance = find_camera(settings, width, height, count, clip.first_frame, typical_depth(depth, around), progress)
    lens = Lens(camera)
    clip, settings = replace(clip, frames=lens.straight(clip.frames, progress)), _straight(settings, lens)
    around = lens.straight_map(around)
    progress.update(0.05, "looking at the background")
    still = stands_still(clip.frames, camera, around)
    doubts, asked = [*clip.doubts], None if settings.camera is not None else beside.submit(camera_doubts, clip.frames, around, progress)
    if (wrong_path := path_doubt(clip.frames, camera, around, distance)) is not None:
        doubts.append(wrong_path)
    turns = None if still or settings.camera is not None else camera_turns(clip.frames, camera, around, progress, journal)
    if turns is not None:
        progress.warn("The camera is not quite still: it is taken to turn in the hand, and its turns are removed from the frames.")
        still = True
        clip = replace(clip, frames=stabilise(clip.frames, turns, camera, progress))
    elif not still and settings.camera is None:
        doubts.append(Doubt(1.2, "The camera moves, and without --camera its motion is taken for the object's.", MOVES_DO))
    plate = median_plate(clip.frames, progress) if still else None
    return Steady(clip, settings, lens, distance, depth, depth_name, around, turns, plate, doubts, asked)


def _straight(settings: ObserveSettings, lens: Lens) -> ObserveSettings:
    """The settings with their box or points in the straightened pixels."""
    if not lens.bends:
        return settings
    if settings.box is not None:
        return replace(settings, box=lens.straight_box(settings.box))
    if settings.points is not None and len(settings.points) % 2 == 0:
        straight = lens.straight_points(np.array(settings.points, dtype=np.float64).reshape(-1, 2))
        return replace(settings, points=tuple(float(value) for value in straight.ravel()))
    return settings


def marked(settings: ObserveSettings) -> bool:
    """Whether the object is marked in frame 0."""
    return any(one is not None for one in (settings.mask, settings.box, settings.points, settings.prompt))


def marked_area(settings: ObserveSettings, height: int, width: int) -> np.ndarray:
    """About where the object is according to the user's mask, outline, box or points, (H, W) bool; empty without any."""
    if settings.mask or (settings.outline and not marked(settings)):
        return read_mask(settings.mask or settings.outline or "", height, width)
    area = np.zeros((height, width), np.uint8)
    if settings.box is not None and np.isfinite(settings.box).all():
        low, high = np.floor(settings.box[:2]), np.ceil(settings.box[2:])
        x0, y0, x1, y1 = (int(value) for value in np.clip([*low, *high], 0, max(height, width)))
        area[y0 : y1 + 1, x0 : x1 + 1] = 1
    elif settings.box is None and settings.points is not None:
        for x, y in np.round(point_list(settings.points, height, width)).astype(int):
            cv2.circle(area, (int(x), int(y)), round(ROUND_POINT * min(height, width)), 1, -1)
    return area > 0
