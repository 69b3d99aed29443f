"""Reading a clip: a video file, a folder of images, or a pattern of images, as RGB frames on disk. A clip is decoded once."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ...conventions import FRAME_RATES, IMAGE_SUFFIXES, image_files, is_sequence
from ...errors import ClipError, UsageError
from ...progress import NoProgress, Progress
from ...records import Doubt
from .filmed.combing import Combing
from .filmed.container import container_doubts
from .images import check_size, read_image
from .stored import Frames, StoredFrames

UNEVEN = 0.1
"""Relative deviation of a time between frames from the median one from which a clip counts as having a variable frame rate."""

ROUNDING = 0.02
"""Relative difference between a file's frame rate and that of its times up to which it is rounding: some containers keep milliseconds."""

PLAYLIST = b"ffconcat"
"""The first bytes of FFmpeg's list of files, which it plays like a video; OpenCV opens no playlists of other kinds."""

TURNS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
"""The rotation that makes a frame upright, by the rotation in the file's metadata with which a phone stored it [degrees]."""


@dataclass(frozen=True)
class Clip:
    """The chosen frames of a clip, upright."""

    path: str
    frames: Frames
    """(T+1, H, W, 3) uint8 RGB, at the requested size."""
    fps: float
    first_frame: int
    """Index in the file of frame 0."""
    size: tuple[int, int]
    """Height and width in the file [px]."""
    kept: tuple[int, ...]
    """Numbers of the frames that are also kept at the file's own size, see `as_filmed`."""
    own: Frames
    """(K, H, W, 3) uint8 RGB, those frames at the file's own size."""
    doubts: tuple[Doubt, ...] = ()
    """Faults of the filming, as far as the file and its frames reveal them."""

    def as_filmed(self, frame: int) -> np.ndarray:
        """One of the `kept` frames, (H, W, 3) uint8 RGB, at the file's own size."""
        return self.own[self.kept.index(frame)]


def read_clip(
    path: str | Path,
    frames: tuple[int, int] | None = None,
    fps: float | None = None,
    progress: Progress = NoProgress(),
    *,
    resized: Callable[[int, int], tuple[int, int]] | None = None,
    keep: Collection[int] = (0,),
    watch: Callable[[np.ndarray], None] | None = None,
) -> Clip:
    """Decode frames A..B (inclusive, indices in the file; None takes all) of `path`, in one pass and with one frame in memory.

    Args:
        path: a video that OpenCV opens, a folder of images (sorted by the numbers in their names), or a pattern such as
            `shot_%04d.png` or `shot_*.png`.
        frames: first and last frame.
        fps: frames per second; None takes the file's, or the mean over the chosen frames if the file's rate varies.
        resized: returns the height and width [px] to reduce the frames to, given the file's; None leaves them as they are.
        keep: numbers of the frames (0 is frame A) to keep at the file's own size, too.
        watch: called with each frame (H, W, 3) uint8 RGB, upright, at the file's own size.

    Raises:
        ClipError: nothing there, not a video, an empty range, or fewer than two frames.
        UsageError: a frame rate that no camera has, or none given although the clip states none, as for a sequence of images.
        SeeingWindError: no room on disk for the decoded frames.
    """
    if fps is not None and not FRAME_RATES[0] <= fps <= FRAME_RATES[1]:
        raise UsageError(f"No camera has the frame rate {fps:g}.", "Give the clip's frames per second, for example --fps 30.")
    first, last = _range(frames)
    source, file_fps = _open(str(path))
    if is_sequence(str(path)):
        _tell_gaps(files_of(str(path), frames), progress)
    copies: Copies | None = None
    combing = Combing()
    times: list[float] = []
    count = 0
    for index, (frame, time) in enumerate(source):
        progress.check()
        count = index + 1
        if last is not None and index > last:
            break
        if index < first:
            continue
        if copies is None:
            copies = Copies((frame.shape[0], frame.shape[1]), resized, keep)
        elif frame.shape[:2] != copies.file:
            what = f"Frame {index} of {path} is {_size(frame.shape)}, the first one {_size(copies.file)}."
            raise ClipError(what, "All frames must have the same size.")
        upright = cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)
        copies.add(upright)
        if watch is not None:
            watch(upright)
        combing.add(upright)
        times.append(time)
    _check_count(str(path), len(times), count, first, last)
    assert copies is not None  # at least two frames, as has been checked
    rate, uneven = _rate(str(path), fps, file_fps, np.array(times))
    doubts = [uneven, combing.doubt(), *([] if is_sequence(str(path)) else container_doubts(path, rate, told=fps is not None))]
    told = tuple(one for one in doubts if one is not None)
    return Clip(str(path), copies.frames, rate, first, copies.file, copies.kept, copies.own, told)


