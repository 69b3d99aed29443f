"""Hostile inputs: each ends in time and within its memory with a sentence, and nothing is written where it does not belong."""

from __future__ import annotations

import math
import random
import shutil
import tempfile
from pathlib import Path
from typing import Any

import hypothesis
from hypothesis import strategies as st

from seeing_wind.engine.errors import DONE_WITH_WARNINGS
from tests.faults.counts import COUNTS, draws
from tests.faults.inputs import FAMILIES, VALUES, Family
from tests.faults.worker import Run, Worker

RESULTS = ("o.take", "o.npz", "b")
"""What a job may write, in its folder."""
EVERY = 100
"""Inputs between two lines of progress."""


def standing(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of everything under `folder`, but for results."""
    found = {}
    for path in folder.rglob("*"):
        name = path.relative_to(folder)
        if name.parts[:1] != ("work",) or name.parts[1:2] not in [(one,) for one in RESULTS]:
            state = path.lstat()
            if not path.is_dir():
                found[str(name)] = (state.st_size, state.st_mtime_ns)
    return found


def faults_of(run: Run) -> list[str]:
    """What is wrong with how a job ended."""
    found = []
    if run.traceback:
        found.append(f"traceback: {run.error.get('message')} {run.stderr[-1500:]}")
    if run.code not in (0, 1, 2, DONE_WITH_WARNINGS):
        found.append(f"exit code {run.code} after {run.seconds:.1f} s: {run.stderr[-500:]}")
    elif not run.result:
        found.append("no result")
    if run.code in (1, 2) and not (run.error.get("message") and (run.error.get("hint") or run.error.get("mend"))):
        found.append(f"no sentence that says what to do: {run.error}")
    if "Out of memory" in run.error.get("message", ""):
        found.append("out of memory")
    if any(word in run.error.get("message", "") for word in ("object at 0x", "broadcast", "NoneType", "list index")):
        found.append(f"a message for programmers: {run.error['message']}")
    return found + _nonsense(run)


def _nonsense(run: Run) -> list[str]:
    """What no one may call a result."""
    residual = run.result.get("residual", {})
    if run.code in (1, 2) or not residual:
        return []
    limit = 1.0 if run.result["residual_unit"] == "m" else 30.0
    wrong = not math.isfinite(residual["max"]) or residual["max"] > limit
    return (
        [f"a result with a residual of {residual['max']}"]
        if wrong and not (run.warnings and "no force explains" in run.warnings[0])
        else []
    )


def broken(worker: Worker, seeds: Path, family: Family, seed: int, value: Any) -> list[str]:
    """Run one hostile input in a folder of its own; returns what was wrong."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "work"
        shutil.copytree(seeds, folder)
        (Path(place) / "beside").write_text("stays")
        argv = family(random.Random(seed), value, folder)
        before = standing(Path(place))
        run = worker.run(argv, folder)
        COUNTS["inputs"] += 1
        COUNTS["tracebacks"] += run.traceback
        if COUNTS["inputs"] % EVERY == 0:
            print(f"\n{COUNTS['inputs']} inputs, {COUNTS['tracebacks']} tracebacks", flush=True)
        found = faults_of(run)
        if standing(Path(place)) != before:
            found.append("something outside the results was written")
    return [f"{family.__name__}({seed}), {' '.join(str(one)[:60] for one in argv)}: {one}" for one in found]


def test_hostile_inputs_end_with_a_sentence(worker: Worker, seeds: Path) -> None:
    wrong: list[str] = []

    @hypothesis.seed(24)
    @hypothesis.settings(
        max_examples=draws(30, 1040), database=None, deadline=None, phases=[hypothesis.Phase.generate],
        suppress_health_check=list(hypothesis.HealthCheck),
    )  # fmt: skip
    @hypothesis.given(st.sampled_from(FAMILIES), st.integers(0, 2**32), VALUES)
    def one(family: Family, seed: int, value: Any) -> None:
        wrong.extend(broken(worker, seeds, family, seed, value))

    one()
    assert not wrong, f"{len(wrong)} faults\n" + "\n".join(wrong[:40])
