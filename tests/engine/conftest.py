"""What all tests of the engine share."""

from __future__ import annotations

import pytest

from seeing_wind.engine.recovery import cost


@pytest.fixture(autouse=True)
def machine_of_known_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    """No recovery measures how fast the kernels are before it begins, which takes longer than most of them do here: `test_cost.py` does."""
    monkeypatch.setattr(cost, "_measured", lambda plastic: cost.Speed(copy=2e-7, base=2e-6, change=2e-8))
