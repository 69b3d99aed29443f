"""The material of a body in a trajectory file: from the file, from options, and from assumptions where neither states it."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np

from ...errors import MaterialError, UsageError
from ...materials import Material, adjust, find
from .file import NUMBERS, as_stated, number_in

DENSITY, POISSON_RATIO = 300.0, 0.3
"""Density [kg/m³] and Poisson's ratio of a body whose file does not state them: those of foam. Young's modulus has no such default, as
forces that bend a body are proportional to it."""
STAND_IN = 1e5
"""Placeholder for Young's modulus [Pa] until the one from an option replaces it."""
UNIAXIAL = math.sqrt(1.5)
"""Ratio of the yield stress in `Material` to that in a file."""
KEYS = {**NUMBERS, "yield_stress": "yield_stress"}
"""Properties of `Material` -> keys of the file."""
BEHAVIOURS = ("elastic", "elastoplastic")
"""Words that simulators write as `material` but that are not materials; whether there is a `yield_stress` determines the law."""


def material_of(
    values: dict[str, np.ndarray], preset: Material | None, properties: dict[str, Any], path: str | os.PathLike[str]
) -> tuple[Material, list[str]]:
    """The material that options and file state, with foam-like numbers for what both leave out, and notes on what is assumed or not used.

    Simulators that write such files (Genesis, taichi_elements) yield at a norm |dev tau| = Y of the deviatoric stress; the uniaxial
    yield stress, which is used in `Material` and in the literature, is sqrt(3/2) times Y.
    """
    stated: dict[str, Any] = {name: number_in(values[key], key, path) for name, key in NUMBERS.items() if key in values}
    norm = number_in(values.get("yield_stress", np.zeros(())), "yield_stress", path)
    if norm < 0.0:
        raise MaterialError(as_stated("yield_stress", norm, path), "It must not be negative; zero is an elastic body.")
    yield_stress = UNIAXIAL * norm
    if yield_stress != 0.0:
        stated["yield_stress"] = yield_stress
    if preset is not None:
        unused = [NUMBERS.get(name, name) for name in stated if properties.get(name) is None]
        notes = [f"The material {preset.name} replaces what the file says: {', '.join(unused)}."] if unused else []
        return adjust(preset, **properties), notes
    given = {name for name, value in properties.items() if value is not None}
    named = _library_material(values, path)
    if named is not None:
        return adjust(_of_file(path, named, {name: value for name, value in stated.items() if name not in given}), **properties), []
    if "youngs_modulus" not in given and "youngs_modulus" not in stated:
        raise MaterialError(
            f"{path} lacks E, Young's modulus in Pa, and no option gives it.",
            "The force on a body that bends is proportional to it: add E, or give --youngs-modulus or --material.",
        )
    law = "von_mises" if yield_stress > 0.0 else "corotated"
    guesses = {"density": DENSITY, "poisson_ratio": POISSON_RATIO}
    assumed = {name: value for name, value in guesses.items() if name not in given and name not in stated}
    sources = {"from the trajectory file": [name for name in stated if name not in given], "assumed": list(assumed)}
    source = "; ".join(f"{where}: {', '.join(names)}" for where, names in sources.items() if names)
    notes = []
    if assumed:
        missing = [f"{NUMBERS[name]} ({value:g}{' kg/m³' if name == 'density' else ''})" for name, value in assumed.items()]
        proportion = " Forces are proportional to the density." if "density" in assumed else ""
        notes.append(f"The file lacks {', '.join(missing)}, and no option gives it: assumed.{proportion}")
    # What an option says instead is checked as the option's.
    own = {name: value for name, value in stated.items() if name not in given or name == "yield_stress"}
    whole = Material("trajectories", law, **{**guesses, "youngs_modulus": STAND_IN, **own}, source=source)
    return adjust(_of_file(path, whole, {}), **properties), notes


def _of_file(path: str | os.PathLike[str], material: Material, stated: dict[str, Any]) -> Material:
    """The material with the file's numbers. Raises MaterialError with the file's name and, for a number out of range, its key."""
    try:
        return adjust(material, **stated)
    except MaterialError as error:
        if error.quantity not in KEYS:
            raise MaterialError(f"{path}: {error.message}", error.hint) from error
        value = stated.get(error.quantity, getattr(material, error.quantity))
        norm = value / UNIAXIAL if error.quantity == "yield_stress" else value
        raise MaterialError(as_stated(KEYS[error.quantity], norm, path), error.hint) from error


def _library_material(values: dict[str, np.ndarray], path: str | os.PathLike[str]) -> Material | None:
    """The library's material that the file names; None if it names none, or one of `BEHAVIOURS`.

    Raises:
        MaterialError: the library does not have that name.
    """
    if "material" not in values:
        return None
    name = values["material"]
    if name.dtype.kind != "U" or name.size != 1:
        raise UsageError(f"{path}: material is {name.dtype} of shape {name.shape}.", "Write the name of one material, or leave it out.")
    if str(name.item()).strip().lower() in BEHAVIOURS:
        return None
    try:
        return find(str(name.item()))
    except MaterialError as error:
        hint = f"{error.hint} Or write {' or '.join(BEHAVIOURS)}, with E and rho."
        raise MaterialError(f"{path}: {error.message}", hint) from error
