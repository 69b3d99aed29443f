"""What `recover` refuses before it begins its work: options that contradict each other, the clip, or another take."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import ClipError, UsageError
from ..progress import Progress
from ..settings import BuildSettings, ObserveSettings, RecoverSettings
from ..settings.build import part_materials, sheet_of
from ..stages import check_sheet, check_solve
from ..take import Take
from .arguments import observe_settings, settings_of
from .inputs import check_place, inputs_of, refuse_of_another

if TYPE_CHECKING:
    from ..observe.models.endpoint import Endpoint

PAINTED_DEPTH = 0.5
"""Default of `RecoverSettings.clamp_depth` [grid cells] for a clip: a painted held part includes some material that gives way."""


def check_recovery(arguments: argparse.Namespace, progress: Progress) -> tuple[RecoverSettings, Endpoint | None]:
    """The settings of the solve, and the model to ask about the material, for one object of a clip; the clip is read only to count views.

    Raises:
        ClipError: there is no clip. MaterialError: an unknown material, numbers that are not physical, or no sheet where one is asked for.
        UsageError: options that do not go together, a file that is missing, or a take of something else.
    """
    from ..observe.clip.frames import require_clip

    require_clip(arguments.clip)
    _check_views(arguments, progress)
    part_materials(settings_of(BuildSettings, arguments))
    settings = settings_of(RecoverSettings, arguments, clamp_depth=PAINTED_DEPTH)
    check_solve(settings, clip=True, views=len(arguments.view))
    if arguments.form == "sheet":
        check_sheet(settings)  # by default the object's size decides whether it is a sheet; `recover` checks that case later
    check_options(arguments, settings, arguments.frames, arguments.distance)
    endpoint = asked_model(arguments)
    if endpoint is None:  # else the material is asked for once the object was seen
        sheet_of(settings_of(BuildSettings, arguments))
    refuse_of_another(Take(arguments.take), arguments.clip)
    return settings, endpoint


def check_files(arguments: argparse.Namespace, progress: Progress) -> None:
    """Refuse, before any job of a batch starts, what `recover` finds out once it has read the clip: arguments as of `check_recovery`.

    Raises:
        ClipError, UsageError, ObjectError: as `check_recovery`, `check_place`, `check_options` and `observe.given.check_clip`.
    """
    from ..observe.given import check_clip

    settings, _ = check_recovery(arguments, progress)
    check_place(Take(arguments.take), inputs_of(arguments))
    observing = observe_settings(arguments)
    frames = check_clip(arguments.clip, observing, progress)
    check_options(arguments, settings, frames, arguments.distance)
    for clip, camera, mask in arguments.view:
        check_clip(clip, of_view(observing, camera, mask), progress)


def of_view(observing: ObserveSettings, camera: str, mask: str) -> ObserveSettings:
    """The settings for the clip of a further view: its depth and pins are not used, as its points are found on the first view's body."""
    further = dataclasses.replace(observing, mask=mask, camera=camera, box=None, points=None, tracks=None, depth=None, pin=None)
    further = dataclasses.replace(further, outline=None, correct=None, distance=1.0, depth_model=None)
    return dataclasses.replace(further, prompt=None, detector_model=None)


def check_options(
    arguments: argparse.Namespace, settings: RecoverSettings, frames: tuple[int, int] | None, distance: float | None
) -> None:
    """Refuse options that later stages would refuse for this clip.

    Only the checks for which the first and last of the `frames`, or the object's `distance` [m], are known by now are made.
    """
    from ..observe.object.shape.relief import check_thickness

    if frames is not None and settings.still is not None:
        from ..recovery.clip import still_frames  # imports the solver

        still_frames(settings, frames[1] - frames[0], frames[0])
    if arguments.thickness is not None and distance is not None:
        check_thickness(arguments.thickness, distance)


def asked_model(arguments: argparse.Namespace) -> Endpoint | None:
    """The vision-language model that --material-endpoint names, None without one."""
    if arguments.material_endpoint is None and arguments.material_model is None:
        return None
    if arguments.material_endpoint is None or arguments.material_model is None:
        raise UsageError("--material-endpoint and --material-model belong together.", "Give the address and the model's name there.")
    from ..observe.models.endpoint import endpoint_of

    return endpoint_of(arguments.material_endpoint, arguments.material_model)


def _check_views(arguments: argparse.Namespace, progress: Progress) -> None:
    """Refuse further views that do not exist, or have another number of frames than the clip."""
    from ..observe.clip.frames import count_frames, require_clip

    if not arguments.view:
        return
    for clip, *files in arguments.view:
        require_clip(clip)
        if Path(clip).resolve() == Path(arguments.clip).resolve():
            raise UsageError(f"--view names {clip}, the clip itself.", "A further view is what another camera took meanwhile.")
        for name in files:
            if not Path(name).is_file():
                raise UsageError(f"--view names {name}, which is not a file.", "Give each further view a clip, a camera and a mask.")
    clips = (arguments.clip, *(view[0] for view in arguments.view))
    try:
        counts = {clip: count_frames(clip, arguments.frames, progress) for clip in clips}
    except ClipError:
        return  # reported by the stage that reads it
    for clip, *_ in arguments.view:
        if counts[clip] != counts[arguments.clip]:
            raise UsageError(
                f"--view {clip} has {counts[clip]} frames, and {arguments.clip} {counts[arguments.clip]}: views are of the same frames.",
                "Cut one of them, or choose with --frames those that all have; the first is the same moment in all.",
            )
