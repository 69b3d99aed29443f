"""What each tuned number of the recovery is worth: benchmarks/accuracy/sensitivity.py TRUTH.npz ... [--out DIR] [--only WORD] [--jobs N]

Every number of the records of constants (docs/reference/constants.md) is halved and doubled, one at a time, and the files are recovered
with it (`truth.py` says what is in them). Files should be such that nothing was chosen on. The table, DIR/sensitivity.md, has a row per
number: how much it changes the errors, and by how much the force itself. It is sorted by that. What is done already is kept in
DIR/sensitivity.json, so a run that was stopped goes on.

A number is changed before any other module of the engine is loaded, so all that is made from it when they load changes, too.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.constants_reference import RECORDS, constants_of  # noqa: E402

FACTORS = (0.5, 2.0)
SWINGS = 0.1
"""Relative change of an error from which docs/accuracy.md has to mention the number."""


def numbers() -> Iterator[tuple[str, float | tuple[float, ...]]]:
    """Key, as "prior.length", and value of each."""
    for name, record in RECORDS.items():
        yield from ((f"{name}.{one.name}", one.value) for one in constants_of(record))


def changed(value: Any, factor: float) -> Any:
    """`factor` times a number; a whole one stays whole and at least 1."""
    if isinstance(value, tuple):
        return tuple(changed(one, factor) for one in value)
    return max(1, round(factor * value)) if isinstance(value, int) else factor * value


def change(key: str, factor: float) -> None:
    """Change a number for the rest of this process."""
    record, _, name = key.partition(".")
    object.__setattr__(RECORDS[record], name, changed(getattr(RECORDS[record], name), factor))


def recovered(file: Path) -> dict[str, Any]:
    """Errors of a recovery with what is loaded now, and the force, thinned, to compare with."""
    from seeing_wind.engine.command.trajectories.bodies import read_trajectories
    from seeing_wind.engine.look.report.accuracy import field_errors
    from seeing_wind.engine.progress import NoProgress
    from seeing_wind.engine.recovery.recover import recover
    from seeing_wind.engine.settings import RecoverSettings

    source, began = read_trajectories(file, None, None), time.monotonic()
    settings = RecoverSettings(gravity=source.gravity, clamp_depth=source.clamp_depth)
    found = recover(source.particles, source.material, source.targets, source.fps, settings, NoProgress())
    with np.load(file, allow_pickle=False) as truth:
        want, free = truth["acc"] * float(truth["rho"]), ~truth["fixed"]
    size, direction = field_errors(want, found.force_density, free)
    force = found.force_density[:, free]
    few = force[:, :: max(1, force.shape[1] // 40)]
    return {"size": float(size), "direction": float(direction), "seconds": time.monotonic() - began, "force": few.round(6).tolist()}


def _one(key: str, factor: float, file: Path) -> dict[str, Any]:
    """`recovered` in a process of its own; an error is a result, too."""
    words = [sys.executable, __file__, "--one", key, str(factor), str(file)]
    run = subprocess.run(words, capture_output=True, text=True, encoding="utf-8")
    if run.returncode:
        return {"failed": (run.stderr.strip().splitlines() or ["no word"])[-1]}
    found: dict[str, Any] = json.loads(run.stdout.splitlines()[-1])
    return found


def measured(files: list[Path], out: Path, only: str, jobs: int) -> dict[str, Any]:
    """All results by "key factor file": those of earlier runs, and the rest computed now."""
    kept = out / "sensitivity.json"
    results: dict[str, Any] = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {}
    chosen = [key for key, _ in numbers() if only in key]
    wanted = [("", 1.0, file) for file in files] + [(key, factor, file) for key in chosen for factor in FACTORS for file in files]
    todo = [one for one in wanted if _name(*one) not in results]
    with ThreadPoolExecutor(jobs) as pool:
        for number, (one, found) in enumerate(zip(todo, pool.map(lambda one: _one(*one), todo)), start=1):
            results[_name(*one)] = found
            aside = kept.with_suffix(".part")
            aside.write_text(json.dumps(results), encoding="utf-8")
            aside.replace(kept)
            print(f"{number} of {len(todo)}: {_name(*one)}: {_errors(found)}", flush=True)
    return results


def _name(key: str, factor: float, file: Path) -> str:
    return f"{key or 'as it is'} {factor:g} {file.stem}"


def _errors(found: dict[str, Any]) -> str:
    return str(found["failed"]) if "failed" in found else f"{found['size']:.1f} % {found['direction']:.1f}°"


def table(results: dict[str, Any], files: list[Path]) -> str:
    """The page: a row per number that is done on all files, what swings most first."""
    base = {file: results[_name("", 1.0, file)] for file in files}
    rows = []
    for key, value in numbers():
        cells, swing, moved = [], 0.0, 0.0
        for factor in FACTORS:
            for file in files:
                found = results.get(_name(key, factor, file))
                if found is None:
                    break
                cells.append("fails" if "failed" in found else f"{found['size']:.1f} / {found['direction']:.1f}")
                swing, moved = max(swing, _swing(found, base[file])), max(moved, _moved(found, base[file]))
        if len(cells) == len(FACTORS) * len(files):
            rows.append((swing, f"| `{key}` | {_shown(value)} | {' | '.join(cells)} | {100 * swing:.0f} % | {100 * moved:.1f} % |"))
    columns = [f"{file.stem} x {factor:g}" for factor in FACTORS for file in files]
    lines = [
        "# What each number is worth", "",
        "Errors (size % / direction °) with a number of the recovery halved and doubled, one at a time. As it is: "
        + ", ".join(f"{file.stem} {_errors(base[file])}" for file in files) + ".", "",
        f"*Swings*: the largest change of an error, relative to it; {sum(swing > SWINGS for swing, _ in rows)} of {len(rows)} are above "
        f"{100 * SWINGS:.0f} %. *Moves*: the largest change of the force, root mean square, relative to it.", "",
        f"| number | value | {' | '.join(columns)} | swings | moves |", "|---|---|" + "---|" * (len(columns) + 2),
        *(row for _, row in sorted(rows, reverse=True)), "",
    ]  # fmt: skip
    return "\n".join(lines)


def _shown(value: float | tuple[float, ...]) -> str:
    return ", ".join(f"{one:g}" for one in (value if isinstance(value, tuple) else (value,)))


def _swing(found: dict[str, Any], base: dict[str, Any]) -> float:
    if "failed" in found:
        return float("inf") if "failed" not in base else 0.0
    return max(abs(found[key] / base[key] - 1.0) for key in ("size", "direction"))


def _moved(found: dict[str, Any], base: dict[str, Any]) -> float:
    if "failed" in found:
        return 1.0
    other, force = np.array(found["force"]), np.array(base["force"])
    return float(np.sqrt(((other - force) ** 2).mean() / (force**2).mean()))


def main() -> None:
    """See the module."""
    if sys.argv[1:2] == ["--one"]:
        key, factor, file = sys.argv[2:5]
        if key:
            change(key, float(factor))
        print(json.dumps(recovered(Path(file))))
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+", metavar="TRUTH.npz")
    parser.add_argument("--out", type=Path, default=Path("build/sensitivity"), metavar="DIR")
    parser.add_argument("--only", default="", metavar="WORD", help="numbers whose dotted name has this in it")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="recoveries at a time")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    results = measured(asked.files, asked.out, asked.only, asked.jobs)
    page = asked.out / "sensitivity.md"
    page.write_text(table(results, asked.files), encoding="utf-8")
    print(page)


if __name__ == "__main__":
    main()
