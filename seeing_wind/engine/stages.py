"""The four stages: observe -> build -> recover -> resimulate. Records in, records out, each kept in the take with its stamp.

A stage whose stamp (inputs and settings) is already in the take is read back instead of run again, so an interrupted recovery resumes
where it stopped and a changed setting redoes only what depends on it.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from . import systems
from .errors import TakeError, UsageError
from .progress import NoProgress, Progress
from .reading import LARGEST_ARRAYS
from .records import Body, Gaussians, Observation, Outcome, Recovery, TrackTargets
from .settings import BuildSettings, ObserveSettings, RecoverSettings, to_mapping
from .take import Take, from_arrays, stamp_of, to_arrays

if TYPE_CHECKING:
    from .field import ForceField
    from .progress import Journal
    from .records import Material, Particles, PointTargets
    from .recovery.paper.losses import MotionLoss
    from .recovery.solve.known_body import KnownBody

R = TypeVar("R")

VERSION = 13
"""Part of every stamp: raise it when a stage's results change, so that old takes are redone."""

TRAJECTORY = "trajectory.npz"
"""The motion that the field of the take was recovered with."""
SOLVED, FITTED = "solve.npz", "fitted.safetensors"
"""A solve whose field is not there yet, and that field for the moment before both take their places."""

FILES = ("mask", "tracks", "depth", "camera", "pin")
"""Fields of `ObserveSettings` that are paths of files."""

LATE_OFFSET = 0.5
"""Standard deviation [px] of the place of a track that was not there in picture 0, at best."""


def observe_stage(take: Take, clip: str, settings: ObserveSettings, progress: Progress) -> tuple[Observation, str]:
    """Stage *observe* -> `observation.npz`. Returns the observation and its stamp.

    What is held is marked in it, and nothing that is seen depends on the mark: with another pin, only that is done again.
    """
    from .observe import observe, pinned

    stamp, seen = observation_stamp(clip, settings), observation_stamp(clip, dataclasses.replace(settings, pin=None))
    kept = finished(take, "observe", seen, lambda: from_arrays(Observation, take.read_arrays("observation.npz")), progress)
    if kept is None:
        progress.begin("observe", "reading the clip")
        observation = observe(clip, settings, progress)
    else:
        observation = pinned(dataclasses.replace(kept, clip=str(clip)), settings.pin)  # it may have been moved since
        if np.array_equal(observation.pin, kept.pin):
            return observation, stamp
    take.write_arrays("observation.npz", to_arrays(observation))
    take.finish("observe", seen, {"clip": str(clip), **to_mapping(settings)})
    return observation, stamp


def finished(take: Take, stage: str, stamp: str, read: Callable[[], R], progress: Progress) -> R | None:
    """What an earlier run left of `stage`, None if it has to be done: not finished, of other inputs, or its files are damaged."""
    if not take.is_done(stage, stamp):
        return None
    progress.begin(stage, "already done")
    try:
        return read()
    except TakeError as error:
        progress.warn(f"The stage {stage} is done again: {error.message}")
        return None


def observation_stamp(clip: str, settings: ObserveSettings) -> str:
    """Stamp of an observation: settings, and the content of the clip and of the files, wherever they are: a project can be moved."""
    from .observe.clip.frames import files_of

    names = [getattr(settings, field) for field in FILES]
    contents = [(field, Path(name)) for field, name in zip(FILES, names, strict=True) if name]
    for field, file in contents:
        if file.is_file() and file.stat().st_size > LARGEST_ARRAYS:
            raise UsageError(f"The file {file} of --{field} is too large: {file.stat().st_size / 1e9:.3g} GB.", "Give that of this clip.")
    words = dataclasses.replace(settings, mask=None, tracks=None, depth=None, camera=None, pin=None)
    return stamp_of("observe", VERSION, words, *files_of(clip, settings.frames), *(part for pair in contents for part in pair))


def build_stage(take: Take, observation: Observation, upstream: str, settings: BuildSettings, progress: Progress) -> tuple[Body, str]:
    """Stage *build* -> `particles.npz` and `gaussians.ply`. Returns the body and its stamp."""
    from .look import write_ply

    stamp = stamp_of("build", VERSION, upstream, settings)
    kept = finished(take, "build", stamp, lambda: read_body(take), progress)
    if kept is not None and take.file("gaussians.ply").is_file():
        return kept, stamp
    progress.begin("build", "building the body")
    body = build_body(observation, settings, progress)
    write_gaussians(take, body.gaussians, write_ply)
    take.write_arrays("particles.npz", to_arrays(body))
    take.finish("build", stamp, to_mapping(settings))
    return body, stamp


