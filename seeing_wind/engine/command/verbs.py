"""What each verb of the command line does: options in, one result out. Short: the work is in the stages."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..conventions import GRAVITY
from ..errors import SeeingWindError, TakeError, UsageError
from ..materials import adjusted, find
from ..progress import Progress
from ..reading import read_toml
from ..records import Material, Outcome
from ..settings import BodyEdit, BuildSettings, ColliderEdit, Edit, ObserveSettings, RecoverSettings, WindSettings, from_mapping
from ..stages import (
    build_stage,
    check_solve,
    observe_stage,
    picture_loss,
    read_body,
    read_recovery,
    recover_stage,
    require_take,
    track_targets,
    write_gaussians,
)
from ..take import Take, json_text, npz, stamp_of
from .arguments import gravity_of, properties_of, settings_of
from .lock import held
from .preview import preview
from .reporting import diverged, reported

if TYPE_CHECKING:
    from ..field import ForceField
    from ..observe.models.endpoint import Endpoint

Result = dict[str, Any]

LONGEST_NAME = 200
"""Bytes of a body's name: most file systems end at 255, and the file has an ending and a neighbour while it is written."""

RESERVED = frozenset(["CON", "PRN", "AUX", "NUL", *(f"{port}{number}" for port in ("COM", "LPT") for number in range(10))])
"""Names that Windows keeps for devices."""

PAINTED_DEPTH = 0.5
"""Grid cells (`RecoverSettings.clamp_depth`): what is painted as held in a picture takes in some material that gives way."""


