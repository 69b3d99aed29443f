"""The library of materials and the user's own numbers."""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from seeing_wind.engine import materials as room
from seeing_wind.engine.errors import MaterialError
from seeing_wind.engine.materials import DEFAULT, LAWS, MATERIALS, PLASTIC_LAWS, adjust, find

LIBRARY = Path(room.__file__).with_name("materials.toml")


def test_library_is_complete_and_physical() -> None:
    assert len(MATERIALS) >= 40
    assert DEFAULT in MATERIALS
    for name, material in MATERIALS.items():
        assert material.name == name
        assert material.law in LAWS
        assert material.source, name
        assert 10.0 <= material.density <= 2e4, name
        assert 1e3 <= material.youngs_modulus <= 1e12, name
        assert -1.0 < material.poisson_ratio < 0.5, name
        assert (material.yield_stress > 0.0) == (material.law in PLASTIC_LAWS), name
        assert (material.viscosity > 0.0) == (material.law == "viscoplastic"), name


def test_every_number_says_where_it_is_from() -> None:
    tables = tomllib.loads(LIBRARY.read_text(encoding="utf-8"))
    references = tables.pop("references")
    tables |= {f"{name}.sheet": values.pop("sheet") for name, values in tables.items() if "sheet" in values}
    for name, values in tables.items():
        numbers = {key for key, value in values.items() if isinstance(value, float)}
        assert set(values["source"]) == numbers, name
        for key, source in values["source"].items():
            full = source.format_map(references)
            follows = full.startswith(("density times", "Young's modulus times", "as the density", "printing paper, by definition"))
            assert full.startswith("estimate") or follows or re.search(r"\d{4}|\.com|\.org|data sheet|Handbook", full), (name, key)
    used = {key for values in tables.values() for source in values["source"].values() for key in re.findall(r"{(\w+)}", source)}
    assert used == set(references)


def test_source_is_one_line_that_names_properties_together() -> None:
    assert MATERIALS["marble"].source == "density and youngs modulus and poisson ratio: MakeItFrom material properties (makeitfrom.com)"
    assert "estimate" in MATERIALS["dough"].source and "\n" not in MATERIALS["dough"].source


def test_order_of_known_stiffness() -> None:
    stiffness = [MATERIALS[name].youngs_modulus for name in ("jelly", "rubber", "wood", "steel")]
    assert stiffness == sorted(stiffness)
    assert MATERIALS["steel"].density == pytest.approx(7850.0)


def test_find_ignores_case_and_spaces() -> None:
    assert find("Plant Stem") is MATERIALS["plant_stem"]
    assert find("flag-nylon") is MATERIALS["flag_nylon"]


def test_unknown_material_names_the_nearest() -> None:
    with pytest.raises(MaterialError, match="cotton") as caught:
        find("cotten")
    assert caught.value.exit_code == 2
    with pytest.raises(MaterialError, match="leaf"):
        find("xqzw")


def test_adjust_replaces_and_records() -> None:
    leaf = adjust(find("leaf"), density=500.0, youngs_modulus=1e5)
    assert (leaf.density, leaf.youngs_modulus, leaf.poisson_ratio) == (500.0, 1e5, find("leaf").poisson_ratio)
    assert "density, youngs_modulus" in leaf.source
    assert adjust(find("leaf")) == find("leaf")
    assert adjust(replace(find("leaf"), source=""), density=500.0).source == "given by the user: density"


@pytest.mark.parametrize(
    "change",
    [
        {"density": 0.0},
        {"density": -3.0},
        {"density": math.nan},
        {"youngs_modulus": 0.0},
        {"youngs_modulus": math.inf},
        {"poisson_ratio": 0.5},
        {"poisson_ratio": -1.0},
        {"poisson_ratio": math.nan},
        {"yield_stress": -1.0},
        {"viscosity": -1.0},
        {"law": "jelly"},
        {"law": "von_mises"},
        {"density": "heavy"},
        {"yield_stress": 300.0},
    ],
)
def test_unphysical_numbers_are_refused(change: dict) -> None:
    with pytest.raises(MaterialError) as caught:
        adjust(find("leaf"), **change)
    assert caught.value.hint


def test_a_plastic_material_may_be_taken_for_elastic() -> None:
    assert adjust(find("clay"), law="corotated").law == "corotated"


def test_a_plastic_law_with_its_yield_stress_is_fine() -> None:
    assert adjust(find("leaf"), law="von_mises", yield_stress=1e4).law == "von_mises"
