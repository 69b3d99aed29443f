"""Reading a clip: a video file, a folder of pictures, or a pattern of pictures, as RGB arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ...errors import ClipError, UsageError
from ...progress import NoProgress, Progress
from ...sequences import PICTURE_SUFFIXES, is_sequence, pictures_of
from .pictures import read_picture

UNEVEN = 0.1
"""Deviation of a time between pictures from the usual one, relative, from which a clip counts as one of variable frame rate."""

ROUNDING = 0.02
"""Relative difference between a file's frame rate and that of its times that is rounding: some containers keep whole milliseconds."""

TURNS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
"""What makes a picture upright that a phone stored with this rotation in the file's metadata [degrees]."""

LARGEST_CLIP = 6e9
"""Bytes of decoded pictures held at once; beyond it the user is asked for a shorter range instead of the machine swapping."""


@dataclass(frozen=True)
class Clip:
    """The chosen pictures of a clip, upright."""

    path: str
    frames: np.ndarray
    """(T+1, H, W, 3) uint8 RGB."""
    fps: float
    first_frame: int
    """Index in the file of picture 0."""


def read_clip(path: str | Path, frames: tuple[int, int] | None = None, fps: float | None = None, progress: Progress | None = None) -> Clip:
    """Decode pictures A..B (inclusive, indices in the file; None takes all) of `path`.

    Args:
        path: a video that OpenCV opens, a folder of pictures (sorted by the numbers in their names), or a pattern such as
            `shot_%04d.png` or `shot_*.png`.
        frames: first and last picture.
        fps: frames per second; None takes the file's, or the mean over the chosen pictures where the file's rate varies.

    Raises:
        ClipError: nothing there, not a video, an empty range, or fewer than two pictures.
        UsageError: a frame rate that is not positive, or none for a sequence of pictures, which carries none.
    """
    progress = progress or NoProgress()
    if fps is not None and not (np.isfinite(fps) and fps > 0):
        raise UsageError(f"The frame rate {fps:g} is not positive.", "Give the clip's frames per second, for example --fps 30.")
    first, last = _range(frames)
    source, file_fps = _open(str(path))
    kept: list[np.ndarray] = []
    times: list[float] = []
    count, size = 0, 0
    for index, (picture, time) in enumerate(source):
        progress.check()
        count = index + 1
        if last is not None and index > last:
            break
        if index < first:
            continue
        if kept and picture.shape != kept[0].shape:
            raise ClipError(
                f"Picture {index} of {path} is {_size(picture)}, the first one {_size(kept[0])}.", "All pictures must have the same size."
            )
        kept.append(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
        times.append(time)
        size += picture.nbytes
        if size > LARGEST_CLIP:
            raise ClipError(
                f"{path} is too large: {len(kept)} pictures already take {size / 1e9:.0f} GB.",
                f"Choose a shorter range such as --frames {first}:{first + len(kept) // 2}, or scale the clip down.",
            )
    _check_count(str(path), kept, count, first, last)
    return Clip(str(path), np.stack(kept), _rate(str(path), fps, file_fps, np.array(times), progress), first)


def files_of(path: str, frames: tuple[int, int] | None = None) -> list[Path]:
    """The files that a clip is read from: the video itself, or those of a folder's or pattern's pictures that lie in the range."""
    if not is_sequence(path):
        return [Path(path)]
    first, last = frames or (0, None)
    return pictures_of(path)[max(first, 0) : None if last is None else last + 1]


def _range(frames: tuple[int, int] | None) -> tuple[int, int | None]:
    if frames is None:
        return 0, None
    first, last = int(frames[0]), int(frames[1])
    if first < 0 or last < first:
        raise ClipError(
            f"The frame range {first}:{last} is empty.", "Give the first and the last frame, counted from 0, for example --frames 0:40."
        )
    return first, last


def _check_count(path: str, kept: list[np.ndarray], count: int, first: int, last: int | None) -> None:
    if count == 0:
        raise ClipError(
            f"{path} holds no picture that can be read.", "Play it in a video player; if it plays there, convert it to H.264 MP4."
        )
    if not kept or (last is not None and len(kept) < last - first + 1):
        raise ClipError(
            f"{path} has frames 0 to {count - 1}, so {first}:{last} reaches past its end.", f"Choose --frames inside 0:{count - 1}."
        )
    if len(kept) < 2:
        raise ClipError(f"{path} gives one picture, and motion needs two.", "Use a longer clip or a wider --frames range.")


def _rate(path: str, fps: float | None, file_fps: float, times: np.ndarray, progress: Progress) -> float:
    """Frames per second: the user's, else the file's, else (where the pictures' `times` (T+1,) [s] are uneven) their mean."""
    if fps is not None:
        return float(fps)
    steps = np.diff(times)
    if np.isfinite(steps).all() and (steps > 0).all():
        usual = float(np.median(steps))
        mean = len(steps) / float(times[-1] - times[0])
        if np.abs(steps - usual).max() <= UNEVEN * usual:
            # A file's own number is exact, but that of the whole file: an even part of an uneven clip has another.
            file_fps = file_fps if np.isfinite(file_fps) and abs(mean / max(file_fps, 1e-9) - 1.0) < ROUNDING else mean
        else:
            progress.warn(
                f"The clip's frame rate varies: {1e3 * steps.min():.0f} to {1e3 * steps.max():.0f} ms between pictures. Its mean, "
                f"{mean:.4g} per second, is used, and forces are wrong where pictures are far apart. Convert it to a constant rate."
            )
            return mean
    if not (np.isfinite(file_fps) and 0.0 < file_fps < 1e5):
        raise UsageError(f"{path} does not say its frame rate.", "Give it with --fps: forces scale with its square.")
    return float(file_fps)


def _size(picture: np.ndarray) -> str:
    return f"{picture.shape[1]}x{picture.shape[0]}"


def _open(path: str) -> tuple[Iterator[tuple[np.ndarray, float]], float]:
    """Pictures (BGR) of a clip with their times [s], and the frame rate its file states (both NaN for pictures)."""
    place = Path(path)
    if not path.strip():
        raise ClipError("No clip is named.", "Give a video file, a folder of pictures, or a pattern like shot_%04d.png.")
    if is_sequence(path):
        return _pictures(pictures_of(path), path), float("nan")
    if not place.is_file():
        raise ClipError(
            f"There is no clip at {path}.", "Check the path: a video file, a folder of pictures, or a pattern like shot_%04d.png."
        )
    if place.suffix.lower() in PICTURE_SUFFIXES:
        return _pictures([place], path), float("nan")
    capture = cv2.VideoCapture(path)
    if not capture.isOpened():
        raise ClipError(f"{path} is not a video that can be opened.", "Convert it to H.264 MP4, or give a folder of pictures.")
    return _video(capture), float(capture.get(cv2.CAP_PROP_FPS))


def _video(capture: cv2.VideoCapture) -> Iterator[tuple[np.ndarray, float]]:
    # Builds of OpenCV differ in whether they turn pictures by themselves.
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    turn = TURNS.get(round(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 360)
    try:
        while True:
            read, picture = capture.read()
            if not read:
                return
            time = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
            yield (picture if turn is None else cv2.rotate(picture, turn)), time
    finally:
        capture.release()


def _pictures(files: list[Path], path: str) -> Iterator[tuple[np.ndarray, float]]:
    if not files:
        raise ClipError(f"No pictures at {path}.", "Give a folder or pattern of PNG, JPEG, TIFF, BMP or WebP files.")
    for file in files:
        picture = read_picture(file, cv2.IMREAD_COLOR)
        if picture is None:
            raise ClipError(f"The picture {file} cannot be read.", "Remove or replace that file.")
        yield picture, float("nan")
