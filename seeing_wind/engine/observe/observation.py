"""The stage *observe*: from a clip to the object's masks, depth and tracks."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import systems
from ..progress import Journal, Progress
from ..records import Camera, Doubts, Observation
from ..settings import ObserveSettings
from .clip.defects import check_frames, warn_of_defects
from .clip.depth import object_depth, typical_depth
from .clip.filmed.beside import touching
from .clip.frames import Clip, read_clip
from .clip.lens import Lens
from .clip.opencv_threads import one_thread
from .clip.shake import as_filmed, turning
from .following import follow
from .given import check_given, refuse_all_held, refuse_none_held
from .mask.background import clean_plate
from .mask.first_mask import read_mask
from .networks import check_networks
from .outline import find_outline
from .steady import Steady, steady_clip
from .tracks.outside import outside
from .working_size import WorkingSize, working_scale

HUGE = 50.0
"""Length [m] beyond which an object is more likely one whose distance was given in millimetres."""


def observe(
    clip: str | Path,
    settings: ObserveSettings,
    progress: Progress,
    journal: Journal = Journal(),
    watch: Callable[[np.ndarray], None] | None = None,
    ready: Callable[[Steady], None] | None = None,
) -> Observation:
    """The observation of `clip` (a video, a folder of images, or a pattern), in the file's own pixels.

    Args:
        journal: keeps what was followed so far, for one clip and its settings without the pin.
        watch: called with each frame as it is read, see `read_clip`.
        ready: called with the clip before the object is looked for; it may raise an error if later stages' options do not fit the clip.

    Raises:
        ClipError, ObjectError, UsageError: see `read_clip`, `first_mask`, `find_camera`, `object_depth` and `read_tracks`.
    """
    told = list[str]()
    with one_thread(), ThreadPoolExecutor(1) as beside:
        seen = _observe(clip, settings, progress.noting(told), journal, beside, watch, ready)
    return replace(seen, told=tuple(dict.fromkeys(told)))


def _observe(
    path: str | Path,
    settings: ObserveSettings,
    progress: Progress,
    journal: Journal,
    beside: Executor,
    watch: Callable[[np.ndarray], None] | None,
    ready: Callable[[Steady], None] | None,
) -> Observation:
    check_networks(settings)
    progress.update(0.0, "reading the clip")

    def resized(height: int, width: int) -> tuple[int, int]:
        return WorkingSize(height, width, working_scale(settings, height, width)).work

    clip = read_clip(path, settings.frames, settings.fps, progress, resized=resized, watch=watch)
    check_frames(clip.frames, clip.first_frame, progress)
    check_given(settings, clip, progress)
    if clip.frames.shape[1:3] == clip.size:
        return _seen(clip, settings, progress, journal, beside, ready)
    size = WorkingSize(*clip.size, working_scale(settings, *clip.size))
    with systems.scratch() as folder:
        seen = _seen(clip, size.settings(settings, clip, folder), progress, journal, beside, ready)
    return pinned(size.observation(seen, clip), settings.pin)


def _seen(
    clip: Clip, settings: ObserveSettings, progress: Progress, journal: Journal, beside: Executor, ready: Callable[[Steady], None] | None
) -> Observation:
    """The observation of a clip at its working size; what nothing else waits for runs in the executor `beside`, on another core."""
    steady = steady_clip(clip, settings, progress, journal, beside)
    if ready is not None:
        ready(steady)
    if settings.pin is not None and (settings.mask is not None or settings.box is not None):
        _held(settings.pin, steady.around, steady.lens)  # raises early, before the object is followed, if all of it is held
    outline = find_outline(steady, progress, journal)
    clip, lens = steady.clip, steady.lens
    pin = _pin(settings.pin, outline.mask, lens)
    depth = object_depth(_depth_map(steady, outline.mask), steady.depth_name, outline.mask, steady.distance, progress)
    _tell_huge(outline.mask, depth, lens.camera, progress)
    masks, tracks = follow(clip, outline, lens, progress, journal)
    median = None if steady.plate is None else steady.plate.color
    bare = beside.submit(clean_plate, clip.frames, masks, median, progress)
    warn_of_defects(clip.frames, masks, progress)
    doubts = [*steady.doubts, *outline.doubts, *(steady.asked.result() if steady.asked is not None else ())]
    if outline.known.still is not None:
        doubts += [one for one in (touching(clip.frames, masks, outline.known.still),) if one is not None]
    xy, recognised, camera = tracks.xy, tracks.recognised, lens.camera
    if steady.turns is not None:
        steady_xy, masks, recognised = as_filmed(xy, masks, recognised, steady.turns, camera)
        # Tracks from a file are in the filmed pixels already.
        xy = steady_xy if settings.tracks is None else xy
        camera = turning(camera, steady.turns)
    visible = tracks.visible
    if tracks.corners is not None:
        name = Path(settings.tracks or settings.track_model or "").name
        compared = outside(xy, visible, tracks.sigma, masks, tracks.corners)
        visible = compared.visible(visible)
        doubt, note = compared.doubt(name, len(masks)), compared.note(name, len(masks))
        if doubt is not None:
            doubts.append(doubt)
        elif note:
            progress.warn(note)
    for one in doubts:
        progress.warn(str(one), judged=True)
    progress.update(0.95, "background")
    background = bare.result()
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
        visible=visible,
        sigma=tracks.sigma,
        on_centroid=tracks.on_centroid,
        doubts=Doubts.of(doubts),
        recognised=recognised,
    )


def _tell_huge(mask: np.ndarray, depth: np.ndarray, camera: Camera, progress: Progress) -> None:
    """Warn of an object so large that its distance is probably not in metres."""
    rows, columns = np.nonzero(mask)
    width = max(np.ptp(rows), np.ptp(columns)) + 1
    far = float(np.median(depth[mask]))
    if width * far / camera.fx > HUGE:
        progress.warn(f"The object is {width * far / camera.fx:.0f} m long, {far:.0f} m away. Are distance and depth in metres?")


def _depth_map(steady: Steady, mask: np.ndarray) -> np.ndarray | None:
    """The known depth (H, W) over the straightened frame; a network's is scaled to the distance that the user gave."""
    if steady.depth is None:
        return None
    straight, settings = steady.lens.straight_map(steady.depth, np.inf), steady.settings
    typical = typical_depth(straight, mask)
    if settings.depth is None and (settings.distance or settings.pixels_per_metre) and typical:
        straight = straight * np.float32(steady.distance / typical)
    return straight


def pinned(seen: Observation, pin: str | None) -> Observation:
    """The observation with the pinned region from the PNG file `pin`, in the file's own pixels; an empty one if `pin` is None.

    Raises:
        UsageError: no such image, or of another size. ObjectError: it does not touch the object, or covers it.
    """
    return replace(seen, pin=_pin(pin, np.asarray(seen.masks[0]), Lens(seen.camera)))


def _pin(path: str | None, mask: np.ndarray, lens: Lens) -> np.ndarray:
    """The held part (H, W) bool of the object, from the PNG file at `path`; empty if that is None."""
    if path is None:
        return np.zeros_like(mask)
    pin = _held(path, mask, lens)
    refuse_none_held(pin)
    return pin


def _held(path: str, area: np.ndarray, lens: Lens) -> np.ndarray:
    """The pixels of `area` (H, W) bool, which contains the object, that the PNG file `path` holds. Raises ObjectError if that is all."""
    held = lens.straight_map(read_mask(path, area.shape[0], area.shape[1], "pin mask")) & area
    refuse_all_held(held, area, path)
    return held
