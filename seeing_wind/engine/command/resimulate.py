"""The verb *resimulate*: simulates an edit in the recovered field."""

from __future__ import annotations

import argparse
import contextlib
import os
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import UsageError
from ..progress import Progress
from ..record_arrays import read_body, read_recovery, require_take
from ..settings.tables import read_edit
from ..take import Take, json_text, npz, stamp_of
from .inputs import check_place, inputs_of_edit, made_of, refuse_of_another_edit
from .lock import held
from .reporting import warn_of_field

if TYPE_CHECKING:
    from ..field import ForceField
    from ..settings import Edit

FORCE = "field.safetensors"
"""File of a take with its force."""


def resimulate(arguments: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """`resimulate DIR --edit EDIT.toml --take OUT` -> OUT/bodies/NAME.npz."""
    from ..field import load_field
    from ..recovery.journal import TakeJournal
    from ..recovery.resimulate import simulate_bodies
    from ..recovery.wind.stage import FIELD, read_wind

    source, edit = require_take(arguments.source), check_edit(arguments)
    out, field = Take(arguments.take), load_field(source.file(FORCE))
    field = _mover(edit, field, read_wind(source))
    recovered = None
    if any(body.mesh == "recovered" for body in edit.body):
        if not source.file("particles.npz").is_file():
            of_clip = "build" in source.description().get("stages", {})
            lost = "particles.npz is missing: run `recover` for this take again, or insert a mesh"
            hint = lost if of_clip else "It came from trajectories: insert a mesh"
            raise UsageError(f"{source.path} has no recovered object.", f'{hint} instead of "recovered".')
        recovered = (read_body(source), read_recovery(source))
    others = _further_files(arguments, edit)
    own = source.file(FIELD if field.kind == "wind" else FORCE)
    stamp = stamp_of(Path(arguments.edit), own, *others)
    takes = {source.path.resolve(): source.path} | {one.resolve().parent: one.parent for one in others}
    for path in takes.values():
        warn_of_field(Take(path), progress)
    for warning in _acting_twice(edit, Path(arguments.edit).parent, own, others):
        progress.warn(warning)
    holding = held(out, arguments.verb, progress, inputs_of_edit(Path(arguments.edit)), made_of(edit))
    with holding, TakeJournal(out, stamp, progress) as journal:
        progress.begin("resimulate", "simulating")
        folder = Path(arguments.edit).resolve().parent
        bodies = simulate_bodies(edit, field, recovered, folder, progress, journal=journal)
        figures = {
            name: {"vertices": int(body.vertices.shape[1]), "particles": body.particles, "notes": body.notes}
            for name, body in bodies.items()
        }
        frames = min(edit.frames or field.frames, field.frames)
        preview = edit.coarseness > 1.0 or frames < field.frames
        further = [
            {"source": str(file.parent), "file": file.name, "name": one.name} for one, file in zip(edit.further_field, others, strict=True)
        ]
        summary = {
            "source": str(source.path), "further_fields": further, "fps": field.fps, "frames": frames, "preview": preview,
            "bodies": figures,
        }  # fmt: skip
        with contextlib.ExitStack() as together:  # all files are written before the first is renamed into place; the stamp is last
            together.enter_context(out.finishing("resimulate", stamp, {"source": str(source.path), "edit": str(arguments.edit)}))
            for name, body in bodies.items():
                arrays = {"vertices": body.vertices, "triangles": body.triangles, "fps": np.array(field.fps), "shell": np.array(body.shell)}
                together.enter_context(out.writing(f"bodies/{name}.npz")).write_bytes(npz(name, arrays))
            together.enter_context(out.writing("resimulation.json")).write_text(json_text(summary), encoding="utf-8")
    progress.update(1.0, "done")
    return {"outcome": "converged", "take": str(out.path), "bodies": figures}


def check_resimulation(arguments: argparse.Namespace, progress: Progress, later: Collection[Path]) -> None:
    """Refuse, before any job of a batch starts, what `resimulate` refuses before its work.

    Args:
        later: folders that are made before the job runs; what lies in them is not looked at.

    Raises:
        UsageError, WrongTake: as `require_take` and `check_edit`.
    """
    progress.check()
    edit = check_edit(arguments, later)
    if Path(arguments.source) in later:
        return
    source = require_take(arguments.source)
    others = _further_files(arguments, edit)
    if others and not any(made in Path(os.path.abspath(one)).parents for made in later for one in others):
        from ..field import load_field
        from ..recovery.resimulate.in_field import fields_of  # imports the solver
        from ..recovery.wind.stage import read_wind

        fields_of(edit, _mover(edit, load_field(source.file(FORCE)), read_wind(source)), Path(arguments.edit).parent)


def check_edit(arguments: argparse.Namespace, later: Collection[Path] = ()) -> Edit:
    """The edit, whose files are there, and whose re-simulation replaces neither another one nor a recovery.

    Args:
        later: as of `check_resimulation`.

    Raises:
        UsageError: as `read_edit`, `refuse_of_another_edit` and `check_place`; or a file is missing.
    """
    path = Path(arguments.edit)
    edit = read_edit(path)
    refuse_of_another_edit(Take(arguments.take), path)
    check_place(Take(arguments.take), inputs_of_edit(path), made_of(edit))
    for called, file in inputs_of_edit(path):
        whole = Path(os.path.abspath(file))
        if not file.is_file() and not any(folder in whole.parents for folder in later):
            raise UsageError(f"There is no file {called}.", "Correct the path; it is relative to the edit.")
    return edit


def _further_files(arguments: argparse.Namespace, edit: Edit) -> list[Path]:
    """The files of an edit's further fields, whose paths are relative to the edit."""
    return [Path(arguments.edit).parent / one.file for one in edit.further_field]


def _acting_twice(edit: Edit, folder: Path, own: Path, others: list[Path]) -> Iterator[str]:
    """Warnings of fields that add up at one place although they are the same field, or the force and the wind of one take.

    Args:
        folder: that of the edit.
        own: file of the take's field; `others`: those of the further ones.
    """
    from ..recovery.wind.stage import FIELD

    further = [f"further field {number} ({one.name or one.file})" for number, one in enumerate(edit.further_field, start=1)]
    places = [edit.field_place, *(one.place for one in edit.further_field)]
    seen: dict[tuple[str, str | Path], str] = {}
    for called, file, place in zip(("the take's own field", *further), (own, *others), places, strict=True):
        stands, whole = "" if place is None else stamp_of(folder / place), file.resolve()
        same, take = (stands, stamp_of(file)), (stands, whole.parent if file.name in (FORCE, FIELD) else whole)
        if same in seen:
            yield f"The same field acts twice at one place, as {seen[same]} and {called}. Leave one out, or move it."
        elif take in seen:
            together = f"The force and the wind of one take act together, as {seen[take]} and {called}"
            yield f"{together}, although the wind causes the force. Leave one out."
        seen |= {same: called, take: called}


def _mover(edit: Edit, force: ForceField, wind: ForceField | None) -> ForceField:
    """The field that moves the bodies of an edit. Raises UsageError if the edit asks for a wind and the take has none."""
    if edit.field == "wind" and wind is None:
        raise UsageError("The take has no wind.", "Recover it with --field wind, or leave field out of the edit.")
    return force if wind is None or edit.field == "force" else wind
