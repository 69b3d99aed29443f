"""The verb *observe*: draws and judges what is seen in a clip, before the solve. `recover` with the same options continues from there."""

from __future__ import annotations

import argparse
import contextlib
import time
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from ..conventions import BODY, TIME
from ..errors import MaterialError, ObjectError
from ..progress import Progress, in_words
from ..records import Observation
from ..settings import BuildSettings, RecoverSettings
from ..stages import observe_stage
from ..take import Take
from .arguments import observe_settings, settings_of
from .inputs import inputs_of, refuse_of_another
from .lock import held
from .reporting import counting_in_file

if TYPE_CHECKING:
    from ..observe.clip.frames import Copies
    from ..observe.clip.stored import Frames
    from ..observe.preview.verdicts import Verdict

IMAGE, FILM, HELD = "preview.png", "preview.mp4", "held.png"

FILM_SIDE = 640
"""Largest length [px] of the film's longer side: it suffices to see what is followed, and most of the time goes into writing the film."""

DOUBTFUL = 0.6
"""Severity of a note on the body that would be built."""


def observe(arguments: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """`observe CLIP --take DIR` -> preview.png, preview.mp4 and preview.json; held.png where the object seems to be held."""
    from ..observe.clip.frames import require_clip
    from ..observe.preview.held import propose_held
    from ..observe.preview.verdicts import judge

    require_clip(arguments.clip)
    settings = observe_settings(arguments)
    started = time.perf_counter()
    refuse_of_another(Take(arguments.take), arguments.clip)
    with (
        counting_in_file(arguments, progress) as told,
        held(Take(arguments.take), arguments.verb, progress, inputs_of(arguments)) as take,
        ThreadPoolExecutor(1) as beside,
        ThreadPoolExecutor(1) as reading,
    ):
        # Importing the code that builds bodies takes most of a second, about as long as reading the clip.
        beside.submit(import_module, "..observe.object.body", __package__)
        film = _Film()
        seen, _ = observe_stage(take, arguments.clip, settings, told, watch=film.add)
        duration = beside.submit(_time, seen, arguments)
        frames = reading.submit(film.frames, seen, told)
        proposed = None if seen.pin.any() else propose_held(seen)
        told.begin("preview", "drawing")
        _draw_film(take, seen, proposed, frames, told)
        verdicts = [one.as_in_file(seen.first_frame) for one in judge(seen, settings, proposed, duration.result())]
        _draw_first(take, seen, proposed, verdicts)
        for one in verdicts:
            if one.severity > 0.0:
                told.warn(f"{one.item}: doubtful because {one.because[0].lower()}{one.because[1:]} {one.do}".strip())
        files = [IMAGE, FILM, *([HELD] if proposed is not None else [])]
        found = {"verdicts": [one.as_json() for one in verdicts], "files": files}
        take.write_json("preview.json", found)
    progress.update(1.0, "done")
    return {"outcome": "converged", "take": str(take.path), **found, "seconds": time.perf_counter() - started}


def _time(seen: Observation, arguments: argparse.Namespace) -> list[Verdict]:
    """Verdicts on the body that would be built, and on how long the solve would take on this machine, if that is known."""
    from ..observe.object.body import rest_body
    from ..observe.preview.verdicts import Verdict
    from ..recovery.cost import known_speed, work_of

    try:
        body = rest_body(seen, settings_of(BuildSettings, arguments))
    except (MaterialError, ObjectError) as error:
        return [Verdict(BODY, 1.0, f"It cannot be built. {error.message}", error.hint)]
    if body is None:
        return []
    solving = settings_of(RecoverSettings, arguments)
    said = [Verdict(BODY, DOUBTFUL, note) for note in (*body.told, *([body.top_heavy] if any(solving.gravity) and body.top_heavy else []))]
    work = work_of(body.particles, body.material, seen.fps, seen.frames, seen.xy.shape[1], solving)
    speed = known_speed(work.plastic) if work is not None else None
    if work is None or speed is None:
        return said
    return [*said, Verdict(TIME, 0.0, f"The solve takes about {in_words(work.seconds(speed))} on this machine.")]


class _Film:
    """The clip's frames at the film's size, kept while the clip is read for the observation."""

    def __init__(self) -> None:
        self._copies: Copies | None = None

    def add(self, frame: np.ndarray) -> None:
        """The next `frame` (H, W, 3) uint8 RGB at the file's own size."""
        from ..observe.clip.frames import Copies

        if self._copies is None:
            self._copies = Copies((frame.shape[0], frame.shape[1]), _film_size, ())
        self._copies.add(frame)

    def frames(self, seen: Observation, progress: Progress) -> Frames:
        """The frames (T+1, h, w, 3) uint8 RGB; the clip is read again if the take already had the observation."""
        from ..observe.clip.frames import read_clip

        if self._copies is not None:
            return self._copies.frames
        last = seen.first_frame + seen.frames
        return read_clip(seen.clip, (seen.first_frame, last), seen.fps, progress, resized=_film_size, keep=()).frames


def _film_size(height: int, width: int) -> tuple[int, int]:
    """Height and width [px] of the film of a clip."""
    scale = min(1.0, FILM_SIDE / max(height, width))
    # Codecs need even sides.
    return 2 * max(round(0.5 * scale * height - 0.25), 1), 2 * max(round(0.5 * scale * width - 0.25), 1)


def _draw_first(take: Take, seen: Observation, proposed: np.ndarray | None, verdicts: list[Verdict]) -> None:
    """Draw the image of frame 0 with the verdicts, and the mask of the place proposed as held."""
    import cv2

    from ..observe.clip.images import write_png
    from ..observe.preview.drawing import Canvas, with_verdicts

    with take.writing(IMAGE) as path:
        first = with_verdicts(Canvas(seen, proposed, (seen.camera.height, seen.camera.width)).draw_seen(seen.image, 0), verdicts)
        write_png(path, cv2.cvtColor(first, cv2.COLOR_RGB2BGR))
    if proposed is not None:
        with take.writing(HELD) as path:
            write_png(path, proposed.astype(np.uint8) * 255)


def _draw_film(take: Take, seen: Observation, proposed: np.ndarray | None, reading: Future[Frames], progress: Progress) -> None:
    """Draw the film of what is followed, with the place proposed as held."""
    import cv2

    from ..observe.clip.camera import resized
    from ..observe.clip.lens import Lens
    from ..observe.clip.video import video_writer
    from ..observe.preview.drawing import Canvas

    frames = reading.result()
    _, height, width, _ = frames.shape
    film, lens = Canvas(seen, proposed, (height, width)), Lens(resized(seen.camera, height, width))
    with contextlib.ExitStack() as together:
        path = together.enter_context(take.writing(FILM))
        writer = together.enter_context(video_writer(path, seen.fps, (width, height)))
        # The pool is left before the writer is closed, so nothing is being written then; a frame is drawn while the last is encoded.
        encoder, before = together.enter_context(ThreadPoolExecutor(1)), None
        for t in range(len(frames)):
            progress.update(t / len(frames), f"drawing, frame {t} of {len(frames) - 1}")
            drawn = cv2.cvtColor(film.draw_seen(lens.straight_one(frames[t]), t), cv2.COLOR_RGB2BGR)
            if before is not None:
                before.result()
            before = encoder.submit(writer.write, drawn)
        if before is not None:
            before.result()
