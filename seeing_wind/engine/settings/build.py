"""Settings of the stage *build*: from an observation to a body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ..errors import MaterialError
from ..materials import DEFAULT, LAWS, PLASTIC_LAWS, SHEETS, Material, Sheet, adjust, find
from .option import option
from .recover import seed_option

MADE = "what it is made of"
BODY = "how its body is built"

SHEET_VERTICES = 350
"""Vertices of a thin sheet: on a flag of 0.6 m by 0.4 m they are 3 cm apart."""

PARTICLES, FLOWING_PARTICLES = 600, 1800
"""Particles of a body, and of one that flows. Near its yield stress a body flows 15 % less under a load that is 4 % too small: with a ball
of 600 particles the recovered forces were 17 % off, with 1800 particles 8 %."""

LAW_TEXTS = dict(zip(LAWS, (
    "springs back, even from large strains", "springs back from small strains; for stiff things", "keeps dents whatever the speed",
    "flows slowly under load",
), strict=True))  # fmt: skip


FORM_TEXTS = {
    "auto": "a thin sheet where the material is cloth and the object large enough to hang in folds, else a solid",
    "solid": "a body with a thickness, filled with material points",
    "sheet": "one layer without thickness that bends and hardly stretches, with the material's weight per area",
}


def material_options(panel: str) -> dict[str, Any]:
    """Options for the numbers of a material, by name: the same for the object of a clip and for a body of an edit.

    Args:
        panel: `Option.panel` of the less usual ones: the law, Poisson's ratio, and the numbers of plastic laws.
    """
    shared = {"group": MADE, "otherwise": "the material's"}
    return {
        "law": option(None, label="Behaves As", help="constitutive law", choices=LAW_TEXTS, panel=panel, **shared),
        "density": option(
            None, help="mass per volume", unit="kg/m³", above=0.0, metavar="R", panel="main", start=1000.0, typical=(None, 20000.0),
            **shared,
        ),
        "youngs_modulus": option(
            None, label="Stiffness", help="Young's modulus", unit="Pa", above=0.0, metavar="E", panel="main", start=1e5,
            typical=(None, 1e10), digits=0, **shared,
        ),
        "poisson_ratio": option(
            None, label="Poisson's Ratio", help="how much it narrows when stretched: 0 cork, 0.3 most things, 0.49 rubber", above=-1.0,
            below=0.5, metavar="NU", panel=panel, start=0.3, typical=(0.0, 0.495), digits=3, **shared,
        ),
        "yield_stress": option(
            None, help="stress beyond which it keeps its new shape", unit="Pa", minimum=0.0, metavar="Y", panel=panel, start=1e4,
            typical=(None, 1e9), digits=0, **shared,
        ),
        "viscosity": option(
            None, help="how slowly it flows under load", unit="Pa s", minimum=0.0, metavar="ETA", panel=panel, start=100.0,
            typical=(None, 1e8), **shared,
        ),
    }  # fmt: skip


OF_THE_OBJECT = material_options("more")


def part_option(part: str, which: str) -> Any:
    """The option for the material of a part of a body on a stem; `which`: what that part is."""
    return option(
        None, label=f"{part.title()} Material", help=f"a preset of the material library for {which}", metavar="NAME", group=BODY,
        panel="main", otherwise="as the stem, by --material",
    )  # fmt: skip


@dataclass(frozen=True)
class BuildSettings:
    """From an observation to a body."""

    material: str = option(DEFAULT, help="a preset of the material library", metavar="NAME", group=MADE, panel="main")
    law: str | None = OF_THE_OBJECT["law"]
    density: float | None = OF_THE_OBJECT["density"]
    youngs_modulus: float | None = OF_THE_OBJECT["youngs_modulus"]
    poisson_ratio: float | None = OF_THE_OBJECT["poisson_ratio"]
    yield_stress: float | None = OF_THE_OBJECT["yield_stress"]
    viscosity: float | None = OF_THE_OBJECT["viscosity"]
    estimated_material: str | None = None
    """Name of the material by a vision-language model, if the numbers above come from it; `estimated_by` names the object and the model."""
    estimated_by: str | None = None
    head_material: str | None = part_option("head", "what a stem carries")
    leaf_material: str | None = part_option("leaf", "the leaves beside a stem")
    form: str = option(
        "auto", label="Built As", help="what kind of body it is built as", group=BODY, panel="main", choices=FORM_TEXTS,
        titles={"sheet": "Thin Sheet"},
    )  # fmt: skip
    thickness: float | None = option(
        None, help="depth of the body behind the visible surface", unit="m", minimum=1e-6, metavar="M", group=BODY, panel="main",
        start=0.01, typical=(None, 1.0), digits=5,
        otherwise="read from the sides that a measured depth shows, or guessed from the silhouette",
    )  # fmt: skip
    particles: int | None = option(
        None, minimum=8, maximum=100_000,
        help="about how many particles make up the body: more resolve finer bends and take longer; a body on a stem gets as many as "
        "its stem needs",
        metavar="N", group=BODY, unset=0, typical=(None, 5000),
        otherwise=f"{PARTICLES}, {FLOWING_PARTICLES} where the material flows, {SHEET_VERTICES} of a thin sheet",
    )  # fmt: skip
    seed: int = seed_option()


def material_of(settings: BuildSettings) -> Material:
    """The material of the body.

    Raises:
        MaterialError: an unknown material, or numbers that are not physical.
    """
    material = adjust(
        find(settings.material),
        law=settings.law,
        density=settings.density,
        youngs_modulus=settings.youngs_modulus,
        poisson_ratio=settings.poisson_ratio,
        yield_stress=settings.yield_stress,
        viscosity=settings.viscosity,
    )
    if settings.estimated_material is None:
        return material
    return replace(material, name=settings.estimated_material, source=f"estimated for {settings.estimated_by}")


@dataclass(frozen=True)
class PartMaterials:
    """The materials of a body on a stem."""

    stem: Material
    head: Material
    leaves: Material

    @property
    def alike(self) -> bool:
        """Whether all parts have the stem's material."""
        return self.head is self.stem and self.leaves is self.stem


