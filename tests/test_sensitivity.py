"""The benchmark that changes one number of the recovery at a time."""

import importlib
import sys
from pathlib import Path

import pytest

from benchmarks import sensitivity
from benchmarks.sensitivity import Changing, Constant, changed, constants, table

KERNEL = "seeing_wind.engine.recovery.prior.kernel"


def test_the_recovery_s_numbers_are_found():
    found = {one.key: one.value for one in constants()}
    assert found["recovery.prior.kernel.LENGTH"] == 2.0  # one of several in a line
    assert found["recovery.solve.stiffness.SPREAD"] == 0.3
    assert found["recovery.solve.stiffness.OFFSETS"] == (0.02, 0.05, 0.03, 0.03)
    assert len(found) > 40 and all(name.rpartition(".")[2].isupper() for name in found)


def test_a_whole_number_stays_whole():
    assert changed(3, 0.5) == 2 and changed(1, 0.5) == 1 and changed(0.3, 2.0) == 0.6 and changed((1.0, 4), 0.5) == (0.5, 2)


def test_a_changed_number_reaches_what_is_made_from_it(monkeypatch: pytest.MonkeyPatch):
    for name in [name for name in sys.modules if name.startswith(KERNEL)]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Changing(Constant(KERNEL, "DURATION", 8.0), 0.5), *sys.meta_path])
    other = importlib.import_module(KERNEL)
    monkeypatch.delitem(sys.modules, KERNEL)
    assert other.DURATION == 4.0 and other.LENGTH == 2.0 and other.Kernel.duration == 4.0


def test_the_table_says_what_swings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sensitivity, "constants", lambda: iter([Constant("m", name, 1.0) for name in ("CALM", "WILD", "NEW")]))
    base = {"size": 10.0, "direction": 5.0, "force": [[[1.0, 0.0, 0.0]]]}
    results = {"as it is 1 post": base, "m.CALM 0.5 post": base, "m.CALM 2 post": base, "m.WILD 0.5 post": base | {"size": 13.0}}
    results["m.WILD 2 post"] = {"failed": "SimulationError"}
    rows = [line for line in table(results, [tmp_path / "post.npz"]).splitlines() if line.startswith("| `")]
    assert [row.split("`")[1] for row in rows] == ["m.WILD", "m.CALM"]
    assert "fails" in rows[0] and "| 0 % | 0.0 % |" in rows[1]
