"""The clips that the tests of this room share."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from scenes import Scene, ball_scene, disc_scene  # noqa: E402

from seeing_wind.engine.observe import observe  # noqa: E402
from seeing_wind.engine.progress import NoProgress  # noqa: E402
from seeing_wind.engine.records import Observation  # noqa: E402
from seeing_wind.engine.settings import ObserveSettings  # noqa: E402


@pytest.fixture(scope="session")
def disc(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return disc_scene(tmp_path_factory.mktemp("disc"))


@pytest.fixture(scope="session")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return ball_scene(tmp_path_factory.mktemp("ball"))


@pytest.fixture(scope="session")
def disc_seen(disc: Scene) -> Observation:
    return observe(disc.path, ObserveSettings(box=disc.box, distance=1.5), NoProgress())
