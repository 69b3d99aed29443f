"""The verb *recover-trajectories*: from a file of 3D trajectories to one result. The stages do the work."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from ...materials import find
from ...progress import Journal, Progress
from ...settings import RecoverSettings, WindSettings
from ...stages import check_solve
from ...take import Take, stamp_of
from ..arguments import properties_of, settings_of
from ..inputs import check_place, inputs_of, note_truth, refuse_of_another
from ..lock import held
from ..reporting import diverged_result, report_result
from .bodies import Trajectories, read_trajectories
from .sheets import check_recovery_of_sheet, is_sheet, recover_sheet


def recover_trajectories(arguments: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """`recover-trajectories TRUTH.npz --take DIR`."""
    from ...recovery.diagnostics.remarks import worst_first
    from ...recovery.stage import recover_stage
    from ...recovery.wind.stage import wind_stage

    if is_sheet(arguments.truth):
        return recover_sheet(arguments, progress)
    source, settings = check_recovery(arguments)
    take, particles, material = Take(arguments.take), source.particles, source.material
    with held(take, arguments.verb, progress, inputs_of(arguments)):
        for note in source.notes:
            progress.warn(note)
        upstream = stamp_of("trajectories", Path(arguments.truth), material, source.targets)
        recovery, field, seconds, expected = recover_stage(
            take, particles, material, source.targets, source.fps, upstream, settings, progress
        )
        recovery = dataclasses.replace(recovery, notes=worst_first([*source.notes, *recovery.notes]))
        if field is None:
            return diverged_result(recovery)
        note_truth(take, upstream, arguments.truth)
        blown = settings_of(WindSettings, arguments)
        wind = wind_stage(take, None, particles, material, recovery, source.fps, blown, settings, progress)
        recovery = dataclasses.replace(recovery, notes=worst_first([*wind.notes, *recovery.notes]))

        def draw(_: Journal) -> dict[str, Any]:
            from ...look.report import write_trajectory_report

            return write_trajectory_report(
                take, particles, material, recovery, field, seconds, settings, progress, arguments.report, wind.told, expected
            )

        return report_result(take, recovery, arguments.report, "", draw, progress)


def check_trajectories(arguments: argparse.Namespace, progress: Progress) -> None:
    """Refuse, before any job of a batch starts, what `recover-trajectories` refuses before its work.

    Raises:
        UsageError, ObjectError, MaterialError: as `check_recovery` or `check_recovery_of_sheet`, and `check_place`.
    """
    progress.check()
    if is_sheet(arguments.truth):
        check_recovery_of_sheet(arguments)
    else:
        check_recovery(arguments)
    check_place(Take(arguments.take), inputs_of(arguments))


def check_recovery(arguments: argparse.Namespace) -> tuple[Trajectories, RecoverSettings]:
    """What the file and the options say of a body and of the solve.

    Raises:
        UsageError, ObjectError, MaterialError: as `read_trajectories`, `check_solve`, `still_frames` and `refuse_of_another`.
    """
    preset = find(arguments.material) if arguments.material else None
    gravity = None if arguments.gravity is None else tuple(arguments.gravity)
    source = read_trajectories(arguments.truth, preset, gravity, **properties_of(arguments))
    settings = settings_of(RecoverSettings, arguments, gravity=source.gravity, clamp_depth=source.clamp_depth)
    check_solve(settings, clip=False)
    if settings.still is not None:
        from ...recovery.clip import still_frames  # imports the solver

        still_frames(settings, len(source.targets.visible) - 1)
    refuse_of_another(Take(arguments.take), arguments.truth)
    return source, settings