class Copies:
    """Stores the decoded frames: all at the requested size, some at the file's own size, too."""

    def __init__(self, file: tuple[int, int], resized: Callable[[int, int], tuple[int, int]] | None, keep: Collection[int]) -> None:
        self.file = file
        self._size = file if resized is None else resized(*file)
        self._keep = frozenset(keep)
        self.frames = StoredFrames(*self._size)
        # At the file's own size all frames are there anyway.
        self.own = self.frames if self._size == file else StoredFrames(*file)
        self.kept: tuple[int, ...] = ()

    def add(self, frame: np.ndarray) -> None:
        """Store the next frame (H, W, 3) uint8 RGB."""
        index = len(self.frames)
        if self.own is self.frames:
            self.kept += (index,)
        elif index in self._keep:
            self.own.append(frame)
            self.kept += (index,)
        smaller = self._size != self.file
        self.frames.append(cv2.resize(frame, self._size[::-1], interpolation=cv2.INTER_AREA) if smaller else frame)


def require_clip(path: str) -> None:
    """Raise ClipError if there is nothing at `path` that could be a clip; to be called before a folder for its results is made."""
    if not path.strip():
        raise ClipError("No clip is named.", "Give a video file, a folder of images, or a pattern like shot_%04d.png.")
    if not is_sequence(path) and not Path(path).is_file():
        raise ClipError(
            f"There is no clip at {path}.", "Check the path: a video file, a folder of images, or a pattern like shot_%04d.png."
        )


def _refuse_playlist(place: Path) -> None:
    """Raise ClipError for FFmpeg's playlists: the files that they name may change unnoticed, or be missing on another machine."""
    with open(place, "rb") as file:
        if file.read(len(PLAYLIST)) == PLAYLIST:
            raise ClipError(f"{place} is a list of files, not a video.", "Give the video itself, or join the listed ones with FFmpeg.")


def files_of(path: str, frames: tuple[int, int] | None = None) -> list[Path]:
    """The files that a clip is read from: the video itself, or the images of a folder or pattern that lie in the range."""
    if not is_sequence(path):
        return [Path(path)]
    first, last = frames or (0, None)
    return image_files(path)[max(first, 0) : None if last is None else last + 1]


def count_frames(path: str, frames: tuple[int, int] | None = None, progress: Progress = NoProgress()) -> int:
    """The number of a clip's frames that lie in the range, found by decoding, as the numbers that containers state are wrong too often.

    Raises:
        ClipError: there is none.
    """
    first, last = _range(frames)
    if is_sequence(path) or Path(path).suffix.lower() in IMAGE_SUFFIXES:
        count = len(files_of(path, frames))
    else:
        capture, count = cv2.VideoCapture(path), 0
        while (last is None or count <= last) and capture.grab():
            progress.check()
            count += 1
        capture.release()
        count = max(0, count - first)
    if count == 0:
        raise ClipError(f"{path} holds no frame that can be read.", "Convert it to H.264 MP4, or give a folder of images.")
    return count


def _range(frames: tuple[int, int] | None) -> tuple[int, int | None]:
    if frames is None:
        return 0, None
    first, last = int(frames[0]), int(frames[1])
    if first < 0 or last < first:
        raise ClipError(
            f"The frame range {first}:{last} is empty.", "Give the first and the last frame, counted from 0, for example --frames 0:40."
        )
    return first, last


