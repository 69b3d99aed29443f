"""The library of materials (`materials.toml`) and how a user's own numbers replace the library's.

It replaces the commonsense properties {m, E, nu} that the paper gets from a vision-language model (arXiv 2512.00762, section 3.1).
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .conventions import constant, in_units, lame
from .errors import MaterialError

LAWS = ("neo_hookean", "corotated", "von_mises", "viscoplastic")
"""Constitutive laws of the simulator."""

PLASTIC_LAWS = ("von_mises", "viscoplastic")
"""Laws that need a yield stress."""

MODULI = (1e-3, 1e13)
"""Lowest and highest Young's modulus [Pa]: diamond has 1.2e12, the softest gel about one."""

DENSITIES = (1e-3, 1e5)
"""Lowest and highest density [kg/m³]: osmium has 2.3e4, the lightest aerogel 0.2."""

RANGES = {
    "density": ("The density", "kg/m³", DENSITIES),
    "youngs_modulus": ("Young's modulus", "Pa", MODULI),
    "yield_stress": ("The yield stress", "Pa", (0.0, MODULI[1])),
    "viscosity": ("The viscosity", "Pa s", (0.0, MODULI[1])),
}
"""Properties of `Material` -> what a sentence calls them, unit, and the least and the most that they are."""

LOSS_FREQUENCY = 2.0
"""Frequency [Hz] at which a loss factor holds. Real loss factors hardly change with frequency, but that of a Kelvin-Voigt solid is
proportional to it: it is right for what sways about twice a second, as stems, branches and flags in a clip do."""

MOST_LOSS = 2.0
"""Largest loss factor, that of critical damping: the body no longer swings."""

DEFAULT = "leaf"
"""The material of an object for which none is given."""


@dataclass(frozen=True)
class SolverLimits:
    """Constants of the material point method."""

    cell_spacings: float = constant(
        1.6, "particle spacings", "Width of a grid cell.",
        "Against another simulator a plate of two particles ends 6.0 mm off at 2.0, the usual choice, 1.8 mm at 1.6 and 3.8 mm at 1.3, "
        "after 333 mm of travel.",
    )  # fmt: skip
    courant: float = constant(
        0.3, "cells", "How far an elastic wave may travel in a substep.", "Stable up to about 1; a margin of three."
    )
    flow_substeps: float = constant(
        3000.0, "1/s", "Least number of substeps for bodies that flow. With fewer they flow too far in one substep; but substeps beyond "
        "those that the waves need damp the flow, and without limit, as each passes the motion through the grid once more.",
        "Development scenes, docs/notebook/solver.md.",
    )  # fmt: skip
    viscous_courant: float = constant(
        0.48, "cells", "Largest value of (cells that a wave crosses in a substep) sqrt(1 + 2 tau / dt) for a damped body.",
        "Shaken and bent bars break down from 1.05 on (Poisson's ratio 0.3) or 0.95 on (0.45). A recovery's rough model, with half the "
        "substeps, is at twice this; carried changes (`tangent`) of a free leaf were lost at 0.9.",
    )  # fmt: skip
    min_substeps: int = constant(8, "per frame", "Least number of substeps, whatever the material.", "Cost: they are cheap.")
    max_substeps: int = constant(
        200, "per frame", "Most substeps of a free body; a stiffer one is softened, and hardly moves differently.", "Cost of a recovery."
    )
    max_substeps_held: int = constant(
        500, "per frame", "Most substeps of a held body. Its stiffness determines how far a force bends it, so a softened body means a "
        "weaker force.", "Cost of a recovery.",
    )  # fmt: skip
    worth: float = constant(
        0.1, "1", "Least share of a held body's stiffness that must remain with the most substeps. With less, the force only balances its "
        "weight and inertia, as that of a free body does, and it gets no more substeps than a free one.", "Chosen.",
    )  # fmt: skip
    default_speed: float = constant(5.0, "m/s", "Fastest motion expected when nothing better is known.", "Chosen.")


LIMITS = SolverLimits()


@dataclass(frozen=True)
class Material:
    """A material, with the sources of its numbers."""

    name: str
    law: str
    """neo_hookean, corotated, von_mises or viscoplastic."""
    density: float
    """kg/m³."""
    youngs_modulus: float
    """Pa."""
    poisson_ratio: float
    yield_stress: float = 0.0
    """Pa; plastic laws only."""
    viscosity: float = 0.0
    """Pa s; viscoplastic only."""
    source: str = ""
    loss_factor: float = 0.0
    """Elastic laws only: energy lost per radian of oscillation over the energy stored, at `LOSS_FREQUENCY`. Zero where it is unknown,
    which leaves only the solver's numerical damping."""

    @property
    def retardation(self) -> float:
        """Retardation time tau [s], by which the strain of a Kelvin-Voigt solid lags behind the stress: a mode at the frequency f has the
        loss factor 2 pi f tau, and half of that as its damping ratio."""
        return 0.0 if self.law in PLASTIC_LAWS else self.loss_factor / (2.0 * math.pi * LOSS_FREQUENCY)


