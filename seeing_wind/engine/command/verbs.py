"""The verbs of the command line as functions from options to one result. The long ones have files of their own."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import SeeingWindError, UsageError
from ..progress import Progress
from ..record_arrays import require_take
from ..take import Take
from .batch.verb import batch
from .checks import asked_model
from .inputs import inputs_of, refuse_foreign, refuse_overwriting, refuse_result
from .join import join
from .observe import observe
from .recover import recover
from .reporting import warn_of_field
from .resimulate import resimulate
from .trajectories.verb import recover_trajectories

if TYPE_CHECKING:
    from ..field import ForceField

Result = dict[str, Any]


def sample(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`sample DIR --points P.npy [--frame T] [--fade M] --out OUT.npz`."""
    from ..field import distances, load_field, read_points, sample_points
    from ..recovery.wind.stage import read_wind

    take = require_take(arguments.take)
    field = _felt(load_field(take.file("field.safetensors")), arguments)
    out = Path(arguments.out)
    if not out.name:
        raise UsageError(f"'{arguments.out}' is not a file's name.", "Give --out a path such as forces.npz.")
    if out.resolve() == Path(arguments.points).resolve():
        raise UsageError(f"{out} is the file of the points.", "Give --out another name.")
    refuse_result(out)
    warn_of_field(take, progress)
    points, frame = read_points(arguments.points), arguments.frame
    force_density, confidence = sample_points(field, points, frame, progress)
    arrays = {"force_density": force_density, "confidence": confidence, "distance": distances(field, points, frame)}
    wind = read_wind(take)
    if wind is not None:
        wind = _felt(wind, arguments)
        arrays["wind_velocity"], arrays["wind_confidence"] = sample_points(wind, points, frame, progress)
        arrays["wind_distance"] = distances(wind, points, frame)
    Take(out.parent).write_arrays(out.name, arrays)
    return {"outcome": "converged", "out": str(out), "points": confidence.size}


def export(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`export DIR --format npz|ply|fga|vdb [--fade M] --out PATH`."""
    from ..field import load_field
    from ..field.sampling import export_field
    from ..recovery.wind.stage import read_wind

    take = require_take(arguments.take)
    field, wind = _felt(load_field(take.file("field.safetensors")), arguments), read_wind(take)
    out = Path(arguments.out)
    refuse_result(out, folder=arguments.format != "npz" or not out.name)
    if arguments.format == "npz" and out.name:
        refuse_result(out.with_name(f"{out.name.removesuffix('.npz')}.npz"))  # as it is completed
    warn_of_field(take, progress)
    progress.begin("export", arguments.format)
    files = export_field(field, arguments.format, Path(arguments.out), progress, wind=None if wind is None else _felt(wind, arguments))
    return {"outcome": "converged", "files": [str(path) for path in files]}


def _felt(field: ForceField, arguments: argparse.Namespace) -> ForceField:
    """The field as it was recovered or, with --fade, as it acts in a re-simulation and in Blender's solvers."""
    from ..recovery.resimulate.in_field import Reach, WithinReach

    return field if arguments.fade is None else WithinReach(field, Reach(arguments.fade))


def identify(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`identify CLIP --take DIR`: the objects of the first frame with materials and masks, ready for one `recover` each."""
    from ..observe.clip.frames import read_clip
    from ..observe.models.objects import find_objects, write_objects

    endpoint = asked_model(arguments)
    assert endpoint is not None  # both options are required
    take, inputs = Take(arguments.take), list(inputs_of(arguments))
    refuse_overwriting(take, inputs, r"objects\.json|objects/[^/]+\.png")
    refuse_foreign(take, inputs, of_takes=True)
    take.prepare()
    first = arguments.frames[0] if arguments.frames else 0
    frame = read_clip(arguments.clip, (first, first + 1), fps=1.0, progress=progress).frames[0]
    found = find_objects(endpoint, frame, arguments.detector_model, arguments.mask_model, progress)
    return {"outcome": "converged", "objects": write_objects(take, found)}


def doctor(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`doctor`: what works here. Fails when something required does not."""
    from .doctor import examine

    checks = examine()
    broken = [check["name"] for check in checks if not check["ok"] and not check.get("optional")]
    if broken:
        for check in checks:
            if not check["ok"]:
                progress.warn(f"{check['name']}: {check['detail']}. {check.get('advice', '')}".strip())
        raise SeeingWindError(f"The engine is not complete: {', '.join(broken)}.", "Run Install Engine, or `make setup`.")
    return {"outcome": "converged", "checks": checks}


VERBS: dict[str, Callable[[argparse.Namespace, Progress], Result]] = {
    "observe": observe,
    "recover": recover,
    "recover-trajectories": recover_trajectories,
    "sample": sample,
    "resimulate": resimulate,
    "export": export,
    "join": join,
    "identify": identify,
    "batch": batch,
    "doctor": doctor,
}
