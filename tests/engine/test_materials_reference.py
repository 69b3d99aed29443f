"""docs/reference/materials.md is what the material library says."""

from __future__ import annotations

import runpy
from pathlib import Path

from seeing_wind.engine.materials import MATERIALS, SHEETS

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_of_materials_is_up_to_date() -> None:
    script = runpy.run_path(str(ROOT / "scripts" / "materials_reference.py"), run_name="materials_reference")
    text = script["page"]()
    assert text == (ROOT / "docs" / "reference" / "materials.md").read_text(encoding="utf-8"), "run `make references`"
    rows = [line.split(" | ")[0].lstrip("| ") for line in text.splitlines() if line.startswith("| ")]
    assert all(rows.count(name) == 2 + (name in SHEETS) for name in MATERIALS)
