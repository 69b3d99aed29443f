"""The end of a job: what could not be drawn or written leaves what was found, and is told."""

from __future__ import annotations

import errno
import json
from argparse import Namespace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from seeing_wind.engine.command import verbs
from seeing_wind.engine.command.reporting import report_result
from seeing_wind.engine.conventions import DISTRUST, UNHELD
from seeing_wind.engine.errors import MissingPackage, TakeError, UsageError
from seeing_wind.engine.progress import Cancelled, Journal, NoProgress, Progress
from seeing_wind.engine.records import Outcome, Recovery
from seeing_wind.engine.recovery.diagnostics.remarks import EXPLAINS_NOTHING, worst_first
from seeing_wind.engine.take import Take
from tests.engine.fields import UniformField

BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


@pytest.fixture
def take(tmp_path: Path) -> Take:
    """One that holds a field, as far as its description says."""
    take = Take(tmp_path / "leaf.take")
    take.finish("recover", "a stamp", {})
    return take


class Drawing:
    """A report that counts how often it is drawn."""

    def __init__(self, take: Take, missing: dict[str, str] | None = None, error: BaseException | None = None) -> None:
        self.take, self.missing, self.error, self.drawn = take, missing or {}, error, 0

    def __call__(self, journal: Journal) -> dict[str, Any]:
        self.drawn += 1
        if self.error is not None:
            raise self.error
        figures = {"outcome": "converged", "iterations": 3, "seconds": {"total": 12.5}, "report": {"missing": self.missing}}
        for name in {"report.json", "report.png", "overlay.mp4", "resimulated.mp4"} - set(self.missing):
            self.take.write_json(name, figures)
        return figures


def recovery() -> Recovery:
    empty = np.zeros((1, 1, 3))
    return Recovery(Outcome.CONVERGED, empty, empty[..., 0], empty, np.zeros((1, 1, 3, 3)), empty[0], np.zeros(1), "px", 3, 1.0, ["a note"])


def test_a_report_that_is_finished_is_not_drawn_again(take: Take) -> None:
    draw = Drawing(take)
    first = report_result(take, recovery(), "full", "clip.mp4", draw, NoProgress())
    assert report_result(take, recovery(), "full", "clip.mp4", draw, NoProgress()) == first and draw.drawn == 1
    assert first["warnings"] == [] and first["stage_seconds"] == {"total": 12.5}


@pytest.mark.parametrize("change", ["level", "clip", "file", "field"])
def test_it_is_drawn_again_when_anything_is_different(take: Take, change: str) -> None:
    draw = Drawing(take)
    report_result(take, recovery(), "full", "clip.mp4", draw, NoProgress())
    if change == "file":
        take.file("overlay.mp4").unlink()
    if change == "field":
        take.finish("recover", "another stamp", {})
    level, clip = "quick" if change == "level" else "full", "moved.mp4" if change == "clip" else "clip.mp4"
    report_result(take, recovery(), level, clip, draw, NoProgress())
    assert draw.drawn == 2


def test_a_product_that_is_missing_is_a_warning_and_is_tried_again(take: Take) -> None:
    draw = Drawing(take, missing={"overlay.mp4": "This OpenCV has no codec."})
    result = report_result(take, recovery(), "quick", "clip.mp4", draw, NoProgress())
    assert result["outcome"] == "converged" and result["warnings"] == ["overlay.mp4: This OpenCV has no codec."]
    draw.missing = {}
    assert report_result(take, recovery(), "quick", "clip.mp4", draw, NoProgress())["warnings"] == [] and draw.drawn == 2


