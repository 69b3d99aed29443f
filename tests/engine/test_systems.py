"""Windows' rules in place of ours: a file that somebody holds, a path that is too long, a frame whose path is not ASCII."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from seeing_wind.engine import systems
from seeing_wind.engine.errors import TakeError
from seeing_wind.engine.observe.clip.images import read_image, write_png
from seeing_wind.engine.take import Take


class Held:
    """`os.replace` of a Windows on which a scanner holds the file for the first `times` tries."""

    def __init__(self, times: int) -> None:
        self.times, self.tries = times, 0

    def __call__(self, source: object, target: object) -> None:
        self.tries += 1
        if self.tries <= self.times:
            raise PermissionError(13, "The process cannot access the file because it is being used by another process", str(target))
        os.rename(source, target)  # type: ignore[arg-type]


@pytest.fixture
def on_windows(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Windows with short paths, and without its patience."""
    monkeypatch.setattr(systems, "windows", lambda: True)
    monkeypatch.setattr(systems, "long_paths", lambda: False)
    monkeypatch.setattr(systems, "PAUSES", (0.0,) * 6)
    return monkeypatch


def test_a_file_that_is_held_for_a_moment_is_replaced(on_windows: pytest.MonkeyPatch, tmp_path: Path) -> None:
    held = Held(4)
    on_windows.setattr(systems.os, "replace", held)
    Take(tmp_path).write_json("report.json", {"a": 1})
    assert held.tries == 5 and Take(tmp_path).read_json("report.json") == {"a": 1}


def test_a_file_that_stays_open_is_an_error_that_says_so_and_the_old_one_stays(on_windows: pytest.MonkeyPatch, tmp_path: Path) -> None:
    take = Take(tmp_path)
    take.write_json("report.json", {"a": 1})
    on_windows.setattr(systems.os, "replace", Held(99))
    with pytest.raises(TakeError, match="another process") as caught:
        take.write_json("report.json", {"a": 2})
    assert "Close the programs" in caught.value.hint
    assert take.read_json("report.json") == {"a": 1} and [path.name for path in tmp_path.iterdir()] == ["report.json"]


def test_elsewhere_a_file_that_may_not_be_replaced_is_not_tried_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    held = Held(1)
    monkeypatch.setattr(systems, "windows", lambda: False)
    monkeypatch.setattr(systems.os, "replace", held)
    with pytest.raises(PermissionError):
        systems.replace(tmp_path / "a", tmp_path / "b")
    assert held.tries == 1


def test_a_take_whose_path_is_too_long_is_refused_before_the_work(on_windows: pytest.MonkeyPatch, tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 100) / ("e" * 100)
    with pytest.raises(TakeError, match="too long") as caught:
        Take(deep).prepare()
    assert "shorter" in caught.value.hint and not deep.exists()
    on_windows.setattr(systems, "long_paths", lambda: True)
    Take(deep).prepare()
    on_windows.setattr(systems, "windows", lambda: False)
    on_windows.setattr(systems, "long_paths", lambda: pytest.fail("only Windows has a registry"))
    Take(deep).prepare()


def test_a_scratch_folder_of_a_killed_process_goes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(systems.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(systems.tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(systems.socket, "gethostname", lambda: "host.net")
    with systems.scratch() as ours:
        assert ours.parent == tmp_path and ours.name.startswith(f"seeing_wind_host-net_{os.getpid()}_")
        names = ("host-net_999999999", "elsewhere_999999999", f"host-net_{os.getppid()}")
        killed, other, alive = (tmp_path / f"seeing_wind_{name}_x" for name in names)
        for folder in (killed, other, alive):
            folder.mkdir()
            (folder / "mask.png").touch()
        with systems.scratch():
            assert not killed.exists() and other.is_dir() and alive.is_dir() and ours.is_dir()
    assert not ours.exists()


def test_how_processes_are_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(systems, "windows", lambda: True)
    assert systems.quiet() == {"creationflags": 0x08000000} and systems.apart() == {"creationflags": 0x08000200}
    monkeypatch.setattr(systems, "windows", lambda: False)
    assert systems.quiet() == {} and systems.apart() == {"start_new_session": True}


def test_images_are_opened_by_python_and_not_by_opencv(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """OpenCV hands a path to Windows in the system's old code page."""
    for name in ("imread", "imwrite"):
        monkeypatch.setattr(cv2, name, lambda *_: pytest.fail("a path that is not ASCII would not be found"))
    frame = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    write_png(tmp_path / "Blätter 风.png", frame)
    assert np.array_equal(read_image(tmp_path / "Blätter 风.png", cv2.IMREAD_COLOR), frame)
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.png").write_text("no frame")
    for name, error in (("empty.png", ValueError), ("text.png", ValueError), ("none.png", OSError)):
        with pytest.raises(error):
            read_image(tmp_path / name, cv2.IMREAD_COLOR)


def test_nothing_in_the_engine_lets_opencv_open_an_image() -> None:
    engine = Path(systems.__file__).parent
    users = [path.name for path in engine.rglob("*.py") if "cv2.imread(" in path.read_text(encoding="utf-8")]
    assert not users, "use observe.clip.frames"
