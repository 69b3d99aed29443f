"""The verb *recover*: from options to one result. The stages do the work."""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..conventions import as_in_file
from ..errors import ObjectError, UsageError
from ..progress import Journal, Progress
from ..records import Body, Observation, Outcome, Recovery, TrackTargets
from ..settings import BuildSettings, ObserveSettings, RecoverSettings, WindSettings
from ..stages import build_stage, check_sheet, frame_loss, lift_stage, observe_stage, track_targets, write_gaussians
from ..take import Take, stamp_of
from .arguments import observe_settings, settings_of
from .checks import check_files, check_options, check_recovery, of_view
from .inputs import inputs_of, refuse_foreign, refuse_of_another
from .join import join
from .lock import held
from .reporting import counting_in_file, diverged_result, report_result

if TYPE_CHECKING:
    from ..field import ForceField
    from ..observe.models.endpoint import Endpoint
    from ..observe.steady import Steady
    from ..recovery.wind.stage import Wind

Result = dict[str, Any]

KEPT = ("observation.npz", "particles.npz", "trajectory.npz", "field.safetensors")
"""Files that every finished recovery of a clip has."""


def recover(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`recover CLIP --take DIR`."""
    if arguments.objects is not None:
        return _recover_objects(arguments, progress)
    return recover_one(arguments, progress)


def _recover_objects(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`recover CLIP --take DIR --objects OBJECTS.json`: every object in a take of its own, DIR/NAME.take, with its own material.

    Raises:
        UsageError: the file was not written by `identify`, or an option applies to a single object only.
    """
    home, found = Path(arguments.take), _each_object(arguments)
    Take(home).prepare()
    results: list[Result] = []
    for number, (name, own) in enumerate(found.items(), start=1):
        progress.begin("observe", f"{name}, object {number} of {len(found)}")
        results.append({"name": name, **recover_one(own, progress)})
    Take(home).write_json("objects_recovered.json", {"clip": arguments.clip, "objects": results})
    shared = _join_winds(arguments, results, progress)
    worst = [outcome for outcome in (Outcome.DIVERGED, Outcome.MAX_ITERATIONS) if any(r["outcome"] == outcome for r in results)]
    outcome, warnings = worst[0] if worst else Outcome.CONVERGED, [f"{r['name']}: {one}" for r in results for one in r.get("warnings", [])]
    return {"outcome": outcome.value, "take": str(home), "objects": results, "warnings": warnings + shared}


def check_recover(arguments: argparse.Namespace, progress: Progress) -> None:
    """Refuse, before any job of a batch starts, what `recover` would refuse of its options and of the files that they name.

    Raises:
        UsageError: as `recover`. ClipError, UsageError, ObjectError: as `check_files`.
    """
    for own in [arguments] if arguments.objects is None else _each_object(arguments).values():
        check_files(own, progress)


def _each_object(arguments: argparse.Namespace) -> dict[str, argparse.Namespace]:
    """The options for each object of --objects, by its name. Raises as `_recover_objects`."""
    from ..observe.models.language import RANGES
    from ..observe.models.objects import read_objects

    if arguments.view or arguments.tracks:
        raise UsageError("--view and --tracks belong to one object.", "Leave them out, or recover the objects one by one with --mask.")
    refuse_of_another(Take(arguments.take), arguments.clip)
    refuse_foreign(Take(arguments.take), [*inputs_of(arguments), ("--objects", Path(arguments.objects))], of_takes=True)
    found = {}
    for one in read_objects(arguments.objects):
        own = argparse.Namespace(**vars(arguments))
        vars(own).update({key: one[key] for key in ("mask", "law", *RANGES)})
        own.objects, own.take = None, str(Path(arguments.take) / f"{one['name']}.take")
        own.estimated_material, own.estimated_by = one["material"], f"{one['object']} of {Path(arguments.objects).name}"
        own.pin = arguments.pin if arguments.pin and _on(one["mask"], arguments.pin) else None
        found[one["name"]] = own
    return found


def _join_winds(arguments: argparse.Namespace, results: list[Result], progress: Progress) -> list[str]:
    """If a wind was asked for, recover one for all objects together.

    Returns a warning if that is not possible; each object then keeps a wind of its own.
    """
    if arguments.field != "wind" or any(one["outcome"] == Outcome.DIVERGED for one in results) or len(results) < 2:
        return []
    try:
        join(argparse.Namespace(verb="join", takes=[one["take"] for one in results]), progress)
    except (ObjectError, UsageError) as error:
        return [f"Each object keeps a wind of its own. {error.message} {error.hint}"]
    return []


def _on(mask: str, pin: str) -> bool:
    """Whether the held part in the PNG `pin` overlaps the object in the PNG `mask`; True if they cannot be read or compared."""
    import cv2

    from ..observe.clip.images import read_image

    try:
        images = [read_image(path, cv2.IMREAD_GRAYSCALE) for path in (mask, pin)]
    except (OSError, ValueError):
        return True  # reported by the stage that reads them
    if images[0].shape != images[1].shape:
        return True
    return bool(((images[0] > 0) & (images[1] > 0)).any())


def recover_one(arguments: argparse.Namespace, progress: Progress) -> Result:
    """Recover one object of a clip into one take."""
    # Errors in the options are reported before the work begins and before a folder is made.
    settings, endpoint = check_recovery(arguments, progress)
    with counting_in_file(arguments, progress) as told, held(Take(arguments.take), arguments.verb, progress, inputs_of(arguments)) as take:
        return _recover_into(take, arguments, settings, endpoint, told)


def _recover_into(
    take: Take, arguments: argparse.Namespace, settings: RecoverSettings, endpoint: Endpoint | None, progress: Progress
) -> Result:
    from ..observe.preview.verdicts import doubt_remarks
    from ..recovery.diagnostics.remarks import worst_first
    from ..recovery.stage import recover_stage
    from ..recovery.wind.stage import wind_stage

    seconds = dict[str, float]()
    observing = observe_settings(arguments)

    def ready(clip: Steady) -> None:
        first = clip.clip.first_frame
        check_options(arguments, settings, (first, first + len(clip.clip.frames) - 1), clip.distance)

    observation, seen = _timed(seconds, "observe", lambda: observe_stage(take, arguments.clip, observing, progress, ready=ready))
    check_options(arguments, settings, (observation.first_frame, observation.first_frame + observation.frames), None)
    building, asked = settings_of(BuildSettings, arguments), list[str]()
    if endpoint is not None:
        from ..observe.models.language import ask_material

        building, asked = _timed(seconds, "material", lambda: ask_material(take, endpoint, observation, building, progress))
    body, upstream = _timed(seconds, "build", lambda: build_stage(take, observation, seen, building, progress))
    severe, doubtful = doubt_remarks(observation, observing, 1 + len(arguments.view))
    asked += [*body.told, *([body.top_heavy] if any(settings.gravity) and body.top_heavy else [])]
    targets = [track_targets(observation, body)]
    if arguments.view:
        body, targets, upstream = _with_views(take, arguments.view, observing, observation, body, targets, upstream, progress)
    if settings.still is not None:
        first, last = settings.still  # numbered as in the file, not from the first frame that is used
        settings = dataclasses.replace(settings, still=(first - observation.first_frame, last - observation.first_frame))
    blown = settings_of(WindSettings, arguments)
    if body.sheet is not None:
        recovery, field, wind, solve_seconds = _sheet(take, body, targets, observation.fps, upstream, settings, blown, progress)
        expected = dict[str, float]()
    else:
        loss = None if settings.objective == "tracking" else lambda: frame_loss(settings, observation, body, progress)
        recovery, fitted, solve_seconds, expected = recover_stage(
            take, body.particles, body.material, targets, observation.fps, upstream, settings, progress, loss
        )
        if fitted is None:
            notes = [as_in_file(note, observation.first_frame) for note in worst_first([*severe, *asked, *recovery.notes, *doubtful])]
            return diverged_result(dataclasses.replace(recovery, notes=notes))
        field = fitted
        wind = wind_stage(take, body, body.particles, body.material, recovery, observation.fps, blown, settings, progress)
    notes = worst_first([*severe, *asked, *wind.notes, *recovery.notes, *doubtful])
    notes = [as_in_file(note, observation.first_frame) for note in notes]
    recovery = dataclasses.replace(recovery, notes=notes)

    def draw(journal: Journal) -> dict[str, Any]:
        from ..look.report import write_report

        spent, level = seconds | solve_seconds, arguments.report
        return write_report(
            take, observation, body, recovery, field, spent, settings, progress,
            level=level, wind=wind.told, expected=expected, journal=journal,
        )  # fmt: skip

    result = report_result(take, recovery, arguments.report, observation.clip, draw, progress)
    gone = [name for name in KEPT if not take.file(name).is_file()]
    if gone:  # somebody removed them meanwhile
        result["warnings"].append(f"{' and '.join(gone)} were removed from the take while it was made: run `recover` again.")
    return result


def _with_views(
    take: Take,
    views: list[list[str]],
    observing: ObserveSettings,
    observation: Observation,
    body: Body,
    targets: list[TrackTargets],
    built: str,
    progress: Progress,
) -> tuple[Body, list[TrackTargets], str]:
    """The body as seen by all cameras, the targets from each of them, and the stamp of both.

    Args:
        views: clip, camera and mask of each further view.
        targets: those from the first view.
        built: stamp of the body as built from the first view.
    """
    from ..look.first_frame import with_views
    from ..observe.object.motion.views import view_targets

    sights, targets = [], list(targets)
    for number, (clip, camera, mask) in enumerate(views, start=1):
        sights.append(observe_stage(take, clip, of_view(observing, camera, mask), progress, view=number)[0])
        targets.append(view_targets(body, sights[-1]))
    stamp = stamp_of(built, *(Path(name) for view in views for name in view))
    body = lift_stage(take, observation, body, targets, stamp, progress)
    body = with_views(body, observation, sights, progress)
    take.withdraw("report")  # as that stage writes the Gaussians' file, too
    write_gaussians(take, body.gaussians)
    return body, targets, stamp


def _sheet(
    take: Take,
    body: Body,
    targets: list[TrackTargets],
    fps: float,
    upstream: str,
    settings: RecoverSettings,
    blown: WindSettings,
    progress: Progress,
) -> tuple[Recovery, ForceField, Wind, dict[str, float]]:
    """Recover what moved a thin sheet: recovery, field, wind, and the seconds that each part took.

    Raises:
        UsageError: an option applies only to the solve of a solid.
    """
    from ..recovery.wind.sheet import SheetSeen, sheet_stage

    assert body.sheet is not None and body.path is not None
    check_sheet(settings)
    held, faces = body.particles.pinned, body.surface.triangles
    seen = SheetSeen(body.path, faces, held, body.sheet, fps, body.path_sigma, body.measured, targets)
    found = sheet_stage(take, seen, upstream, settings, blown, progress)
    return found.recovery, found.field, found.wind, found.seconds


def _timed(seconds: dict[str, float], stage: str, work: Callable[[], Any]) -> Any:
    started = time.perf_counter()
    result = work()
    seconds[stage] = time.perf_counter() - started
    return result
