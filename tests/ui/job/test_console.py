"""Messages as lines for people and farm logs."""

from __future__ import annotations

import io

import pytest

from seeing_wind.ui.job.console import Console
from tests.ui.jobs import recover


def test_the_doctor_shows_every_check_and_what_to_do() -> None:
    out = io.StringIO()
    checks = [
        {"name": "torch", "ok": True, "detail": "CPU only"},
        {"name": "transformers", "ok": False, "detail": "not installed", "advice": "pip", "optional": True},
        {"name": "scipy", "ok": False, "detail": "not installed", "advice": "make setup"},
    ]
    Console(out).show({"type": "result", "outcome": "converged", "checks": checks, "seconds": 2.0})
    assert out.getvalue().splitlines() == [
        "      ok  torch: CPU only",
        "optional  transformers: not installed (pip)",
        " missing  scipy: not installed (make setup)",
        "converged, seconds 2",
    ]


def test_a_residual_has_a_unit() -> None:
    out = io.StringIO()
    for residual, unit in ((0.314, "px"), (0.0023, "m")):
        Console(out).show({"type": "progress", "stage": "recover", "fraction": 0.5, "residual": residual, "residual_unit": unit})
    assert [line.split(", residual ")[1] for line in out.getvalue().splitlines()] == ["0.314 px", "2.3 mm"]


def test_a_failure_is_not_said_twice() -> None:
    out, err = io.StringIO(), io.StringIO()
    console = Console(out, err)
    console.show({"type": "error", "message": "No such clip.", "hint": "Check the path."})
    console.show({"type": "result", "outcome": "failed", "message": "No such clip. Check the path."})
    assert err.getvalue() == "Error: No such clip. Check the path.\n" and out.getvalue() == ""


def test_an_operator_s_failure_is_printed_once_in_the_panel_s_words(stand_in, workplace, monkeypatch, capfd) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", "flags")
    with pytest.raises(RuntimeError, match="There is nothing in Box. Draw Box round the object."):
        recover(workplace)
    printed = "".join(capfd.readouterr())
    assert printed.count("There is nothing in") == 1 and "--" not in printed and "FOV is a guess" in printed


def test_the_log_of_a_worker_that_died_is_printed_and_its_failure_once(stand_in, workplace, monkeypatch, capfd) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", "crash")
    with pytest.raises(RuntimeError, match="the grid is empty"):
        recover(workplace)
    printed = "".join(capfd.readouterr())
    assert printed.count("Error: The engine stopped") == 1 and "log line of the worker" in printed
