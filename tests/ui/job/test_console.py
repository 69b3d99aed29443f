"""Messages as lines for people and farm logs."""

from __future__ import annotations

import io

from seeing_wind.ui.job.console import Console


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


def test_a_failure_is_not_said_twice() -> None:
    out, err = io.StringIO(), io.StringIO()
    console = Console(out, err)
    console.show({"type": "error", "message": "No such clip.", "hint": "Check the path."})
    console.show({"type": "result", "outcome": "failed", "message": "No such clip. Check the path."})
    assert err.getvalue() == "Error: No such clip. Check the path.\n" and out.getvalue() == ""
