"""`recover-trajectories` of a sheet: a file whose points are the vertices of a mesh."""

from __future__ import annotations

import argparse
import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...conventions import in_units
from ...errors import MaterialError, ObjectError, UsageError
from ...materials import MODULI, PLASTIC_LAWS, SHEETS, Material, Sheet, find
from ...progress import Journal, Progress
from ...reading import array_names
from ...records import Outcome
from ...settings import RecoverSettings, WindSettings
from ...stages import check_sheet
from ...take import Take, stamp_of
from ..arguments import properties_of, settings_of
from ..inputs import inputs_of, note_truth, refuse_of_another
from ..lock import held
from ..reporting import report_result
from .file import SHEET_KEYS, as_stated, gravity_of, motion_of, number_in, size_note, values_of

if TYPE_CHECKING:
    from ...recovery.wind.sheet import SheetSeen

READ = ("x", "fps", "E", "nu", "fixed", "gravity", "visible", "sigma", *SHEET_KEYS)
"""Keys that are read from a file."""
POISSON_RATIO = 0.3
"""Poisson's ratio of a sheet whose file does not state it."""


def is_sheet(path: str | os.PathLike[str]) -> bool:
    """Whether the points of a trajectory file are the vertices of a sheet. A file that cannot be read is reported when it is read."""
    try:
        return Path(path).is_file() and "faces" in array_names(path)
    except (OSError, ValueError):
        return False