ERRORS = [
    OSError(errno.ENOSPC, "No space left on device"),
    TakeError("Cannot write report.png.", "Free some space."),
    MissingPackage("There is no codec."),
    cv2.error("OpenCV(9.9) odd"),
    AttributeError("module 'cv2' has no attribute 'x'"),
    ModuleNotFoundError("No module named 'matplotlib'"),
    MemoryError("too large"),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_no_report_is_worth_the_field(take: Take, error: Exception) -> None:
    told: list[dict[str, Any]] = []
    draw = Drawing(take, error=error)
    result = report_result(take, recovery(), "full", "clip.mp4", draw, Progress(told.append))
    assert (result["outcome"], result["iterations"], result["notes"]) == ("converged", 3, ["a note"])
    assert len(result["warnings"]) == 1 and str(error) in result["warnings"][0]
    assert [message["message"] for message in told if message["type"] == "warning"] == result["warnings"]
    draw.error = None
    assert report_result(take, recovery(), "full", "clip.mp4", draw, NoProgress())["warnings"] == []


def test_a_cancel_is_no_fault_of_the_report(take: Take) -> None:
    with pytest.raises(Cancelled):
        report_result(take, recovery(), "full", "clip.mp4", Drawing(take, error=Cancelled()), NoProgress())


@pytest.fixture
def edit(tmp_path: Path) -> Namespace:
    """Two bodies in a field, for two frames."""
    take = Take(tmp_path / "leaf.take")
    take.prepare()
    UniformField(BOX, 24.0, 2, np.array([1.0, 0.0, 0.0])).save(take.file("field.safetensors"))
    corners = np.array(np.meshgrid([0, 0.1], [0, 0.1], [0, 0.1])).reshape(3, -1).T
    triangles = np.array([[0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7], [0, 1, 4], [1, 4, 5], [2, 3, 6], [3, 6, 7], [0, 2, 4], [2, 4, 6]])
    np.savez(tmp_path / "box.npz", vertices=corners, triangles=triangles)
    bodies = "".join(f'[[body]]\nname = "{name}"\nmesh = "box.npz"\n' for name in ("one", "two"))
    (tmp_path / "edit.toml").write_text(bodies)
    return Namespace(verb="resimulate", source=str(take.path), edit=str(tmp_path / "edit.toml"), take=str(tmp_path / "edit.take"))


@pytest.mark.parametrize("full_at", ["two", "resimulation", "take"])
def test_a_full_disk_leaves_no_body_without_a_stamp(edit: Namespace, monkeypatch: pytest.MonkeyPatch, full_at: str) -> None:
    out = Take(edit.take)
    with monkeypatch.context() as patched:
        for name in ("write_bytes", "write_text"):
            write = getattr(Path, name)

            def full(path: Path, *arguments: Any, write=write, **more: Any) -> int:
                if path.name.startswith(f".{full_at}."):
                    raise OSError(errno.ENOSPC, "No space left on device")
                return write(path, *arguments, **more)

            patched.setattr(Path, name, full)
        with pytest.raises(TakeError, match="No space left"):
            verbs.resimulate(edit, NoProgress())
    assert not list(out.path.rglob("*.npz")) and not out.file("resimulation.json").exists() and not out.file("take.toml").exists()
    verbs.resimulate(edit, NoProgress())
    assert sorted(path.name for path in out.path.rglob("*.npz")) == ["one.npz", "two.npz"]
    assert out.description()["stages"]["resimulate"]["stamp"] and json.loads(out.file("resimulation.json").read_text())["frames"] == 2


def test_what_is_coarser_or_shorter_than_in_full_says_that_it_is_a_preview(edit: Namespace) -> None:
    bodies = Path(edit.edit).read_text()
    for line, frames, preview in (("", 2, False), ("frames = 2", 2, False), ("frames = 1", 1, True), ("coarseness = 2.0", 2, True)):
        Path(edit.edit).write_text(f"{line}\n{bodies}")
        verbs.resimulate(edit, NoProgress())
        told = json.loads(Take(edit.take).file("resimulation.json").read_text())
        assert (told["frames"], told["preview"]) == (frames, preview), line
        assert len(Take(edit.take).read_arrays("bodies/one.npz")["vertices"]) == frames + 1


def test_a_folder_that_cannot_be_written_is_told_before_anything_is_simulated(edit: Namespace, monkeypatch: pytest.MonkeyPatch) -> None:
    Path(edit.take).write_text("a file")
    stages: list[str] = []
    with pytest.raises(UsageError, match="is not a folder"):
        verbs.resimulate(edit, Progress(lambda message: stages.append(message["stage"])))
    assert not stages


def test_what_makes_a_field_useless_is_said_first() -> None:
    useless, far = f"22 px off. {DISTRUST}: check.", f"In frame 3 the body is far off: {EXPLAINS_NOTHING}."
    unheld = f"{UNHELD}; the force found may be only what holds the body up."
    notes = ["a knot every 4 frames", unheld, "the body hardly moves", useless, far]
    assert worst_first(notes) == [useless, far, unheld, "a knot every 4 frames", "the body hardly moves"]
