"""The paper's Tables 1, 2 and 3, rebuilt: benchmarks/paper_tables/tables.py [--out DIR] [--row NAME ...] [--short] [--list] [--again]

Six objects made by scripts, six force fields, two cameras (`paper_tables`). Every row runs the engine's command line, is kept as
JSON in DIR and skipped when it is there, so an interrupted run goes on where it stopped. The tables are written beside the paper's
numbers to DIR/tables.md, tables.json and figures. With --docs also to docs/notebook/tables.md, docs/tables and
benchmarks/results/tables.json; rows that DIR lacks are then those published there before, so one row can be run again alone. A whole run
takes an hour or two on two cores.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT)]  # a script of the source tree: it runs with the package installed or not

from paper_tables.report import compare, write_report  # noqa: E402
from paper_tables.rows import VERSION, Row, all_rows, run_row, short_rows  # noqa: E402

SHORT_FRAMES = 8
DOCS, RESULTS = ROOT / "docs", ROOT / "benchmarks" / "results" / "tables.json"


def main(argv: list[str] | None = None) -> int:
    """Run what is missing, write the report; returns 1 when a row failed to run."""
    options = parse(argv)
    rows = short_rows() if options.short else all_rows()
    if options.list:
        print("\n".join(f"{row.key:36} about {row.seconds:.0f} s" for row in rows))
        return 0
    if options.row:
        unknown = sorted(set(options.row) - {row.key for row in rows})
        if unknown:
            print(f"No row is named {', '.join(unknown)}. --list shows the names.", file=sys.stderr)
            return 2
        rows = [row for row in rows if row.key in options.row]
    out = options.out / "short" if options.short else options.out
    for part in ("rows", "clips", "takes", "frames"):
        (out / part).mkdir(parents=True, exist_ok=True)
    missing = [row for row in rows if options.again or kept(out, row) is None]
    failed = 0
    for number, row in enumerate(missing):
        failed += not run(row, out, missing[number:], SHORT_FRAMES if options.short else None)
    before = published(out) if options.docs and not options.short else {}
    found = [
        figures
        for row in (short_rows() if options.short else all_rows())
        if (figures := kept(out, row) or before.get(row.key)) is not None
    ]
    if found:
        text = write_report(out, found)
        if options.docs:
            publish(out, text)
        print(text)
        print(compare(found))
    return 1 if failed else 0


def parse(argv: list[str] | None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "tables", metavar="DIR")
    parser.add_argument("--row", action="append", metavar="NAME", help="only this row; may be given again")
    parser.add_argument("--short", action="store_true", help="two rows of few frames: a minute or two")
    parser.add_argument("--list", action="store_true", help="the names of all rows")
    parser.add_argument("--again", action="store_true", help="run rows that are there already")
    parser.add_argument("--docs", action="store_true", help="also write docs/notebook/tables.md and its figures")
    return parser.parse_args(argv)


def kept(out: Path, row: Row) -> dict | None:
    """The figures of an earlier run of exactly this row."""
    try:
        figures = json.loads((out / "rows" / f"{row.key}.json").read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError):
        return None
    same = figures["version"] == VERSION and tuple(figures["row"]["options"]) == row.options and figures["row"]["thing"] == row.thing
    return figures if same else None


def run(row: Row, out: Path, left: list[Row], frames: int | None) -> bool:
    """Run one row, telling what is going on and how long all that is left may take; False when it failed."""
    began, expected = time.monotonic(), sum(one.seconds for one in left)
    told = [""]

    def say(what: str) -> None:
        if what != told[0]:
            told[0] = what
            remaining = max(expected - (time.monotonic() - began), 0.0)
            print(f"\r{row.key}: {what}, {len(left)} rows and about {remaining / 60:.0f} min left   ", end="", file=sys.stderr, flush=True)

    try:
        figures = run_row(row, out, say) if frames is None else run_row(row, out, say, frames)
    except RuntimeError as error:
        print(f"\n{row.key} failed: {error}", file=sys.stderr)
        return False
    aside = out / "rows" / f"{row.key}.tmp"
    aside.write_text(json.dumps(figures, indent=1), encoding="utf-8")
    aside.replace(out / "rows" / f"{row.key}.json")
    print(f"\n{row.key}: {figures['magnitude']:.1f} % {figures['direction']:.1f} deg in {figures['seconds']:.0f} s", file=sys.stderr)
    return True


def published(out: Path) -> dict[str, dict]:
    """Figures of the rows in benchmarks/results/tables.json, by key; its frame of the scenes goes to `out`."""
    if not RESULTS.is_file():
        return {}
    scenes = DOCS / "tables" / "scenes.png"
    if scenes.is_file():  # in the place of one of fewer objects; drawn anew when `out` has them all
        (out / "scenes.png").write_bytes(scenes.read_bytes())
    figures = json.loads(RESULTS.read_text(encoding="utf-8"))
    return {Row(**one["row"]).key: one for one in figures}


def publish(out: Path, text: str) -> None:
    """Copy Markdown and figures to the documentation, and the rows to benchmarks/results."""
    (DOCS / "tables").mkdir(parents=True, exist_ok=True)
    for figure in out.glob("*.png"):
        (DOCS / "tables" / figure.name).write_bytes(figure.read_bytes())
    (DOCS / "notebook").mkdir(exist_ok=True)
    (DOCS / "notebook" / "tables.md").write_text(text.replace("](", "](../tables/"), encoding="utf-8")
    RESULTS.write_bytes((out / "tables.json").read_bytes())


if __name__ == "__main__":
    sys.exit(main())