def build_body(observation: Observation, settings: BuildSettings | None = None, progress: Progress | None = None) -> Body:
    """The object as physics moves it and as it looks, without a take.

    Raises:
        MaterialError, ObjectError, Cancelled: as `observe.object.build`.
    """
    from .look import dress
    from .observe.object import build

    progress = progress or NoProgress()
    return dress(build(observation, settings, progress.part(0.0, 0.2)), observation, progress.part(0.2, 1.0))


def write_gaussians(take: Take, gaussians: Gaussians, write_ply) -> None:
    """`gaussians.ply` in the standard layout of 3D Gaussian splatting."""
    with take.writing("gaussians.ply") as path:
        write_ply(path, gaussians)


def recover_stage(
    take: Take,
    particles: Particles,
    material: Material,
    targets: PointTargets | list[TrackTargets],
    fps: float,
    upstream: str,
    settings: RecoverSettings,
    progress: Progress,
    loss: Callable[[], Callable[[float], MotionLoss]] | None = None,
) -> tuple[Recovery, ForceField | None, dict[str, float]]:
    """Stage *recover* -> `trajectory.npz` and `field.safetensors`: solve, distil into the representation, refine it.

    Args:
        loss: for objectives other than tracking; see `picture_loss`.

    Returns:
        the recovery, the field (None if the solve diverged: then nothing is written and the last good field stays), and the seconds
        that solve, distillation and refinement took.
    """
    from .field import load_field
    from .recovery import recover
    from .recovery.journal import TakeJournal
    from .recovery.paper.schedule import recover_by_descent

    known = None
    if settings.body is not None:
        known, upstream = known_body(settings.body), stamp_of(upstream, Path(settings.body, TRAJECTORY))
    told = settings
    settings = dataclasses.replace(settings, body=None)  # a project can be moved: what counts is what the other take holds
    stamp = stamp_of("recover", VERSION, upstream, settings)
    # The solve has a stamp of its own: it is long, and a job cancelled while the field is fitted need not repeat it. Until the field is
    # there, it has a file of its own, too: a trajectory belongs to the field beside it. Engines before that left another solve's there.
    solved = stamp_of("recover", VERSION, upstream, dataclasses.replace(settings, refine=0))
    if take.file(SOLVED).is_file() or take.is_done("solve", solved):
        kept = finished(take, "recover", stamp, lambda: (read_recovery(take), load_field(take.file("field.safetensors"))), progress)
        if kept is not None:
            return *kept, {}
    seconds: dict[str, float] = {}
    recovery = finished(take, "solve", solved, lambda: _read_solve(take), progress)
    if recovery is None:
        progress.begin("recover", "recovering the force")
        started = time.perf_counter()
        with TakeJournal(take, solved, progress) as journal:
            if settings.schedule == "paper":
                made = loss() if loss is not None else None
                recovery = recover_by_descent(particles, material, targets, fps, settings, progress, made, journal)
            else:
                recovery = recover(particles, material, targets, fps, settings, progress, journal, known)
            seconds["recover"] = time.perf_counter() - started
            if recovery.outcome == Outcome.DIVERGED:
                return recovery, None, seconds
            take.withdraw("solve")
            take.write_arrays(SOLVED, to_arrays(recovery) | {"fps": _array(fps)})
            take.finish("solve", solved, to_mapping(told))
    with TakeJournal(take, stamp, progress) as journal:
        field = _fitted(recovery, particles, material, fps, settings, progress, journal, seconds)
        with take.writing(FITTED) as path:
            field.save(path)
        # A full disk stops either of the stamps, before both files are renamed or after: what is there belongs together.
        take.withdraw("recover")
        take.file("wind.safetensors").unlink(missing_ok=True)  # it belongs to the field that goes
        if take.file(SOLVED).is_file():
            systems.replace(take.file(SOLVED), take.file(TRAJECTORY))
        systems.replace(take.file(FITTED), take.file("field.safetensors"))
        take.finish("recover", stamp, to_mapping(told))
    return recovery, field, seconds


def known_body(folder: str) -> KnownBody:
    """The held body as the take in `folder` found it.

    Raises:
        UsageError: no take with a recovery, or one that did not tell the body's stiffness.
        TakeError: a damaged take.
    """
    from .recovery.solve.known_body import KnownBody

    return KnownBody.of(read_recovery(require_take(folder)), folder)