@dataclass(frozen=True)
class Sheet:
    """A thin sheet, homogeneous and isotropic, with the sources of its numbers."""

    areal_density: float
    """kg/m²."""
    thickness: float
    """m."""
    tensile_stiffness: float
    """N/m: force per width over strain of a strip, Young's modulus times thickness."""
    bending_stiffness: float
    """N m: moment per width over curvature of a strip."""
    loss_factor: float = 0.0
    """As in `Material`, for stretching and bending; a fabric's own, because its threads rub."""
    poisson_ratio: float = 0.3
    source: str = ""
    woven: bool = False
    """Whether it is cloth, not a leaf, paper or film."""

    def __post_init__(self) -> None:
        """MaterialError: a number that is not physical."""
        for key, unit in SHEET_UNITS.items():
            value, what = getattr(self, key), key.replace("_", " ")
            if not (math.isfinite(value) and value > 0.0):
                raise MaterialError(f"The {what} of a sheet is {in_units(value, unit)}.", "Give a finite number above zero.")
        if not 0.0 <= self.loss_factor <= MOST_LOSS:
            said = f"The loss factor of a sheet is {self.loss_factor:g}."
            raise MaterialError(said, f"Give from zero to {MOST_LOSS:g}.", quantity="loss_factor")
        if not 0.0 <= self.poisson_ratio < 0.5:
            said = f"Poisson's ratio of a sheet is {self.poisson_ratio:g}."
            raise MaterialError(said, "Give one from 0 to below 0.5.", quantity="poisson_ratio")

    @property
    def bending_length(self) -> float:
        """Length [m] over which the sheet's own weight bends it: (B / (m'' g))^(1/3), Peirce (The Handle of Cloth, J. Text. Inst. 1930)."""
        return (self.bending_stiffness / (self.areal_density * 9.81)) ** (1.0 / 3.0)

    def with_own(
        self, density: float | None, youngs_modulus: float | None, poisson_ratio: float | None, thickness: float | None = None
    ) -> Sheet:
        """The sheet with the user's own numbers, in SI units; None keeps the sheet's. Density times thickness is the areal density, and
        Young's modulus gives both stiffnesses, as for a homogeneous plate.

        Raises:
            MaterialError: numbers that are not physical.
        """
        h = self.thickness if thickness is None else thickness
        changes: dict[str, Any] = {"thickness": h} | ({} if poisson_ratio is None else {"poisson_ratio": max(poisson_ratio, 0.0)})
        if density is not None:
            changes["areal_density"] = density * h
        if youngs_modulus is not None:
            changes |= {"tensile_stiffness": youngs_modulus * h, "bending_stiffness": youngs_modulus * h**3 / 12.0}
        return dataclasses.replace(self, **changes)

    def as_solid(self, name: str) -> Material:
        """The material of the sheet, as if it were homogeneous through its thickness: for quantities per volume."""
        return Material(
            name, "corotated", density=self.areal_density / self.thickness, youngs_modulus=self.tensile_stiffness / self.thickness,
            poisson_ratio=self.poisson_ratio, loss_factor=self.loss_factor, source=self.source,
        )  # fmt: skip

    @property
    def retardation(self) -> float:
        """Retardation time [s], as in `Material`."""
        return self.loss_factor / (2.0 * math.pi * LOSS_FREQUENCY)


SHEET_UNITS = {"areal_density": "kg/m²", "thickness": "m", "tensile_stiffness": "N/m", "bending_stiffness": "N m"}
"""Properties of a sheet that must be above zero, and their units."""


def substeps_needed(material: Material, dx: float, frame_dt: float, density: float = 1.0) -> int:
    """Substeps in a frame of `frame_dt` [s] that the waves of a material need on a grid of spacing dx [m].

    They must satisfy dt <= `LIMITS.courant` dx / c with c² = (lam + 2 mu) / rho. density: factor on the material's.
    """
    mu, lam = lame(material.youngs_modulus, material.poisson_ratio)
    return math.ceil(math.sqrt((lam + 2.0 * mu) / (material.density * density)) * frame_dt / (LIMITS.courant * dx))


def find(name: str) -> Material:
    """The library's material `name`; case, spaces and hyphens do not matter.

    Raises:
        MaterialError: no such material; the message names the nearest ones.
    """
    key = name.strip().lower().replace(" ", "_").replace("-", "_")
    if key in MATERIALS:
        return MATERIALS[key]
    near = difflib.get_close_matches(key, MATERIALS, n=3, cutoff=0.5) or [other for other in MATERIALS if key and key in other][:3]
    hint = f"Did you mean {' or '.join(near)}?" if near else f"Known materials: {', '.join(sorted(MATERIALS))}."
    raise MaterialError(f"There is no material '{name}'.", hint)