def part_materials(settings: BuildSettings) -> PartMaterials:
    """The materials of the parts, if the body turns out to have parts.

    Raises:
        MaterialError: as `material_of`; or a part has a material of its own, and that or the stem's flows.
    """
    stem = material_of(settings)
    own = {flag: find(name) for flag, name in (("--head-material", settings.head_material), ("--leaf-material", settings.leaf_material))
           if name is not None}  # fmt: skip
    for flag, material in own.items():
        for one in (material, stem):
            if one.law in PLASTIC_LAWS:
                raise MaterialError(
                    f"{flag} {material.name} cannot be used: {one.name} has the plastic law {one.law}, and a body of several materials "
                    "must be elastic.",
                    f"Give an elastic material, or leave {flag} out.",
                )
    return PartMaterials(stem, own.get("--head-material", stem), own.get("--leaf-material", stem))


def may_be_sheet(settings: BuildSettings) -> bool:
    """Whether the body may become a thin sheet: if asked for, or by its material if the object is large enough. Raises as `material_of`."""
    if settings.form != "auto":
        return settings.form == "sheet"
    known = SHEETS.get(find(settings.material).name)
    return known is not None and known.woven and material_of(settings).law not in PLASTIC_LAWS


def sheet_of(settings: BuildSettings) -> Sheet | None:
    """The thin sheet that the body may become, see `may_be_sheet`; None for a solid.

    Raises:
        MaterialError: as `material_of`; or a sheet is asked for, and its material is not known as a sheet, or flows.
    """
    if not may_be_sheet(settings):
        return None
    material, known = material_of(settings), SHEETS.get(find(settings.material).name)
    if known is None:
        raise MaterialError(f"{material.name} is not known as a sheet.", f"Give one of {', '.join(sorted(SHEETS))}, or --form solid.")
    if material.law in PLASTIC_LAWS:
        raise MaterialError("A sheet is elastic: it has no plastic law.", "Leave --law out, or give --form solid.")
    return known.with_own(settings.density, settings.youngs_modulus, settings.poisson_ratio, settings.thickness)