def _fitted(
    recovery: Recovery,
    particles: Particles,
    material: Material,
    fps: float,
    settings: RecoverSettings,
    progress: Progress,
    journal: Journal,
    seconds: dict[str, float],
) -> ForceField:
    """The field that holds the recovered forces, refined if the settings say so; adds the seconds that either took."""
    from .field import distill
    from .recovery.paper.refinement import refine

    progress.begin("distill", "fitting the field")
    started = time.perf_counter()
    field = distill(recovery, particles, fps, settings.representation, settings.seed, progress, journal)
    seconds["distill"] = time.perf_counter() - started
    if settings.refine:
        progress.begin("refine", "refining the field")
        started = time.perf_counter()
        refined = refine(field, recovery, particles, material, settings, progress, journal)
        field, seconds["refine"] = refined.field, time.perf_counter() - started
        if refined.before:
            off = f"{1e3 * refined.after:.3g} mm ({1e3 * refined.before:.3g} mm before)"
            progress.update(1.0, f"the field's own simulation strays {off} from the recovered motion")
    return field


def check_solve(settings: RecoverSettings, clip: bool, views: int = 0) -> None:
    """Refuse a schedule and an objective that do not go together, before any work is done.

    Args:
        clip: there are pictures, not only trajectories; views: further views besides the first.

    Raises:
        UsageError: with the reason.
    """
    if settings.body is not None:
        known_body(settings.body)
    if settings.schedule == "paper" and (settings.still is not None or settings.body is not None):
        raise UsageError("--still and --body belong to the default schedule.", "Leave them out, or leave out --schedule paper.")
    if settings.objective == "tracking":
        return
    if not clip:
        raise UsageError(f"--objective {settings.objective} compares pictures, and trajectories have none.", "Use --objective tracking.")
    if settings.schedule != "paper":
        raise UsageError(
            f"--objective {settings.objective} has no Gauss-Newton form: the default schedule solves for tracks only.",
            f"Add --schedule paper to descend on the {settings.objective} loss.",
        )
    if views:
        raise UsageError(
            f"--objective {settings.objective} cannot use --view: Gaussians and depth show the side that the first camera saw.",
            "Leave the view out, or use --objective tracking.",
        )


def picture_loss(settings: RecoverSettings, observation: Observation, body: Body, progress: Progress) -> Callable[[float], MotionLoss]:
    """The image or flow-and-depth loss of a clip, which is read once more: see `recovery.image_objective`, `flow_depth_objective`."""
    from .observe.clip.frames import read_clip
    from .observe.tracks.dense_flow import dense_flow
    from .recovery.paper.flow_depth_loss import FlowDepthLoss, SceneFlow
    from .recovery.paper.image_loss import ImageLoss, Pictures

    last = observation.first_frame + observation.frames
    frames = read_clip(observation.clip, (observation.first_frame, last), observation.fps, progress).frames
    if settings.objective == "image":
        pictures = Pictures(frames, observation.masks, observation.background, observation.camera, body.gaussians)
        return lambda scale: ImageLoss(pictures)
    flow = [None if one is None else one.at for one in dense_flow(frames, observation.masks, progress)]
    scene = SceneFlow(flow, observation.masks, observation.camera, body.gaussians.attachment, body.lifted)
    return lambda scale: FlowDepthLoss(scene, scale)


def track_targets(observation: Observation, body: Body) -> TrackTargets:
    """The observation's tracks as targets of the recovery, those left out that have no place on the body."""
    import numpy as np

    visible = observation.visible & np.isfinite(body.lifted).all(axis=-1)
    offset = None
    if any(body.tie_sigma):
        # Tracks tied through the body's estimated pose share its error, so their number does not average it out.
        sigma = np.array(body.tie_sigma)
        offset = np.sqrt(LATE_OFFSET**2 + np.count_nonzero(sigma) * sigma**2)
    return TrackTargets(observation.xy, visible, observation.sigma, observation.camera, body.keypoints, offset)


def read_body(take: Take) -> Body:
    """The body of a take. Raises TakeError where the take has none (recovered from trajectories)."""
    return from_arrays(Body, take.read_arrays("particles.npz"))


def read_recovery(take: Take) -> Recovery:
    """The recovery of a take."""
    return from_arrays(Recovery, take.read_arrays(TRAJECTORY))


def _read_solve(take: Take) -> Recovery:
    """The last solve: in its own file while it has no field, else that of the field."""
    return from_arrays(Recovery, take.read_arrays(SOLVED if take.file(SOLVED).is_file() else TRAJECTORY))


def require_take(path: str) -> Take:
    """A take that has a recovered field.

    Raises:
        UsageError: when there is none at `path`.
    """
    take = Take(path)
    if not take.file("field.safetensors").is_file():
        raise UsageError(f"{path} holds no recovered field.", "Run `recover` with --take for this folder first.")
    return take


def _array(value: float):
    import numpy as np

    return np.array(value)
