"""The records of constants, their page, and the benchmark that changes one number at a time."""

import subprocess
import sys
from dataclasses import FrozenInstanceError
from pathlib import Path

import pytest

from benchmarks.accuracy import sensitivity
from benchmarks.accuracy.sensitivity import changed, numbers, table
from scripts.constants_reference import PAGE, RECORDS, constants_of, page

ROOT = Path(__file__).resolve().parents[1]


def test_every_constant_says_its_unit_reason_and_source():
    for record in RECORDS.values():
        for one in constants_of(record):
            assert one.unit and one.reason and one.source, one
            assert all(type(part) in (int, float) for part in (one.value if isinstance(one.value, tuple) else (one.value,)))
        with pytest.raises(FrozenInstanceError):
            setattr(record, next(constants_of(record)).name, 0.0)


def test_the_page_of_constants_is_up_to_date():
    assert page() == PAGE.read_text(encoding="utf-8"), "run `make references`"


def test_the_recovery_s_numbers_are_found():
    found = dict(numbers())
    assert found["prior.length"] == 2.0 and found["pace.stiffness_offsets"] == (0.02, 0.05, 0.03, 0.03)
    assert {key.partition(".")[0] for key in found} == set(RECORDS)


def test_a_whole_number_stays_whole():
    assert changed(3, 0.5) == 2 and changed(1, 0.5) == 1 and changed(0.3, 2.0) == 0.6 and changed((1.0, 4), 0.5) == (0.5, 2)


def test_a_changed_number_reaches_what_is_made_from_it():
    code = (
        "from benchmarks.accuracy.sensitivity import change; change('prior.duration', 0.5); "
        "from seeing_wind.engine.recovery.prior.kernel import Kernel; print(Kernel.duration, Kernel.length)"
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["4.0", "2.0"]


def test_the_table_says_what_swings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sensitivity, "numbers", lambda: iter([(f"m.{name}", 1.0) for name in ("calm", "wild", "new")]))
    base = {"size": 10.0, "direction": 5.0, "force": [[[1.0, 0.0, 0.0]]]}
    results = {"as it is 1 post": base, "m.calm 0.5 post": base, "m.calm 2 post": base, "m.wild 0.5 post": base | {"size": 13.0}}
    results["m.wild 2 post"] = {"failed": "SimulationError"}
    rows = [line for line in table(results, [tmp_path / "post.npz"]).splitlines() if line.startswith("| `")]
    assert [row.split("`")[1] for row in rows] == ["m.wild", "m.calm"]
    assert "fails" in rows[0] and "| 0 % | 0.0 % |" in rows[1]
