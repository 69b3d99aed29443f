"""The stage *observe*: from a clip to the object's masks, depth and tracks."""

from __future__ import annotations

from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from .. import systems
from ..errors import ObjectError, UsageError
from ..progress import Journal, Progress
from ..records import Camera, Doubt, Doubts, Observation
from ..settings import ObserveSettings
from .clip.camera import find_camera
from .clip.defects import check_frames, tell_defects
from .clip.depth import object_depth, typical_depth
from .clip.filmed.beside import touching
from .clip.filmed.surroundings import camera_doubts
from .clip.frames import Clip, read_clip
from .clip.lens import Lens
from .clip.opencv_threads import one_thread
from .clip.shake import as_filmed, camera_turns, homography, stabilise, through_mask, turning
from .clip.stillness import stands_still
from .following import follow
from .mask.background import clean_plate, median_plate
from .mask.by_turns import with_background
from .mask.corrected import Marks, carried_to_first, marks_of, with_corrections
from .mask.cutting import LEAST_PIXELS
from .mask.first_mask import point_list, read_mask
from .mask.from_box import box_round
from .mask.moving.in_box import hardly_moves, moving_from
from .networks import check_networks, first_depth, first_outline
from .working_size import WorkingSize, working_scale

HUGE = 50.0
"""Metres: an object longer than this is more often one whose distance is in millimetres."""
MOVES_DO = "Film from a tripod, or give the camera's path with --camera."
ROUND_POINT = 0.25
"""About how far the object may reach from a point on it, in units of the frame's shorter side."""


def observe(clip: str | Path, settings: ObserveSettings, progress: Progress, journal: Journal | None = None) -> Observation:
    """What is seen in `clip` (a video, a folder of images, or a pattern), with pixels those of the file.

    Args:
        journal: keeps what was followed so far, for one clip and its settings without the pin.

    Raises:
        ClipError, ObjectError, UsageError: as the parts say (`read_clip`, `first_mask`, `find_camera`, `object_depth`, `read_tracks`).
        Cancelled: at a safe point, at least twice a second.
    """
    with one_thread(), ThreadPoolExecutor(1) as beside:
        return _observe(clip, settings, progress, journal or Journal(), beside)


def _observe(path: str | Path, settings: ObserveSettings, progress: Progress, journal: Journal, beside: Executor) -> Observation:
    check_networks(settings)
    progress.update(0.0, "reading the clip")

    def resized(height: int, width: int) -> tuple[int, int]:
        return WorkingSize(height, width, working_scale(settings, height, width)).work

    clip = read_clip(path, settings.frames, settings.fps, progress, resized=resized)
    check_frames(clip.frames, clip.first_frame, progress)
    if clip.frames.shape[1:3] == clip.size:
        return _seen(clip, settings, progress, journal, beside)
    size = WorkingSize(*clip.size, working_scale(settings, *clip.size))
    with systems.scratch() as folder:
        seen = _seen(clip, size.settings(settings, clip, folder), progress, journal, beside)
    return pinned(size.observation(seen, clip), settings.pin)


def _seen(clip: Clip, settings: ObserveSettings, progress: Progress, journal: Journal, beside: Executor) -> Observation:
    """The observation of a clip at the size at which it is; what nothing else waits for is looked at `beside` it, on another core."""
    count, height, width = clip.frames.shape[:3]
    around = _marked_area(settings, height, width)
    known_depth, depth_name = first_depth(settings, clip, progress)
    depth_of_object = typical_depth(known_depth, around)
    camera, distance = find_camera(settings, width, height, count, clip.first_frame, depth_of_object, progress)
    lens = Lens(camera)
    clip, settings = replace(clip, frames=lens.straight(clip.frames, progress)), _straight(settings, lens)
    around = lens.straight_map(around)
    progress.update(0.05, "looking at the background")
    still = stands_still(clip.frames, camera, around)
    doubts, asked = [*clip.doubts], None if settings.camera is not None else beside.submit(camera_doubts, clip.frames, around, progress)
    turns = None if still or settings.camera is not None else camera_turns(clip.frames, camera, around, progress, journal)
    if turns is not None:
        progress.warn("The camera is not quite still; it is taken to turn in the hand, and its turns are taken out.")
        still = True
        clip = replace(clip, frames=stabilise(clip.frames, turns, camera, progress))
    elif not still and settings.camera is None:
        doubts.append(Doubt(1.2, "The camera moves, and without --camera its motion is taken for the object's.", MOVES_DO))
    plate = median_plate(clip.frames, progress) if still else None
    median = None if plate is None else plate.color
    progress.update(0.08, "finding the object")
    shown, marks = _corrections(settings, clip, lens, turns)
    if shown and not marked(settings):
        # Nothing else says where it is: it is sought in frame 0 where it is followed back to.
        settings = replace(settings, box=box_round(carried_to_first(clip.frames, shown, plate, progress)))
        around = _marked_area(settings, height, width)
    boxed = around if settings.box is not None else np.zeros_like(around)
    moving = None if plate is None else moving_from(clip.frames, boxed, plate, progress)
    if plate is not None and moving is not None and boxed.any():
        doubts += [one for one in (hardly_moves(clip.frames[0], boxed, plate, moving),) if one is not None]
    unaided = first_outline(settings, clip.frames, plate, moving, lens, progress)
    mask = shown.get(0, unaided)
    progress.update(0.1, "following the object")
    contrast, other = None, None
    if plate is not None and moving is not None:
        behind = plate
        unaided, plate, contrast, other = with_background(clip.frames, unaided, behind, moving, settings, around, progress, journal)
        mask = unaided
        if 0 in shown:
            # What is behind the object, and how it differs from that, is learnt once more where the user has drawn it.
            drawn = replace(settings, box=None)
            mask, plate, contrast, _ = with_background(clip.frames, shown[0], behind, moving, drawn, shown[0], progress, journal)
    outlines = with_corrections(clip.frames, mask, unaided, shown, marks, plate, contrast, other, progress, journal)
    mask = mask if outlines is None else outlines[0]
    pin = _pin(settings.pin, mask, lens)
    depth = object_depth(_depth_map(known_depth, mask, distance, lens, settings), depth_name, mask, distance, progress)
    _tell_huge(mask, depth, camera, progress)
    masks, tracks = follow(clip, mask, outlines, plate, contrast, other, lens, settings, progress, journal)
    bare = beside.submit(clean_plate, clip.frames, masks, median, progress)
    tell_defects(clip.frames, masks, progress)
    doubts += [] if asked is None else asked.result()
    if plate is not None:
        doubts += [one for one in (touching(clip.frames, masks, plate),) if one is not None]
    for one in doubts:
        progress.warn(str(one))
    progress.update(0.95, "background")
    background = bare.result()
    xy, recognised = tracks.xy, tracks.recognised
    if turns is not None:
        steady_xy, masks, recognised = as_filmed(xy, masks, recognised, turns, camera)
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
        doubts=Doubts.of(doubts),
        recognised=recognised,
    )