def recover(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`recover CLIP --take DIR`."""
    if arguments.objects is not None:
        return _recover_objects(arguments, progress)
    return _recover_one(arguments, progress)


def _recover_objects(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`recover CLIP --take DIR --objects OBJECTS.json`: every object in a take of its own, DIR/NAME.take, with its own material.

    Raises:
        UsageError: a file that `identify` did not write, or options that belong to one object.
    """
    from ..observe.models.language import RANGES
    from ..observe.models.objects import read_objects

    if arguments.view or arguments.tracks:
        raise UsageError("--view and --tracks belong to one object.", "Leave them out, or recover the objects one by one with --mask.")
    home, found = Path(arguments.take), read_objects(arguments.objects)
    Take(home).prepare()
    results: list[Result] = []
    for number, one in enumerate(found, start=1):
        progress.begin("observe", f"{one['name']}, object {number} of {len(found)}")
        own = argparse.Namespace(**vars(arguments))
        vars(own).update({key: one[key] for key in ("mask", "law", *RANGES)})
        own.objects, own.take = None, str(home / f"{one['name']}.take")
        own.estimated_material, own.estimated_by = one["material"], f"{one['object']} of {Path(arguments.objects).name}"
        own.pin = arguments.pin if arguments.pin and _on(one["mask"], arguments.pin) else None
        results.append({"name": one["name"], **_recover_one(own, progress)})
    Take(home).write_json("objects_recovered.json", {"clip": arguments.clip, "objects": results})
    worst = [outcome for outcome in (Outcome.DIVERGED, Outcome.MAX_ITERATIONS) if any(r["outcome"] == outcome for r in results)]
    outcome, warnings = worst[0] if worst else Outcome.CONVERGED, [f"{r['name']}: {one}" for r in results for one in r.get("warnings", [])]
    return {"outcome": outcome.value, "take": str(home), "objects": results, "warnings": warnings}


def _on(mask: str, pin: str) -> bool:
    """Whether what the PNG `pin` holds is on the object of the PNG `mask`, so far as both can be read and compared."""
    import cv2

    from ..observe.clip.pictures import read_picture

    try:
        pictures = [read_picture(path, cv2.IMREAD_GRAYSCALE) for path in (mask, pin)]
    except (OSError, ValueError):
        return True  # told by the stage that reads them
    if pictures[0].shape != pictures[1].shape:
        return True
    return bool(((pictures[0] > 0) & (pictures[1] > 0)).any())


def _recover_one(arguments: argparse.Namespace, progress: Progress) -> Result:
    """One object of a clip into one take."""
    from ..observe.clip.frames import require_clip

    # What is wrong is told before the work begins, and before a folder is made.
    require_clip(arguments.clip)
    _material(find(arguments.material), arguments)
    settings = settings_of(RecoverSettings, arguments, gravity=gravity_of(arguments), clamp_depth=PAINTED_DEPTH)
    check_solve(settings, clip=True, views=len(arguments.view))
    endpoint = _endpoint(arguments)
    with held(Take(arguments.take), arguments.verb, progress) as take:
        return _recover_into(take, arguments, settings, endpoint, progress)


def _recover_into(
    take: Take, arguments: argparse.Namespace, settings: RecoverSettings, endpoint: Endpoint | None, progress: Progress
) -> Result:
    from ..look import write_ply
    from ..look.multiview import with_views
    from ..observe import observe
    from ..observe.object.motion.views import lifted_together, view_targets
    from ..recovery.wind.stage import wind_stage

    seconds = dict[str, float]()
    points = tuple(value for point in arguments.points for value in point) if arguments.points else None
    observing = settings_of(ObserveSettings, arguments, points=points)
    observation, seen = _timed(seconds, "observe", lambda: observe_stage(take, arguments.clip, observing, progress))
    building = settings_of(BuildSettings, arguments)
    if endpoint is not None:
        from ..observe.models.language import estimated

        building = _timed(seconds, "material", lambda: estimated(take, endpoint, observation, building, progress))
    body, built = _timed(seconds, "build", lambda: build_stage(take, observation, seen, building, progress))
    targets, sights = [track_targets(observation, body)], []
    for clip, camera, mask in arguments.view:
        # Depth and pins of a further view are not used: its points are found on the first view's body.
        further = dataclasses.replace(observing, mask=mask, camera=camera, box=None, points=None, tracks=None, depth=None, pin=None)
        further = dataclasses.replace(further, distance=1.0, depth_model=None, prompt=None, detector_model=None)
        progress.begin("observe", f"further view {Path(clip).name}")
        sights.append(observe(clip, further, progress))
        targets.append(view_targets(body, sights[-1]))
    if arguments.view:
        body = lifted_together(observation, body, targets, progress)
        body, _ = with_views(body, observation, sights, progress)
        take.withdraw("report")  # which writes that file, too
        write_gaussians(take, body.gaussians, write_ply)
    upstream = stamp_of(built, *(Path(name) for view in arguments.view for name in view))
    loss = None if settings.objective == "tracking" else lambda: picture_loss(settings, observation, body, progress)
    recovery, field, solve_seconds = recover_stage(
        take, body.particles, body.material, targets, observation.fps, upstream, settings, progress, loss
    )
    if field is None:
        return diverged(recovery)
    blown = settings_of(WindSettings, arguments)
    wind = wind_stage(take, body, body.particles, body.material, recovery, observation.fps, blown, settings, progress)
    recovery = dataclasses.replace(recovery, notes=[*wind.notes, *recovery.notes])

    def draw() -> dict[str, Any]:
        from ..look.report import write_report

        spent = seconds | solve_seconds
        return write_report(take, observation, body, recovery, field, spent, settings, progress, level=arguments.report, wind=wind.told)

    return reported(take, recovery, arguments.report, observation.clip, draw, progress)


def recover_trajectories(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`recover-trajectories TRUTH.npz --take DIR`."""
    from ..recovery.wind.stage import wind_stage
    from .trajectories import read_trajectories

    take, preset = Take(arguments.take), find(arguments.material) if arguments.material else None
    gravity = gravity_of(arguments) if arguments.gravity or arguments.no_gravity else None
    source = read_trajectories(arguments.truth, preset, gravity, **properties_of(arguments))
    particles, material = source.particles, source.material
    settings = settings_of(RecoverSettings, arguments, gravity=source.gravity, clamp_depth=source.clamp_depth)
    check_solve(settings, clip=False)
    with held(take, arguments.verb, progress):
        for note in source.notes:
            progress.warn(note)
        upstream = stamp_of("trajectories", Path(arguments.truth), material, source.targets)
        recovery, field, seconds = recover_stage(take, particles, material, source.targets, source.fps, upstream, settings, progress)
        recovery = dataclasses.replace(recovery, notes=[*source.notes, *recovery.notes])
        if field is None:
            return diverged(recovery)
        blown = settings_of(WindSettings, arguments)
        wind = wind_stage(take, None, particles, material, recovery, source.fps, blown, settings, progress)
        recovery = dataclasses.replace(recovery, notes=[*wind.notes, *recovery.notes])

        def draw() -> dict[str, Any]:
            from ..look.report import write_trajectory_report

            return write_trajectory_report(
                take, particles, material, recovery, field, seconds, settings, None, progress, arguments.report, wind.told
            )

        return reported(take, recovery, arguments.report, "", draw, progress)


def sample(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`sample DIR --points P.npy [--frame T] --out OUT.npz`."""
    from ..field import load_field
    from ..field.sampling import sample_file
    from ..recovery.wind.stage import read_wind

    field = load_field(require_take(arguments.take).file("field.safetensors"))
    out = Path(arguments.out)
    if not out.name:
        raise UsageError(f"'{arguments.out}' is no file's name.", "Give --out a path such as forces.npz.")
    force_density, confidence = sample_file(field, arguments.points, arguments.frame, progress)
    arrays = {"force_density": force_density, "confidence": confidence}
    wind = read_wind(Take(arguments.take))
    if wind is not None:
        arrays["wind_velocity"], arrays["wind_confidence"] = sample_file(wind, arguments.points, arguments.frame, progress)
    Take(out.parent).write_arrays(out.name, arrays)
    return {"outcome": "converged", "out": str(out), "points": confidence.size}


def resimulate(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`resimulate DIR --edit EDIT.toml --take OUT` -> OUT/bodies/NAME.npz."""
    from ..field import load_field
    from ..recovery.journal import TakeJournal
    from ..recovery.resimulate import simulate_bodies
    from ..recovery.wind.stage import FIELD, read_wind

    source, out = require_take(arguments.source), Take(arguments.take)
    edit, field = read_edit(arguments.edit), load_field(source.file("field.safetensors"))
    field = _mover(edit, field, read_wind(source))
    recovered = None
    if any(body.mesh == "recovered" for body in edit.body):
        if not source.file("particles.npz").is_file():
            raise TakeError(f"{source.path} has no recovered object.", 'It came from trajectories: insert a mesh instead of "recovered".')
        recovered = (read_body(source), read_recovery(source))
    stamp = stamp_of(Path(arguments.edit), source.file(FIELD if field.kind == "wind" else "field.safetensors"))
    with held(out, arguments.verb, progress), TakeJournal(out, stamp, progress) as journal:
        progress.begin("resimulate", "simulating")
        folder = Path(arguments.edit).resolve().parent
        bodies = simulate_bodies(edit, field, recovered, folder, progress, device=arguments.device, journal=journal)
        figures = {
            name: {"vertices": int(body.vertices.shape[1]), "particles": body.particles, "notes": body.notes}
            for name, body in bodies.items()
        }
        summary = {"source": str(source.path), "fps": field.fps, "frames": field.frames, "bodies": figures}
        with contextlib.ExitStack() as together:  # all are there before any takes its place, the stamp last
            together.enter_context(out.finishing("resimulate", stamp, {"source": str(source.path), "edit": str(arguments.edit)}))
            for name, body in bodies.items():
                arrays = {"vertices": body.vertices, "triangles": body.triangles, "fps": np.array(field.fps)}
                together.enter_context(out.writing(f"bodies/{name}.npz")).write_bytes(npz(name, arrays))
            together.enter_context(out.writing("resimulation.json")).write_text(json_text(summary), encoding="utf-8")
    progress.update(1.0, "done")
    return {"outcome": "converged", "take": str(out.path), "bodies": figures}


def _mover(edit: Edit, force: ForceField, wind: ForceField | None) -> ForceField:
    """The field that moves the bodies of an edit.

    Raises:
        UsageError: for another word than force and wind, and a wind that the take does not have.
    """
    if edit.field not in (None, "force", "wind"):
        raise UsageError(f"field is {edit.field!r}.", "Write force or wind, or leave it out for what the take was recovered with.")
    if edit.field == "wind" and wind is None:
        raise UsageError("The take has no wind.", "Recover it with --field wind, or leave field out of the edit.")
    return force if wind is None or edit.field == "force" else wind


def export(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`export DIR --format npz|ply|fga|vdb --out PATH`."""
    from ..field import load_field
    from ..field.sampling import export_field
    from ..recovery.wind.stage import read_wind

    take = require_take(arguments.take)
    field, wind = load_field(take.file("field.safetensors")), read_wind(take)
    progress.begin("export", arguments.format)
    files = export_field(field, arguments.format, Path(arguments.out), progress, wind=wind)
    return {"outcome": "converged", "files": [str(path) for path in files]}


def identify(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`identify CLIP --take DIR`: the objects of the first picture with materials and masks, ready for one `recover` each."""
    from ..observe.clip.frames import read_clip
    from ..observe.models.objects import find_objects, write_objects

    endpoint = _endpoint(arguments)
    assert endpoint is not None  # both options are required
    Take(arguments.take).prepare()
    first = arguments.frames[0] if arguments.frames else 0
    picture = read_clip(arguments.clip, (first, first + 1), fps=1.0, progress=progress).frames[0]
    found = find_objects(endpoint, picture, arguments.detector_model, arguments.mask_model, progress)
    return {"outcome": "converged", "objects": write_objects(Take(arguments.take), found)}


def batch(arguments: argparse.Namespace, progress: Progress) -> Result:
    """`batch JOBS.toml`: see `batch.verb`."""
    from .batch.verb import batch

    return batch(arguments, progress)


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
    "preview": preview,
    "recover": recover,
    "recover-trajectories": recover_trajectories,
    "sample": sample,
    "resimulate": resimulate,
    "export": export,
    "identify": identify,
    "batch": batch,
    "doctor": doctor,
}


def read_edit(path: str) -> Edit:
    """Read EDIT.toml.

    Raises:
        UsageError: no such file, no TOML, an unknown or missing key, two bodies of one name, or none at all.
    """
    try:
        values = read_toml(path)
    except OSError as error:
        raise UsageError(f"The edit {path} cannot be read: {error.strerror or error}.", "Give the path of a TOML file.") from error
    except ValueError as error:
        raise UsageError(f"The edit {path} is no TOML: {error}.", "Mend that line.") from error
    tables = values.pop("body", [])
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        raise UsageError(f"The edit {path} has no [[body]].", "Add one with a name and a mesh.")
    bodies = tuple(from_mapping(BodyEdit, table, f"{path}, body {i + 1}") for i, table in enumerate(tables))
    _check_names([body.name for body in bodies])
    walls = values.pop("collider", [])
    if not isinstance(walls, list) or not all(isinstance(table, dict) for table in walls):
        raise UsageError(f"The edit {path} has a collider that is no [[collider]].", "Write [[collider]] with a name and a mesh or plane.")
    colliders = tuple(from_mapping(ColliderEdit, table, f"{path}, collider {i + 1}") for i, table in enumerate(walls))
    return from_mapping(Edit, {"gravity": list(GRAVITY), **values, "body": bodies, "collider": colliders}, path)


def _check_names(names: list[str]) -> None:
    """UsageError unless each body can have a file of its own, on every system, before any of them is simulated."""
    for name in names:
        if not name.isprintable() or any(c in name for c in '/\\:*?"<>|') or name[:1] in ("", ".") or name[-1] in " .":
            raise UsageError(f"{name!r} cannot be a file's name.", "Use letters, digits, spaces, '-' and '_'.")
        if len(name.encode()) > LONGEST_NAME or name.split(".")[0].upper() in RESERVED:
            raise UsageError(f"{name[:40]!r} is too long for a file's name, or reserved.", "Choose another name for the body.")
        if [one.casefold() for one in names].count(name.casefold()) > 1:
            raise UsageError(f"Two bodies are named {name}.", "Give each a name of its own; capitals do not count.")


def _endpoint(arguments: argparse.Namespace) -> Endpoint | None:
    """The vision-language model that --material-endpoint names, None without one."""
    if arguments.material_endpoint is None and arguments.material_model is None:
        return None
    if arguments.material_endpoint is None or arguments.material_model is None:
        raise UsageError("--material-endpoint and --material-model belong together.", "Give the address and the model's name there.")
    from ..observe.models.endpoint import endpoint_of

    return endpoint_of(arguments.material_endpoint, arguments.material_model)


def _material(base: Material, arguments: argparse.Namespace) -> Material:
    """The material with the properties that the options give. Raises MaterialError as `materials.adjusted`."""
    return adjusted(base, **properties_of(arguments))


def _timed(seconds: dict[str, float], stage: str, work: Callable[[], Any]) -> Any:
    started = time.perf_counter()
    result = work()
    seconds[stage] = time.perf_counter() - started
    return result