def recover_sheet(arguments: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """`recover-trajectories TRUTH.npz --take DIR` for a sheet.

    Raises:
        UsageError, ObjectError, MaterialError, SimulationError: as `check_recovery_of_sheet` and `sheet_stage`.
    """
    from ...recovery.diagnostics.remarks import worst_first
    from ...recovery.wind.sheet import sheet_stage

    source, settings, notes = check_recovery_of_sheet(arguments)
    blown, take = settings_of(WindSettings, arguments), Take(arguments.take)
    with held(take, arguments.verb, progress, inputs_of(arguments)):
        for note in notes:
            progress.warn(note)
        upstream = stamp_of("trajectories", Path(arguments.truth), source)
        found = sheet_stage(take, source, upstream, settings, blown, progress)
        note_truth(take, upstream, arguments.truth)
        recovery = dataclasses.replace(found.recovery, notes=worst_first([*notes, *found.wind.notes, *found.recovery.notes]))
        assert recovery.outcome != Outcome.DIVERGED

        def draw(_: Journal) -> dict[str, Any]:
            from ...look.report import write_trajectory_report

            told = found.wind.told if found.wind.field is not None or arguments.field == "auto" else None
            return write_trajectory_report(
                take, found.particles, source.sheet.as_solid("sheet"), recovery, found.field, found.seconds, settings, progress,
                arguments.report, told,
            )  # fmt: skip

        return report_result(take, recovery, arguments.report, "", draw, progress)


def check_recovery_of_sheet(arguments: argparse.Namespace) -> tuple[SheetSeen, RecoverSettings, list[str]]:
    """What the file and the options say of a sheet and of its recovery, and notes as of `read_sheet`.

    Raises:
        UsageError, ObjectError, MaterialError: as `read_sheet`, `check_sheet` and `refuse_of_another`.
    """
    preset = find(arguments.material) if arguments.material else None
    source, gravity, notes = read_sheet(arguments.truth, preset, arguments.gravity, **properties_of(arguments))
    settings = settings_of(RecoverSettings, arguments, gravity=gravity)
    check_sheet(settings)
    refuse_of_another(Take(arguments.take), arguments.truth)
    return source, settings, notes


def read_sheet(
    path: str | os.PathLike[str], material: Material | None = None, gravity: list[float] | None = None, **properties: Any
) -> tuple[SheetSeen, tuple[float, float, float], list[str]]:
    """Read an NPZ with `x` (T+1,V,3) m, `fps`, `faces` (F,3), and the sheet's `areal_density` kg/m², `thickness` m and `E` Pa.

    Optional are `nu`, `damping` (loss factor), `fixed` (V,) bool, `gravity` (3,) m/s² and `sigma` m, the standard deviation of a
    coordinate.

    Args:
        material: a sheet of the library, which replaces all that the file states about the material.
        gravity: [m/s²], replaces the file's.
        properties: arguments of `materials.adjust`, which replace those of the file; None replaces nothing.

    Returns:
        The sheet as seen, gravity, and notes on what was assumed or not used.

    Raises:
        UsageError: a key is missing, out of bounds, or has the wrong type or shape; the faces are not those of a mesh.
        ObjectError: too few frames, vertices that are not visible or not finite, or nothing that is free to move.
        MaterialError: numbers that no sheet has.
    """
    from ...recovery.wind.sheet import SheetSeen

    values, notes = values_of(path, READ)
    x, visible, fixed, fps = motion_of(values, path)
    if not visible.all():
        t, v = np.argwhere(~visible)[0]
        hint = "A shell needs every vertex in every frame: fill the gaps."
        raise ObjectError(f"{path}: vertex {v} is not visible in frame {t}.", hint)
    if fixed.all():
        raise ObjectError(f"{path}: every vertex is fixed: nothing can move.", "Mark fewer as fixed.")
    faces = _faces(values["faces"], x.shape[1], path)
    sigma = None
    if "sigma" in values:
        sigma = number_in(values["sigma"], "sigma", path)
        if not 0.0 <= sigma <= float(np.ptp(x)):
            raise UsageError(f"{path}: sigma is {sigma:g}.", "It must lie between 0 and what x reaches; without it, it is estimated.")
    sheet, assumed = _sheet(values, material, properties, path)
    down, missing = gravity_of(values, gravity, path)
    return SheetSeen(x, faces, fixed, sheet, fps, sigma), down, [*size_note(x[0]), *assumed, *missing, *notes]


def _faces(value: np.ndarray, count: int, path: str | os.PathLike[str]) -> np.ndarray:
    """Check and return the faces (F, 3) of a mesh of `count` vertices."""
    if value.ndim != 2 or value.shape[1:] != (3,) or not len(value) or value.dtype.kind not in "iu":
        raise UsageError(f"{path}: faces is {value.dtype} of shape {value.shape}.", "It must be triangles, (F,3) whole numbers.")
    faces = value.astype(np.int64)
    if faces.min() < 0 or faces.max() >= count:
        wrong = int(faces.max()) if faces.max() >= count else int(faces.min())
        raise UsageError(f"{path}: faces names vertex {wrong}, but there are {count}.", f"Vertices are numbered 0 to {count - 1}.")
    same = len(faces) - len(np.unique(np.sort(faces, axis=1), axis=0))
    if same:
        raise UsageError(f"{path}: {same} of the faces are there twice.", "Give every triangle once: a sheet has one layer.")
    return faces


def _sheet(
    values: dict[str, np.ndarray], material: Material | None, properties: dict[str, Any], path: str | os.PathLike[str]
) -> tuple[Sheet, list[str]]:
    """The sheet that the file and the options state, and notes on what is assumed or not used."""
    given = {name: value for name, value in properties.items() if value is not None}
    if given.get("law") in PLASTIC_LAWS or "yield_stress" in given or "viscosity" in given:
        raise UsageError("A sheet is elastic: it has no plastic law.", "Leave --law, --yield-stress and --viscosity out.")
    notes = []
    if material is not None:
        if material.name not in SHEETS:
            raise MaterialError(f"{material.name} is not known as a sheet.", f"Give one of {', '.join(sorted(SHEETS))}.")
        sheet = SHEETS[material.name]
        unused = [key for key in ("areal_density", "thickness", "E", "nu", "damping") if key in values]
        if unused:
            notes.append(f"The material {material.name} replaces what the file says: {', '.join(unused)}.")
    else:
        missing = [key for key in ("areal_density", "thickness", "E") if key not in values]
        if "E" in missing and "youngs_modulus" in given:
            missing.remove("E")
        if missing:
            needed = "A shell needs areal_density in kg/m², thickness in m and E, in Pa, or --material with a sheet's name."
            raise UsageError(f"{path} has faces but lacks {', '.join(missing)}.", needed)
        read = {key: number_in(values[key], key, path) for key in ("areal_density", "thickness", "E") if key in values}
        for key, value in read.items():
            if value <= 0.0 or (key == "E" and value > MODULI[1]):
                most = f" and at most {in_units(MODULI[1], 'Pa')}" if key == "E" else ""
                raise MaterialError(as_stated(key, value, path), f"Give a number above zero{most}.")
        areal, thickness = read["areal_density"], read["thickness"]
        modulus = read["E"] if "E" in read else given["youngs_modulus"]
        nu = number_in(values["nu"], "nu", path) if "nu" in values else POISSON_RATIO
        loss = number_in(values["damping"], "damping", path) if "damping" in values else 0.0
        try:
            sheet = Sheet(areal, thickness, modulus * thickness, modulus * thickness**3 / 12.0, loss, nu, "from the file")
        except MaterialError as error:
            wrong = {"poisson_ratio": ("nu", nu), "loss_factor": ("damping", loss)}.get(error.quantity)
            raise MaterialError(as_stated(*wrong, path) if wrong else f"{path}: {error.message}", error.hint) from error
        if "nu" not in values and "poisson_ratio" not in given:
            notes.append(f"The file lacks nu ({POISSON_RATIO:g}), and no option gives it: assumed.")
    own = sheet.with_own(given.get("density"), given.get("youngs_modulus"), given.get("poisson_ratio"))
    return dataclasses.replace(own, loss_factor=given.get("loss_factor", own.loss_factor)), notes