def _tell_huge(mask: np.ndarray, depth: np.ndarray, camera: Camera, progress: Progress) -> None:
    """Warn of an object so large that its distance is hardly in metres."""
    rows, columns = np.nonzero(mask)
    width = max(np.ptp(rows), np.ptp(columns)) + 1
    far = float(np.median(depth[mask]))
    if width * far / camera.fx > HUGE:
        progress.warn(f"The object is {width * far / camera.fx:.0f} m long, {far:.0f} m away. Are distance and depth in metres?")


def _depth_map(depth: np.ndarray | None, mask: np.ndarray, distance: float, lens: Lens, settings: ObserveSettings) -> np.ndarray | None:
    """The known depth (H, W) over the straightened frame; a network's is scaled to the distance that the user gave."""
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


def _corrections(
    settings: ObserveSettings, clip: Clip, lens: Lens, turns: np.ndarray | None
) -> tuple[dict[int, np.ndarray], dict[int, Marks]]:
    """The outline (H, W) bool that the user gave, and marks that correct one, by the frames of the clip that they are in.

    `turns` (T+1, 3, 3): those taken out of its frames, None where none were.

    Raises:
        UsageError: one that lies outside the clip.
    """
    count, height, width = clip.frames.shape[:3]
    marks = marks_of(settings.correct or (), clip.first_frame, (count, height, width))
    steady = {t: np.eye(3) if turns is None else homography(turns[t], lens.camera) for t in range(count)}
    marks = {
        t: Marks(lens.straight_points(one.on), lens.straight_points(one.beside)).through(steady[t]) for t, one in marks.items()
    }
    if settings.outline is None:
        return {}, marks
    place = settings.outline_frame - clip.first_frame
    if not 0 <= place < count:
        raise UsageError(
            f"--outline-frame: frame {settings.outline_frame} of the file lies outside the clip's frames {clip.first_frame} to "
            f"{clip.first_frame + count - 1}.",
            "Count from 0, as --frames does.",
        )
    outline = lens.straight_map(read_mask(settings.outline, height, width, "outline"))
    if outline.sum() < LEAST_PIXELS:
        raise ObjectError(f"The outline {settings.outline} has {int(outline.sum())} pixels, too few for an object.", "Draw it larger.")
    return {place: through_mask(outline, steady[place])}, marks


def marked(settings: ObserveSettings) -> bool:
    """Whether the object is marked in frame 0."""
    return any(one is not None for one in (settings.mask, settings.box, settings.points, settings.prompt))


def _marked_area(settings: ObserveSettings, height: int, width: int) -> np.ndarray:
    """(H, W) bool: about where a mask, box or points say that the object is; nowhere without them."""
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


def pinned(seen: Observation, pin: str | None) -> Observation:
    """The same observation with what the PNG `pin` holds, in the file's own pixels; nothing without one.

    Raises:
        UsageError: no such frame, or of another size. ObjectError: it does not touch the object.
    """
    return replace(seen, pin=_pin(pin, np.asarray(seen.masks[0]), Lens(seen.camera)))


def _pin(path: str | None, mask: np.ndarray, lens: Lens) -> np.ndarray:
    """(H, W) bool, the held part of the object."""
    if path is None:
        return np.zeros_like(mask)
    pin = lens.straight_map(read_mask(path, mask.shape[0], mask.shape[1], "pin mask")) & mask
    if not pin.any():
        raise ObjectError(
            "The pinned pixels do not touch the object.", "Paint the part that is held, over the object in the first frame."
        )
    return pin
