"""The first stages, observe -> build, and the steps from these to *recover*. Records in, records out, each kept in the take with its stamp.

A stage whose stamp (inputs and settings) is already in the take is read instead of run again, so an interrupted recovery resumes where it
stopped, and after a change of settings only what depends on them is done again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .errors import TakeError, UsageError
from .progress import Journal, NoProgress, Progress
from .reading import LARGEST_ARRAYS
from .record_arrays import from_arrays, read_body, to_arrays
from .records import Body, Gaussians, Observation, TrackTargets
from .settings import BuildSettings, ObserveSettings, RecoverSettings, to_mapping
from .take import VERSION, Take, stamp_of

if TYPE_CHECKING:
    from .observe.steady import Steady
    from .recovery.paper.losses import MotionLoss

FILES = ("mask", "outline", "tracks", "depth", "camera", "pin", "outline_model")
"""Fields of `ObserveSettings` that are paths of files."""

LIFTED = "lifted.npz"
"""File with the key points of the first view, (T+1, K, 3) [m], lifted with all views."""


def observe_stage(
    take: Take,
    clip: str,
    settings: ObserveSettings,
    progress: Progress,
    view: int = 0,
    watch: Callable[[np.ndarray], None] | None = None,
    ready: Callable[[Steady], None] | None = None,
) -> tuple[Observation, str]:
    """Stage *observe* -> `observation.npz`. Returns the observation and its stamp.

    The held places are marked in the observation, but nothing else in it depends on them: with another `pin`, only they are done again.

    Args:
        view: number, from 1, of a further view of the same object, which has its own stage; 0 for the take's own clip.
        watch: called with the clip's frames, see `observe.clip.frames.read_clip`, if they have to be read.
        ready: called with the clip before the object is looked for, see `observe.observe`, if that has to be done.
    """
    from .observe import observe, pinned
    from .recovery.journal import TakeJournal

    if Path(clip).resolve() == take.path.resolve():
        raise UsageError(f"{clip} is the clip's folder and the take's.", "Give --take a folder of its own: a report is an image, too.")
    stage, file = (f"view{view}", f"view{view}.npz") if view else ("observe", "observation.npz")
    stamp, seen = observation_stamp(clip, settings), observation_stamp(clip, dataclasses.replace(settings, pin=None))
    kept = take.kept(stage, seen, lambda: from_arrays(Observation, take.read_arrays(file)), progress, "observe")

    def finished(observation: Observation) -> Observation:
        take.write_arrays(file, to_arrays(observation))
        take.finish(stage, seen, {"clip": str(clip), **to_mapping(settings)})
        return observation

    if kept is None:
        progress.begin("observe", f"further view {Path(clip).name}" if view else "reading the clip")
        with TakeJournal(take, seen, progress) as journal:
            return finished(observe(clip, settings, progress, journal, watch, ready)), stamp
    observation = pinned(dataclasses.replace(kept, clip=str(clip)), settings.pin)  # the clip may have been moved since
    return observation if np.array_equal(observation.pin, kept.pin) else finished(observation), stamp


def observation_stamp(clip: str, settings: ObserveSettings) -> str:
    """Stamp of an observation: settings, and contents of the clip and of the files, but not their paths, so that a project can be moved."""
    from .observe.clip.frames import files_of

    names = [getattr(settings, field) for field in FILES]
    contents = [(field, Path(name)) for field, name in zip(FILES, names, strict=True) if name]
    for field, file in contents:
        if file.is_file() and file.stat().st_size > LARGEST_ARRAYS:
            raise UsageError(f"The file {file} of --{field} is too large: {file.stat().st_size / 1e9:.3g} GB.", "Give that of this clip.")
    words = dataclasses.replace(settings, mask=None, outline=None, tracks=None, depth=None, camera=None, pin=None, outline_model=None)
    return stamp_of("observe", VERSION, words, *files_of(clip, settings.frames), *(part for pair in contents for part in pair))


def build_stage(take: Take, observation: Observation, upstream: str, settings: BuildSettings, progress: Progress) -> tuple[Body, str]:
    """Stage *build* -> `particles.npz` and `gaussians.ply`. Returns the body and its stamp."""
    from .recovery.journal import TakeJournal

    stamp = stamp_of("build", VERSION, upstream, settings)

    def read() -> Body:
        body = read_body(take)
        # Each may be None in a take of an earlier version, whose field can still be sampled, but not with this version's stamp.
        if body.sheet is not None and any(one is None for one in (body.path, body.path_sigma, body.measured)):
            raise TakeError(f"{take.file('particles.npz')} lacks the observed motion of the sheet.", "It is made again.")
        return body

    kept = take.kept("build", stamp, read, progress)
    if kept is not None and take.file("gaussians.ply").is_file():
        return kept, stamp
    progress.begin("build", "building the body")
    with TakeJournal(take, stamp, progress) as journal:
        body = build_body(observation, settings, progress, journal)
        write_gaussians(take, body.gaussians)
        take.write_arrays("particles.npz", to_arrays(body))
        take.finish("build", stamp, to_mapping(settings))
    return body, stamp


def lift_stage(
    take: Take, observation: Observation, body: Body, targets: Sequence[TrackTargets], upstream: str, progress: Progress
) -> Body:
    """Stage *lift*, for several views -> `lifted.npz`: the body with its key points, or a sheet's path, found with all views.

    Args:
        upstream: stamp of the body and of all views.
    """
    from .observe.object.motion.views import lifted_together
    from .observe.object.sheet import follow_views
    from .recovery.journal import TakeJournal

    changed = ("lifted",) if body.path is None else ("lifted", "path", "path_sigma", "measured")

    def changed_of(body: Body) -> dict[str, np.ndarray]:
        return {name: array for name, array in to_arrays(body).items() if name.split(".")[0] in changed}

    def read() -> Body:
        arrays = take.read_arrays(LIFTED)
        before = changed_of(body)
        if any(name not in arrays or arrays[name].shape != array.shape for name, array in before.items()):
            raise TakeError(f"{take.file(LIFTED)} does not fit the body.", "It is made again.")
        return from_arrays(Body, to_arrays(body) | {name: arrays[name] for name in before})

    stamp = stamp_of("lift", VERSION, upstream)
    kept = take.kept("lift", stamp, read, progress, "build")
    if kept is not None:
        return kept
    progress.begin("build", "lifting the views together")
    with TakeJournal(take, stamp, progress) as journal:
        together = (lifted_together if body.path is None else follow_views)(observation, body, targets, progress, journal)
        take.write_arrays(LIFTED, changed_of(together))
        take.finish("lift", stamp, {})
    return together


def build_body(
    observation: Observation, settings: BuildSettings = BuildSettings(), progress: Progress = NoProgress(), journal: Journal = Journal()
) -> Body:
    """The body, with its look, without a take.

    Raises:
        MaterialError, ObjectError, Cancelled: as `observe.object.build`.
    """
    from .look import dress
    from .observe.object import build

    return dress(build(observation, settings, progress.part(0.0, 0.2), journal), observation, progress.part(0.2, 1.0))


def write_gaussians(take: Take, gaussians: Gaussians) -> None:
    """Write `gaussians.ply` in the standard layout of 3D Gaussian splatting."""
    from .look import write_ply

    with take.writing("gaussians.ply") as path:
        write_ply(path, gaussians)


def check_solve(settings: RecoverSettings, clip: bool, views: int = 0) -> None:
    """Refuse settings of the solve that do not go together, before any work is done.

    Args:
        clip: whether there are frames, not only trajectories; views: number of views besides the first.

    Raises:
        UsageError: with the reason.
    """
    if settings.body is not None:
        from .recovery.stage import known_body

        if not Path(settings.body).is_dir():
            raise UsageError(f"--body names {settings.body}, which is not a folder.", "Give the take of another clip of the same thing.")
        known_body(settings.body)
    if settings.schedule == "paper" and (settings.still is not None or settings.body is not None):
        raise UsageError("--still and --body belong to the default schedule.", "Leave them out, or leave out --schedule paper.")
    if settings.schedule == "paper" and settings.iterations != RecoverSettings().iterations:
        hint = "Leave it out and give --frame-iterations, or leave out --schedule paper."
        raise UsageError(f"--iterations {settings.iterations} belongs to the default schedule.", hint)
    if settings.schedule != "paper" and settings.frame_iterations != RecoverSettings().frame_iterations:
        raise UsageError("--frame-iterations belongs to --schedule paper.", "Leave it out, or add --schedule paper.")
    if settings.objective == "tracking":
        return
    if not clip:
        raise UsageError(f"--objective {settings.objective} compares frames, and trajectories have none.", "Use --objective tracking.")
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


def check_sheet(settings: RecoverSettings) -> None:
    """Refuse settings that only the solve of a solid has.

    Raises:
        UsageError: with the reason.
    """
    given = [flag for flag, used in (
        ("--schedule paper", settings.schedule != "default"), (f"--objective {settings.objective}", settings.objective != "tracking"),
        ("--refine", settings.refine), ("--still", settings.still is not None), ("--body", settings.body is not None),
    ) if used]  # fmt: skip
    if given:
        raise UsageError(f"{' and '.join(given)} cannot be used for a thin sheet.", "Leave it out, or recover a solid with --form solid.")


def frame_loss(settings: RecoverSettings, observation: Observation, body: Body, progress: Progress) -> Callable[[float], MotionLoss]:
    """The image or flow-and-depth loss of a clip, which is read again: see `recovery.paper.image_loss` and `flow_depth_loss`."""
    from .observe.clip.frames import read_clip
    from .observe.tracks.dense_flow import dense_flow
    from .recovery.paper.flow_depth_loss import FlowDepthLoss, SceneFlow
    from .recovery.paper.image_loss import Filmed, ImageLoss

    last = observation.first_frame + observation.frames
    frames = read_clip(observation.clip, (observation.first_frame, last), observation.fps, progress).frames
    if settings.objective == "image":
        filmed = Filmed(frames, observation.masks, observation.background, observation.camera, body.gaussians)
        return lambda scale: ImageLoss(filmed)
    flow = [None if one is None else one.at for one in dense_flow(frames, observation.masks, progress)]
    scene = SceneFlow(flow, observation.masks, observation.camera, body.gaussians.attachment, body.lifted)
    return lambda scale: FlowDepthLoss(scene, scale)


def track_targets(observation: Observation, body: Body) -> TrackTargets:
    """The observation's tracks as targets of the recovery, without those that have no place on the body."""
    from .recovery.targets.constants import NOISE

    visible = observation.visible & np.isfinite(body.lifted).all(axis=-1)
    offset = None
    if any(body.tie_sigma):
        # Tracks tied through the body's estimated pose share its error, so their number does not average it out.
        sigma = np.array(body.tie_sigma)
        offset = np.sqrt(NOISE.late_offset**2 + np.count_nonzero(sigma) * sigma**2)
    return TrackTargets(observation.xy, visible, observation.sigma, observation.camera, body.keypoints, offset)
