"""Stage *recover*: from targets to a motion and a field, both written to the take. A stopped stage resumes where it stopped."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .. import systems
from ..conventions import in_units
from ..materials import LIMITS, Material
from ..mpm.courant import substeps_of
from ..progress import Journal, Progress, in_words
from ..record_arrays import TRAJECTORY, read_recovery, recovery_of, require_take, to_arrays
from ..records import Outcome, Particles, PointTargets, Recovery, TrackTargets
from ..settings import RecoverSettings, to_mapping
from ..take import VERSION, Take, stamp_of
from .clip import Foresee, unforeseen
from .cost import measure_speed, points_in, work_of
from .journal import TakeJournal
from .recover import check_body, recover, refinement
from .solve.known_body import KnownBody

if TYPE_CHECKING:
    from ..field import ForceField
    from .paper.losses import MotionLoss

SOLVED, FITTED = "solve.npz", "fitted.safetensors"
"""Files of a solve whose field is not fitted yet, and of the fitted field just before both files are moved to their places."""


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
) -> tuple[Recovery, ForceField | None, dict[str, float], dict[str, float]]:
    """Stage *recover* -> `trajectory.npz` and `field.safetensors`: solve, distil into the representation, refine it.

    Args:
        upstream: stamp of the stages before this one.
        loss: for objectives other than tracking; see `frame_loss`.

    Returns:
        The recovery; the field (None if the solve diverged: then nothing is written, and the last good field stays); the seconds that
        solve, distillation and refinement took; and the seconds that the solve was expected to take, if that could be estimated. Both
        are keyed by the stage's name.
    """
    from ..field import load_field
    from .paper.schedule import recover_by_descent

    known = None
    if settings.body is not None:
        known, upstream = known_body(settings.body), stamp_of(upstream, Path(settings.body, TRAJECTORY))
    told = settings
    settings = dataclasses.replace(settings, body=None)  # a project can be moved, so the stamp has the other take's contents, not its path
    stamp = stamp_of("recover", VERSION, upstream, settings)
    # The solve has a stamp of its own: it is long, and a job that was cancelled while fitting the field need not repeat it. Until the field
    # is fitted, the solve also has a file of its own, as a trajectory must belong to the field beside it (in takes of older engines, the
    # trajectory may be another solve's).
    solved = stamp_of("recover", VERSION, upstream, dataclasses.replace(settings, refine=0))
    if take.file(SOLVED).is_file() or take.is_done("solve", solved):
        kept = take.kept("recover", stamp, lambda: (read_recovery(take), load_field(take.file("field.safetensors"))), progress)
        if kept is not None:
            return *kept, {}, {}
    seconds, expected = dict[str, float](), dict[str, float]()
    recovery = take.kept("solve", solved, lambda: _read_solve(take), progress)
    if recovery is None:
        progress.begin("recover", "recovering the force")
        foresee = _foreseen(particles, material, targets, fps, settings)
        if (whole := foresee(0, 0)) is not None:
            expected["recover"] = whole
            progress.update(0.0, f"recovering the force, about {in_words(whole)} on this machine", expected_seconds=whole)
        started = time.perf_counter()
        with TakeJournal(take, solved, progress) as journal:
            if settings.schedule == "paper":
                made = loss() if loss is not None else None
                recovery = recover_by_descent(particles, material, targets, fps, settings, progress, made, journal)
            else:
                recovery = recover(particles, material, targets, fps, settings, progress, journal, known, foresee)
            seconds["recover"] = time.perf_counter() - started
            if recovery.outcome == Outcome.DIVERGED:
                return recovery, None, seconds, expected
            take.withdraw("solve")
            take.write_arrays(SOLVED, to_arrays(recovery) | {"fps": np.array(fps)})
            take.finish("solve", solved, to_mapping(told))
    with TakeJournal(take, stamp, progress) as journal:
        field = _fit_field(recovery, particles, material, fps, settings, progress, journal, seconds)
        _publish(take, field)
        take.finish("recover", stamp, to_mapping(told))
    return recovery, field, seconds, expected


def _publish(take: Take, field: ForceField) -> None:
    """Replace the take's field and trajectory by a new field and its trajectory."""
    with take.writing(FITTED) as path:
        field.save(path)
    # A full disk can only stop the writing of a stamp, before or after both files are renamed, so the two files always belong together.
    take.withdraw("recover")
    take.file("wind.safetensors").unlink(missing_ok=True)  # it belongs to the former field
    if take.file(SOLVED).is_file():
        systems.replace(take.file(SOLVED), take.file(TRAJECTORY))
    systems.replace(take.file(FITTED), take.file("field.safetensors"))


def _foreseen(
    particles: Particles, material: Material, targets: PointTargets | list[TrackTargets], fps: float, settings: RecoverSettings
) -> Foresee:
    """How long the solve will take on this machine."""
    check_body(particles, fps)
    frames, points = len(targets.visible if isinstance(targets, PointTargets) else targets[0].visible) - 1, points_in(targets)
    work = work_of(particles, material, fps, frames, points, settings)
    if work is None:
        return unforeseen
    speed, times = measure_speed(work.plastic), 1.0
    if isinstance(targets, PointTargets) and particles.pinned.any() and not work.plastic:
        dx = LIMITS.cell_spacings * particles.spacing
        times = refinement(targets, dx, 1.0 / fps, substeps_of(particles, material, fps))

    def foresee(densely: int, finely: int) -> float | None:
        whole = work_of(particles, material, fps, frames, points, settings, densely, finely)
        # Finer copies only: tangents are carried along the rough model.
        return None if whole is None else dataclasses.replace(whole, copies=times * whole.copies).seconds(speed)

    return foresee


def known_body(folder: str) -> KnownBody:
    """Stiffness and clamp of a held body from the take in `folder`.

    Raises:
        UsageError: if the folder holds no take with a recovery, or the recovery did not determine the body's stiffness.
        WrongTake: if the take is damaged.
    """
    return KnownBody.of(read_recovery(require_take(folder)), folder)


def _fit_field(
    recovery: Recovery,
    particles: Particles,
    material: Material,
    fps: float,
    settings: RecoverSettings,
    progress: Progress,
    journal: Journal,
    seconds: dict[str, float],
) -> ForceField:
    """Fit a field to the recovered forces and refine it if the settings say so; adds the seconds that each took to `seconds`."""
    from ..field import distill
    from .paper.refinement import refine

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
            off = f"{in_units(refined.after, 'm')} ({in_units(refined.before, 'm')} before)"
            progress.update(1.0, f"the field's own simulation strays {off} from the recovered motion")
    return field


def _read_solve(take: Take) -> Recovery:
    """The last solve, from its own file while its field is not fitted, else from the field's trajectory."""
    return recovery_of(take.read_arrays(SOLVED if take.file(SOLVED).is_file() else TRAJECTORY))
