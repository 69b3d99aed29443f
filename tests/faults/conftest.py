"""One warm engine for all suites, and their counts at the end."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.faults.counts import COUNTS
from tests.faults.seeds import sow
from tests.faults.worker import Worker


@pytest.fixture(scope="session")
def worker() -> Iterator[Worker]:
    with Worker() as running:
        yield running


@pytest.fixture(scope="session")
def seeds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one sound input of every kind."""
    return sow(tmp_path_factory.mktemp("seeds"))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    if any(COUNTS.values()):  # no counts where other processes run the tests
        terminalreporter.write_line("faults: " + ", ".join(f"{name} {count}" for name, count in COUNTS.items()))