def adjust(
    material: Material,
    *,
    law: str | None = None,
    density: float | None = None,
    youngs_modulus: float | None = None,
    poisson_ratio: float | None = None,
    yield_stress: float | None = None,
    viscosity: float | None = None,
    loss_factor: float | None = None,
) -> Material:
    """`material` with the given properties replaced (None keeps the material's) and all properties checked.

    Args:
        law: one of `LAWS`; density: [kg/m³]; youngs_modulus, yield_stress: [Pa]; viscosity: [Pa s]; loss_factor: elastic laws only.

    Raises:
        MaterialError: an unknown law, a number that is not finite or out of its range, a plastic law without a yield stress, or an elastic
            law with one.
    """
    given = {"law": law, "density": density, "youngs_modulus": youngs_modulus, "poisson_ratio": poisson_ratio}
    given |= {"yield_stress": yield_stress, "viscosity": viscosity, "loss_factor": loss_factor}
    changes = {key: value if key == "law" else _number(key, value) for key, value in given.items() if value is not None}
    sources = [material.source, f"given by the user: {', '.join(changes)}" if changes else ""]
    result = dataclasses.replace(material, **changes, source="; ".join(filter(None, sources)))  # type: ignore[arg-type]
    _check(result)
    if changes.get("yield_stress") and result.law not in PLASTIC_LAWS:
        plastic = " or ".join(sorted(PLASTIC_LAWS))
        raise MaterialError(
            f"{material.name} has the elastic law {result.law}, which has no yield stress.",
            f"Leave the yield stress out, or give --law {plastic}.",
        )
    return result


def _number(key: str, value: object) -> float:
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError) as error:
        raise MaterialError(f"{key} is {value!r}, which is not a number.", "Give a number in SI units.") from error


def _check(material: Material) -> None:
    """Raise MaterialError unless every property is physical."""
    if material.law not in LAWS:
        raise MaterialError(f"There is no law '{material.law}'.", f"Known laws: {', '.join(LAWS)}.")
    for key in ("density", "youngs_modulus", "poisson_ratio", "yield_stress", "viscosity", "loss_factor"):
        if not math.isfinite(getattr(material, key)):
            raise MaterialError(f"{key} of {material.name} is not finite.", "Give a finite number in SI units.")
    for key, (what, unit, (least, most)) in RANGES.items():
        value = getattr(material, key)
        if not least <= value <= most:
            hint = f"Give one from {in_units(least, unit)} to {in_units(most, unit)}."
            raise MaterialError(f"{what} of {material.name} is {in_units(value, unit)}.", hint, quantity=key)
    if not -1.0 < material.poisson_ratio < 0.5:
        raise MaterialError(
            f"Poisson's ratio of {material.name} is {material.poisson_ratio:g}.",
            "It lies between -1 and 0.5, both excluded; use 0.48 for rubber and flesh.",
            quantity="poisson_ratio",
        )
    if not 0.0 <= material.loss_factor <= MOST_LOSS:
        raise MaterialError(f"The loss factor of {material.name} is {material.loss_factor:g}.", f"Give from zero to {MOST_LOSS:g}.")
    if material.law in PLASTIC_LAWS and material.yield_stress == 0.0:
        raise MaterialError(f"{material.name} has the plastic law {material.law} but no yield stress.", "Give a yield stress in Pa.")


def _read_library() -> tuple[dict[str, Material], dict[str, Sheet]]:
    tables = tomllib.loads(Path(__file__).with_name("materials.toml").read_text(encoding="utf-8"))
    references = tables.pop("references")
    materials, sheets = {}, {}
    for name, values in tables.items():
        sheet = values.pop("sheet", None)
        materials[name] = adjust(Material(name=name, **{**values, "source": _source(values["source"], references)}))
        if sheet is not None:
            sheet["source"] = _source(sheet["source"], references)
            sheets[name] = Sheet(poisson_ratio=materials[name].poisson_ratio, **sheet)
    return materials, sheets


def _source(sources: dict[str, str], references: dict[str, str]) -> str:
    """The sources of the properties as one line; properties with the same source are named together."""
    together: dict[str, list[str]] = {}
    for key, source in sources.items():
        together.setdefault(source.format_map(references), []).append(key.replace("_", " "))
    return "; ".join(f"{' and '.join(keys)}: {source}" for source, keys in together.items())


MATERIALS, SHEETS = _read_library()
"""All materials of the library by name, and the sheets of those that come as thin sheets."""