def _tell_gaps(files: list[Path], progress: Progress) -> None:
    """Warn if numbers are missing from the otherwise evenly numbered files, since all frames are taken as equally far apart in time."""
    numbers = [re.findall(r"\d+", file.stem)[-1:] for file in files]
    if len(files) < 3 or not all(numbers):
        return
    steps = np.diff([int(found) for (found,) in numbers])
    usual = int(np.median(steps))
    wide = np.flatnonzero(steps > usual)
    if usual > 0 and len(wide):
        where = " and ".join(f"between {files[at].name} and {files[at + 1].name}" for at in wide[:3])
        progress.warn(f"Frames are missing {where}: the others are taken as equally far apart in time. Put the missing ones back.")


def _check_count(path: str, kept: int, count: int, first: int, last: int | None) -> None:
    if count == 0:
        raise ClipError(
            f"{path} holds no frame that can be read.", "Play it in a video player; if it plays there, convert it to H.264 MP4."
        )
    if not kept or (last is not None and kept < last - first + 1):
        raise ClipError(
            f"{path} has frames 0 to {count - 1}, so {first}:{last} reaches past its end.", f"Choose --frames inside 0:{count - 1}."
        )
    if kept < 2:
        raise ClipError(f"{path} gives one frame, and motion needs two.", "Use a longer clip or a wider --frames range.")


def _rate(path: str, fps: float | None, file_fps: float, times: np.ndarray) -> tuple[float, Doubt | None]:
    """Frames per second: the user's, else the file's, or, if the frames' `times` (T+1,) [s] are uneven, their mean, with a doubt."""
    if fps is not None:
        return float(fps), None
    steps = np.diff(times)
    if np.isfinite(steps).all() and (steps > 0).all():
        usual = float(np.median(steps))
        mean = len(steps) / float(times[-1] - times[0])
        if np.abs(steps - usual).max() > UNEVEN * usual:
            return mean, Doubt(
                0.9,
                f"The clip's frame rate varies: {1e3 * steps.min():.0f} to {1e3 * steps.max():.0f} ms between frames. Its mean, "
                f"{mean:.4g} per second, is used, and forces are wrong where frames are far apart.",
                "Convert it to a constant rate.",
            )
        # The rate that a file states is exact, but it is the whole file's: an even part of an uneven clip has another rate.
        file_fps = file_fps if np.isfinite(file_fps) and abs(mean / max(file_fps, 1e-9) - 1.0) < ROUNDING else mean
    if not (np.isfinite(file_fps) and 0.0 < file_fps < 1e5):
        raise UsageError(f"{path} does not say its frame rate.", "Give it with --fps: forces scale with its square.")
    return float(file_fps), None


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"


def _open(path: str) -> tuple[Iterator[tuple[np.ndarray, float]], float]:
    """The frames (H, W, 3) uint8 BGR of a clip with their times [s], and the frame rate that its file states (both NaN for images)."""
    place = Path(path)
    require_clip(path)
    if is_sequence(path):
        return _images(image_files(path), path), float("nan")
    if place.suffix.lower() in IMAGE_SUFFIXES:
        return _images([place], path), float("nan")
    _refuse_playlist(place)
    capture = cv2.VideoCapture(path)
    if not capture.isOpened():
        raise ClipError(f"{path} is not a video that can be opened.", "Convert it to H.264 MP4, or give a folder of images.")
    try:
        check_size(capture.get(cv2.CAP_PROP_FRAME_WIDTH), capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    except ValueError as error:
        raise ClipError(f"{path} is too large: {error}.", "Scale the clip down.") from error
    return _video(capture), float(capture.get(cv2.CAP_PROP_FPS))


def _video(capture: cv2.VideoCapture) -> Iterator[tuple[np.ndarray, float]]:
    # Builds of OpenCV differ in whether they rotate frames by themselves.
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    turn = TURNS.get(round(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 360)
    try:
        while True:
            read, frame = capture.read()
            if not read:
                return
            time = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
            yield (frame if turn is None else cv2.rotate(frame, turn)), time
    finally:
        capture.release()


def _images(files: list[Path], path: str) -> Iterator[tuple[np.ndarray, float]]:
    if not files:
        raise ClipError(f"No images at {path}.", "Give a folder or pattern of PNG, JPEG, TIFF, BMP or WebP files.")
    for file in files:
        try:
            frame = read_image(file)
        except (OSError, ValueError) as error:
            raise ClipError(f"The image {file} cannot be read: {error}.", "Remove or replace that file.") from error
        yield frame, float("nan")
