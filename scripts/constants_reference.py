"""docs/reference/constants.md from the records of constants: every tuned number with its unit, reason and source.

    python scripts/constants_reference.py            writes the page
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from seeing_wind.engine.materials import LIMITS  # noqa: E402
from seeing_wind.engine.recovery.prior.constants import PRIOR  # noqa: E402
from seeing_wind.engine.recovery.solve.constants import PACE  # noqa: E402
from seeing_wind.engine.recovery.targets.constants import NOISE  # noqa: E402

PAGE = ROOT / "docs" / "reference" / "constants.md"
RECORDS = {"prior": PRIOR, "noise": NOISE, "pace": PACE, "limits": LIMITS}
TITLES = {
    "prior": ("Prior", "recovery/prior/constants.py", "What is believed before the clip is seen."),
    "noise": ("Noise", "recovery/targets/constants.py", "Errors of what was observed, and of the solver's body."),
    "pace": ("Pace", "recovery/solve/constants.py", "How far and how finely the solve goes."),
    "limits": ("Solver", "materials.py", "Grid, substeps and damping of the material point method."),
}
HEAD = """# Constants

Written by `make references` from the records of constants, and by a test held to them. *Chosen* means by
judgement, on development scenes at most. [What each is worth](../notebook/sensitivity.md) was measured.
"""


@dataclass(frozen=True)
class Constant:
    """One number of a record, as the docs and the sensitivity table show it."""

    name: str
    value: float | tuple[float, ...]
    unit: str
    reason: str
    source: str


def constants_of(record: Any) -> Iterator[Constant]:
    """All constants of a record, in the order of its fields."""
    for one in fields(record):
        yield Constant(one.name, getattr(record, one.name), one.metadata["unit"], one.metadata["reason"], one.metadata["source"])


def page() -> str:
    """The whole page."""
    parts = [HEAD]
    for name, record in RECORDS.items():
        title, file, what = TITLES[name]
        parts.append(f"## {title}\n\n{what} `seeing_wind/engine/{file}`.\n")
        parts.append("| name | value | unit | what it is | source |\n|---|---|---|---|---|")
        for one in constants_of(record):
            parts.append(f"| `{name}.{one.name}` | {_shown(one.value)} | {one.unit} | {one.reason} | {one.source} |")
        parts.append("")
    return "\n".join(parts)


def _shown(value: float | tuple[float, ...]) -> str:
    return ", ".join(f"{one:g}" for one in (value if isinstance(value, tuple) else (value,)))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
