"""docs/reference/cli.md is what the parser and the settings say."""

from __future__ import annotations

import runpy
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_reference_is_up_to_date() -> None:
    script = runpy.run_path(str(ROOT / "scripts" / "cli_reference.py"), run_name="cli_reference")
    text = script["page"]()
    assert text == (ROOT / "docs" / "reference" / "cli.md").read_text(encoding="utf-8"), "run `make cli-reference`"
    assert text.count("\n## `") == 11 and "`--stiffness {free,given}`" in text and "| `mass_scale` |" in text
