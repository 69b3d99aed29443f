"""Many clips and edits from one file of jobs, on the stand-in for the engine."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import extension
import pytest

from seeing_wind.engine.command.batch.jobs import read_jobs
from seeing_wind.engine.command.batch.summary import Summary
from seeing_wind.engine.take import Take
from seeing_wind.ui import commands
from seeing_wind.ui.composite.nodes import is_set_up

JOBS = """
[[job]]
name = "leaf"
clip = "clip.mp4"
take = "leaf.take"
recover = { box = [20, 20, 44, 44], distance = 2.0 }
edit = "edit.toml"
save = "out/leaf.blend"
"""


@pytest.fixture
def workplace(clean_file, tmp_path, monkeypatch) -> Path:
    """A clip, an edit and a file of jobs; the stand-in in the engine's place."""
    extension.make_clip(tmp_path / "clip.mp4")
    (tmp_path / "edit.toml").write_text('gravity = [0, 0, -9.81]\n[[body]]\nname = "leaf"\nmesh = "recovered"\nmass_scale = 1.0\n')
    (tmp_path / "jobs.toml").write_text(JOBS)
    with extension.switched_on(monkeypatch, tmp_path):
        yield tmp_path


def rows(folder: Path) -> list[dict]:
    return json.loads((folder / "jobs.summary.json").read_text())["jobs"]


def test_a_job_runs_from_clip_to_file_and_is_not_done_twice(workplace, capsys):
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 0
    assert [row["outcome"] for row in rows(workplace)] == ["done"] and "1 of 1 jobs are done" in capsys.readouterr().out
    bpy.ops.wm.open_mainfile(filepath=str(workplace / "out" / "leaf.blend"))
    assert bpy.context.scene.seeing_wind.field_object is not None
    assert len(bpy.data.objects["leaf"].data.shape_keys.key_blocks) == 13
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 0
    assert rows(workplace)[0]["outcome"] == "skipped"
    # a changed edit makes it new
    (workplace / "edit.toml").write_text((workplace / "edit.toml").read_text().replace("1.0", "2.0"))
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 0
    assert rows(workplace)[0]["outcome"] == "done"


def test_a_job_that_breaks_does_not_stop_the_others(workplace, capsys):
    """The first is saved below what is a file by then, the last in the place of what is a folder by then."""
    (workplace / "jobs.toml").write_text(
        '[[job]]\nname = "a"\nclip = "clip.mp4"\ntake = "a.take"\nsave = "a.take/take.toml/a.blend"\n'
        '[[job]]\nname = "b"\nclip = "clip.mp4"\ntake = "b.take"\nsave = "b.blend/b.blend"\n'
        '[[job]]\nname = "c"\nclip = "clip.mp4"\ntake = "c.take"\nsave = "b.blend"\n'
    )
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 1
    assert [row["outcome"] for row in rows(workplace)] == ["failed", "done", "failed"]
    assert all("cannot be saved" in row["message"] for row in rows(workplace)[::2]) and (workplace / "b.blend" / "b.blend").is_file()
    assert "1 of 3 jobs are done" in capsys.readouterr().out


def test_a_file_of_jobs_that_the_engine_refuses_is_not_begun(workplace, monkeypatch, capsys):
    monkeypatch.setenv("SEEING_WIND_FAKE", "refused")
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 2
    assert "Error: " in capsys.readouterr().err
    assert not (workplace / "jobs.summary.json").exists() and not (workplace / "leaf.take").exists()


def test_a_failed_job_says_what_the_engine_said(workplace, monkeypatch):
    (workplace / "jobs.toml").write_text('[[job]]\nname = "a"\nclip = "clip.mp4"\ntake = "a.take"\n')
    monkeypatch.setenv("SEEING_WIND_FAKE", "error")
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 1
    assert rows(workplace)[0]["message"].startswith("The box lies outside the frame of 480 x 270 pixels. Draw it")


def test_a_take_of_another_edit_is_neither_taken_for_done_nor_written_over(workplace):
    """Such as one that was re-simulated in the panel, which takes the same name."""
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 0
    Take(workplace / "leaf.edit.take").finish("resimulate", "1", {"edit": str(workplace / "panel.toml")})
    bodies = (workplace / "leaf.edit.take" / "bodies" / "leaf.npz").stat().st_mtime_ns
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 1
    said = rows(workplace)[0]["message"]
    assert "re-simulation of another edit" in said and "panel.toml" in said
    assert (workplace / "leaf.edit.take" / "bodies" / "leaf.npz").stat().st_mtime_ns == bodies


def test_takes_that_the_engine_made_are_not_made_again(workplace):
    """The engine's batch, here or on a farm, leaves save and render for Blender's."""
    jobs = workplace / "jobs.toml"
    assert commands.main(["batch", str(jobs)]) == 0
    (workplace / "out" / "leaf.blend").unlink()
    (job,) = read_jobs(jobs)
    Summary(jobs, [job], whole=False, again=True).end(job, "done", 1.0)
    assert rows(workplace)[0]["message"] == "save and render are left for Blender" and rows(workplace)[0]["digest"] == ""
    field = (workplace / "leaf.take" / "field.safetensors").stat().st_mtime_ns
    assert commands.main(["batch", str(jobs)]) == 0
    assert rows(workplace)[0]["outcome"] == "done" and (workplace / "out" / "leaf.blend").is_file()
    assert (workplace / "leaf.take" / "field.safetensors").stat().st_mtime_ns == field


def test_bake_makes_a_file_of_takes_that_are_there(workplace):
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 0
    out = workplace / "baked.blend"
    takes = [str(workplace / "leaf.take"), "--edit-take", str(workplace / "leaf.edit.take"), "--clip", str(workplace / "clip.mp4")]
    assert commands.main(["bake", *takes, "--composite", "--save", str(out)]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(out))
    assert len(bpy.data.objects["leaf"].data.shape_keys.key_blocks) == 13 and is_set_up(bpy.context.scene)
    for wrong in ([], ["a.take"], ["a.take", "--save", "x.txt"], ["a.take", "--save", "x.blend", "--more"]):
        assert commands.main(["bake", *wrong]) == 2


def test_several_edits_of_one_clip(workplace):
    once = '[[job]]\nname = "field"\nclip = "clip.mp4"\ntake = "a.take"\n'
    edit = '[[job]]\nname = "{0}"\n{1}take = "a.take"\nedit = "edit.toml"\nedit_take = "{0}.take"\n'
    (workplace / "jobs.toml").write_text(once + edit.format("one", "") + edit.format("two", 'clip = "clip.mp4"\n'))
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 0
    assert [row["outcome"] for row in rows(workplace)] == ["done", "done", "done"]
    assert all((workplace / f"{name}.take" / "bodies" / "leaf.npz").is_file() for name in ("one", "two"))


@pytest.mark.parametrize("argv", [["batch"], ["batch", "--again"], ["batch", "a.toml", "b.toml"], ["batch", "no.toml"]])
def test_wrong_usage(workplace, argv):
    assert commands.main(argv) == 2
