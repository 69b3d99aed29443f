"""When a stage of an earlier run counts as done: by what its files hold, not by where they are."""

from __future__ import annotations

import errno
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from seeing_wind.engine.errors import TakeError
from seeing_wind.engine.field import distillation
from seeing_wind.engine.materials import Material, Sheet
from seeing_wind.engine.progress import Cancelled, Journal, NoProgress, Progress
from seeing_wind.engine.record_arrays import read_recovery, to_arrays
from seeing_wind.engine.records import Measured, Observation, Recovery
from seeing_wind.engine.recovery.stage import FITTED, SOLVED, recover_stage
from seeing_wind.engine.settings import BuildSettings, ObserveSettings
from seeing_wind.engine.stages import build_body, build_stage, lift_stage, observation_stamp, observe_stage, track_targets
from seeing_wind.engine.take import Take, stamp_of
from tests.engine.observations import observed
from tests.engine.recovery.bodies import FPS, RUBBER, WEIGHTLESS, blow, plate, points


@pytest.fixture(autouse=True)
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fields are fitted in haste: nobody asks here how well."""
    monkeypatch.setattr(distillation, "ITERATIONS", 40)


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


def test_settings_count_and_frames_outside_the_range_do_not(project: Path) -> None:
    first = stamp(project, "pictures", frames=(0, 2))
    (project / "pictures/shot_0003.png").write_bytes(b"another")
    assert first == stamp(project, "pictures", frames=(0, 2)) != stamp(project, "pictures", frames=(0, 3))
    assert len({stamp(project, "clip.mp4", **more) for more in ({}, {"mask": None}, {"mask": None, "pin": str(project / "mask.png")})}) == 3


def test_a_job_cancelled_while_the_field_is_fitted_leaves_the_last_field_and_its_motion(tmp_path: Path) -> None:
    body = plate((3, 3, 2))
    x, _ = blow(body, lambda X, t: np.zeros_like(X) + [5.0, 0.0, 0.0], 4)
    take = Take(tmp_path / "leaf.take")
    take.prepare()
    heavy = replace(RUBBER, density=4.0 * RUBBER.density)
    fitting = Progress(cancelled=lambda: fitting.stage == "distill")

    def job(material: Material, progress: Progress) -> Recovery:
        upstream = stamp_of(material.density)
        return recover_stage(take, body, material, points(body, x), FPS, upstream, WEIGHTLESS, progress)[0]

    first = job(RUBBER, NoProgress())
    field = take.file("field.safetensors").read_bytes()
    with pytest.raises(Cancelled):
        job(heavy, fitting)
    assert take.file("field.safetensors").read_bytes() == field
    np.testing.assert_array_equal(read_recovery(take).force_density, first.force_density)
    np.testing.assert_array_equal(job(RUBBER, NoProgress()).force_density, first.force_density)
    # What was solved before the cancel is not solved again.
    events: list[dict[str, Any]] = []
    again = job(heavy, Progress(emit=events.append))
    assert not any("iteration" in event["message"] for event in events if event["stage"] != "distill")
    np.testing.assert_allclose(again.force_density.mean(axis=(0, 1)), 4.0 * first.force_density.mean(axis=(0, 1)), rtol=0.05, atol=20.0)
    np.testing.assert_array_equal(read_recovery(take).force_density, again.force_density)
    assert not take.file(SOLVED).exists() and not take.file(FITTED).exists()


def test_a_disk_that_fills_up_while_the_field_is_written_leaves_the_last_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    body = plate((3, 3, 2))
    x, _ = blow(body, lambda X, t: np.zeros_like(X) + [5.0, 0.0, 0.0], 4)
    take = Take(tmp_path / "leaf.take")
    take.prepare()

    def job(density: float) -> Recovery:
        material = replace(RUBBER, density=density)
        return recover_stage(take, body, material, points(body, x), FPS, stamp_of(density), WEIGHTLESS, NoProgress())[0]

    first = job(400.0)
    field = take.file("field.safetensors").read_bytes()

    def full(*unused: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched, pytest.raises(TakeError, match="No space"):
        patched.setattr("seeing_wind.engine.field.force_field.ForceField.save", full)
        job(800.0)
    assert take.file("field.safetensors").read_bytes() == field
    np.testing.assert_array_equal(read_recovery(take).force_density, first.force_density)
    np.testing.assert_array_equal(job(400.0).force_density, first.force_density)


def test_a_take_that_an_older_engine_left_with_two_runs_in_it_is_done_again(tmp_path: Path) -> None:
    body = plate((3, 3, 2))
    x, _ = blow(body, lambda X, t: np.zeros_like(X) + [5.0, 0.0, 0.0], 4)
    take = Take(tmp_path / "leaf.take")
    take.prepare()

    def job() -> Recovery:
        return recover_stage(take, body, RUBBER, points(body, x), FPS, stamp_of("one"), WEIGHTLESS, NoProgress())[0]

    first = job()
    take.write_arrays("trajectory.npz", to_arrays(replace(first, force_density=4.0 * first.force_density)))
    take.finish("solve", "another", {})
    np.testing.assert_array_equal(job().force_density, first.force_density)


def test_a_further_view_is_a_stage_of_its_own_and_observed_once(project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clips: list[str] = []

    def seen(clip: str, settings: ObserveSettings, progress: Progress, journal: Journal, watch: None, ready: None) -> Observation:
        clips.append(clip)
        return observed(np.pad(np.ones((20, 20), bool), 8), 1.0, clip=clip)

    monkeypatch.setattr("seeing_wind.engine.observe.observe", seen)
    take, told = Take(tmp_path / "a.take"), []
    (project / "aside.mp4").write_bytes(b"aside")
    for _ in range(2):
        for view, name in enumerate(("clip.mp4", "aside.mp4")):
            found, _ = observe_stage(take, str(project / name), ObserveSettings(), Progress(told.append), view)
            assert found.clip == str(project / name)
    assert clips == [str(project / "clip.mp4"), str(project / "aside.mp4")]
    assert take.file("view1.npz").is_file() and {message["stage"] for message in told} == {"observe"}


def test_several_views_are_lifted_once_and_go_on_where_they_were_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopped on the way, the lift ends in the same key points; then it is read, and a file that does not fit is made again."""
    mask = np.zeros((72, 96), bool)
    mask[20:50, 30:60] = True
    seen = observed(mask, 1.0)
    body = build_body(seen)
    targets = [track_targets(seen, body)] * 2
    whole = lift_stage(Take(tmp_path / "whole.take"), seen, body, targets, "up", NoProgress()).lifted
    for pace in ("SOONEST", "COST"):
        monkeypatch.setattr(f"seeing_wind.engine.recovery.journal.{pace}", 0.0)
    take, safe_points = Take(tmp_path / "cut.take"), iter(range(2))
    with pytest.raises(Cancelled):
        lift_stage(take, seen, body, targets, "up", Progress(cancelled=lambda: next(safe_points, None) is None))
    assert list(take.path.glob("checkpoint.*")) and not take.file("lifted.npz").exists()
    found = lift_stage(take, seen, body, targets, "up", NoProgress()).lifted
    np.testing.assert_array_equal(found, whole)
    told: list[dict] = []
    np.testing.assert_array_equal(lift_stage(take, seen, body, targets, "up", Progress(told.append)).lifted, whole)
    assert [message["message"] for message in told] == ["already done"]
    take.write_arrays("lifted.npz", {"lifted": whole[:1]})
    np.testing.assert_array_equal(lift_stage(take, seen, body, targets, "up", Progress(told.append)).lifted, whole)
    assert any("done again" in message["message"] for message in told)


