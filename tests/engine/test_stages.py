"""When a stage of an earlier run counts as done: by what its files hold, not by where they are."""

from __future__ import annotations

from pathlib import Path

import pytest

from seeing_wind.engine.settings import ObserveSettings
from seeing_wind.engine.stages import observation_stamp


@pytest.fixture
def project(tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    (folder / "pictures").mkdir(parents=True)
    for name in ("clip.mp4", "mask.png", "camera.json", *(f"pictures/shot_{k:04d}.png" for k in range(4))):
        (folder / name).write_bytes(name.encode())
    return folder


def stamp(folder: Path, clip: str, **more: object) -> str:
    files = {"mask": str(folder / "mask.png"), "camera": str(folder / "camera.json")}
    return observation_stamp(str(folder / clip), ObserveSettings(**{**files, **more}))


CLIPS = ("clip.mp4", "pictures", "pictures/shot_%04d.png", "pictures/shot_*.png")


@pytest.mark.parametrize("clip", CLIPS)
@pytest.mark.parametrize("changed", ["mask.png", "camera.json", "clip"])
def test_another_content_under_the_same_name_is_noticed(project: Path, clip: str, changed: str) -> None:
    first = stamp(project, clip)
    assert first == stamp(project, clip)
    file = project / ("clip.mp4" if clip == "clip.mp4" else "pictures/shot_0002.png") if changed == "clip" else project / changed
    file.write_bytes(b"another")
    assert first != stamp(project, clip)


@pytest.mark.parametrize("clip", CLIPS)
def test_a_project_that_was_moved_is_not_done_again(project: Path, clip: str) -> None:
    first = stamp(project, clip)
    assert stamp(project.rename(project.with_name("moved")), clip) == first


def test_settings_count_and_pictures_outside_the_range_do_not(project: Path) -> None:
    first = stamp(project, "pictures", frames=(0, 2))
    (project / "pictures/shot_0003.png").write_bytes(b"another")
    assert first == stamp(project, "pictures", frames=(0, 2)) != stamp(project, "pictures", frames=(0, 3))
    assert len({stamp(project, "clip.mp4", **more) for more in ({}, {"mask": None}, {"mask": None, "pin": str(project / "mask.png")})}) == 3
