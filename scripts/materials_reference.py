"""docs/reference/materials.md from the material library: every material and every sheet, each number with its source.

    python scripts/materials_reference.py            writes the page
    python scripts/materials_reference.py --check    exits with 1 where it is not up to date
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from seeing_wind.engine.materials import LOSS_FREQUENCY, MATERIALS, SHEETS  # noqa: E402

PAGE = ROOT / "docs" / "reference" / "materials.md"
HEAD = f"""# Materials

Written by `make references` from the material library, and by a test held to it: change `seeing_wind/engine/materials.toml` instead.

`--material NAME`, *Material* in the panel and `material = "NAME"` in an edit take one of these {len(MATERIALS)} names. Natural materials
differ from these numbers by a factor of two and more, so a number that you have measured is always better: `--density`,
`--youngs-modulus` and the other options of [the command line](cli.md#recover) replace one, and so do the keys of [an edit](edit.md).

## Solids

The law `neo_hookean` springs back from large strains, `corotated` from small ones; `von_mises` keeps dents, and `viscoplastic` flows
slowly under load. The loss factor is the energy lost per radian of oscillation over the energy stored, at {LOSS_FREQUENCY:g} Hz;
a dash means that no value is known.
"""
SHEET_HEAD = """## Sheets

These materials also come as a thin sheet. An inserted mesh that is open and made of one of them moves as [a shell](shells.md).
"""
SOURCE_HEAD = """## Where the numbers come from

*Estimate* means that the number was chosen by analogy with a similar material. A source marked with * was cited without access to it: its
range is commonly quoted.
"""


def page() -> str:
    """The whole page."""
    solids = [
        (
            one.name, one.law, _number(one.density), _number(one.youngs_modulus), f"{one.poisson_ratio:g}", _number(one.yield_stress),
            _number(one.viscosity), _number(one.loss_factor),
        )
        for one in MATERIALS.values()
    ]  # fmt: skip
    sheets = [
        (
            name, _number(one.areal_density), _number(one.thickness), _number(one.tensile_stiffness), _number(one.bending_stiffness),
            _number(one.loss_factor),
        )
        for name, one in SHEETS.items()
    ]  # fmt: skip
    sources = [(name, one.source) for name, one in MATERIALS.items()]
    sources += [(f"{name}, as a sheet", one.source) for name, one in SHEETS.items()]
    columns = ("material", "law", "density [kg/m³]", "Young's modulus [Pa]", "Poisson's ratio", "yield stress [Pa]", "viscosity [Pa s]")
    thin = ("areal density [kg/m²]", "thickness [m]", "tensile stiffness [N/m]", "bending stiffness [N m]")
    return "\n".join(
        [
            HEAD, _table((*columns, "loss factor"), solids),
            SHEET_HEAD, _table(("material", *thin, "loss factor"), sheets),
            SOURCE_HEAD, _table(("material", "sources"), sources),
        ]
    )  # fmt: skip


def _number(value: float) -> str:
    """A number as the page prints it; a dash for a zero, which stands for "none"."""
    return f"{value:g}" if value else "-"


def _table(columns: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [columns, tuple("---" for _ in columns), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|").replace("*", "\\*") for cell in line) + " |" for line in lines) + "\n"


def main() -> int:
    """Write or check the page; returns the exit code."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--check", action="store_true", help="only say by the exit code whether the page is up to date")
    text = page()
    if arguments.parse_args().check:
        return int(not PAGE.is_file() or PAGE.read_text(encoding="utf-8") != text)
    PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