@pytest.mark.parametrize("lost", ["measured", "path", "path_sigma"])
def test_a_file_that_lacks_what_was_seen_of_a_sheet_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: str) -> None:
    """Without what a camera measured, the wind would be found as from exact points, and nothing would say so."""
    mask = np.zeros((72, 96), bool)
    mask[20:50, 30:60] = True
    seen, told = observed(mask, 1.0), list[dict[str, Any]]()
    body = build_body(seen)
    frames, count = len(body.lifted), len(body.particles.x)
    path = np.zeros((frames, count, 3))
    measured = Measured(path, np.zeros((count, 2)), np.zeros((frames, 2, 3, 2, 3)))
    filmed = {"path": path, "path_sigma": np.ones((frames, count)), "measured": measured}
    sheet = replace(body, sheet=Sheet(0.1, 4e-4, 800.0, 1e-5), **filmed)
    monkeypatch.setattr("seeing_wind.engine.stages.build_body", lambda *unused: sheet)
    take = Take(tmp_path / "flag.take")
    take.prepare()
    build_stage(take, seen, "up", BuildSettings(), NoProgress())
    build_stage(take, seen, "up", BuildSettings(), Progress(told.append))
    assert [message["message"] for message in told] == ["already done"]
    take.write_arrays("particles.npz", {key: array for key, array in to_arrays(sheet).items() if key.split(".")[0] != lost})
    again, _ = build_stage(take, seen, "up", BuildSettings(), Progress(told.append))
    assert getattr(again, lost) is not None and any("done again" in message["message"] for message in told)


def test_what_is_seen_does_not_wait_for_the_solver() -> None:
    """Importing torch and Taichi takes longer than looking at a clip."""
    words = "import sys, seeing_wind.engine.command.observe, seeing_wind.engine.observe, seeing_wind.engine.recovery.journal"
    loaded = subprocess.run(
        [sys.executable, "-c", f"{words}; print(*sys.modules)"], check=True, capture_output=True, text=True, cwd=Path(__file__).parents[2]
    ).stdout.split()
    assert "seeing_wind.engine.recovery.journal" in loaded
    assert not {"torch", "taichi", "scipy"} & set(loaded)
