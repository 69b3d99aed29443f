"""Many clips and edits from one file of jobs, on the stand-in for the engine."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import extension
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.ui import batch, commands

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


def test_a_failed_job_does_not_stop_the_others_and_is_tried_again(workplace, capsys):
    (workplace / "jobs.toml").write_text(
        '[[job]]\nname = "a"\nclip = "clip.mp4"\ntake = "a.take"\n[[job]]\nname = "b"\nclip = "clip.mp4"\ntake = "b.take"\n'
    )
    codes = iter([1, 0, 0])
    done = []

    def do(job: batch.Job) -> int:
        done.append(job.name)
        job.take.mkdir(exist_ok=True)
        (job.take / "field.safetensors").touch()
        return next(codes)

    assert batch.run(workplace / "jobs.toml", do, lambda line: None) == 1
    assert [row["outcome"] for row in rows(workplace)] == ["failed", "done"]
    assert batch.run(workplace / "jobs.toml", do, lambda line: None) == 0
    assert done == ["a", "b", "a"] and [row["outcome"] for row in rows(workplace)] == ["done", "skipped"]


def test_a_cancel_leaves_the_rest(workplace):
    (workplace / "jobs.toml").write_text(
        '[[job]]\nname = "a"\nclip = "clip.mp4"\ntake = "a.take"\n[[job]]\nname = "b"\nclip = "clip.mp4"\ntake = "b.take"\n'
    )
    assert batch.run(workplace / "jobs.toml", lambda job: 130, lambda line: None) == 130
    assert [row["outcome"] for row in rows(workplace)] == ["cancelled", "left"]


def test_a_cancel_forgets_nothing_of_what_was_done_before(workplace):
    text = '[[job]]\nname = "a"\nclip = "clip.mp4"\ntake = "a.take"\n[[job]]\nname = "b"\nclip = "clip.mp4"\ntake = "b.take"\n'
    (workplace / "jobs.toml").write_text(text)
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 0
    (workplace / "jobs.toml").write_text(text.replace('"a.take"', '"c.take"'))
    assert batch.run(workplace / "jobs.toml", lambda job: 130, lambda line: None) == 130
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 0
    assert [row["outcome"] for row in rows(workplace)] == ["done", "skipped"]


def test_a_job_that_breaks_does_not_stop_the_others(workplace, capsys):
    (workplace / "a file").write_text("no folder")
    (workplace / "jobs.toml").write_text(
        '[[job]]\nname = "a"\nclip = "clip.mp4"\ntake = "a.take"\nsave = "a file/a.blend"\n'
        '[[job]]\nname = "b"\nclip = "clip.mp4"\ntake = "b.take"\nsave = "b.blend"\n'
        '[[job]]\nname = "c"\nclip = "clip.mp4"\ntake = "c.take"\nsave = "folder.blend"\n'
    )
    (workplace / "folder.blend").mkdir()
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 1
    assert [row["outcome"] for row in rows(workplace)] == ["failed", "done", "failed"]
    assert all("cannot be saved" in row["message"] for row in rows(workplace)[::2]) and (workplace / "b.blend").is_file()
    assert "1 of 3 jobs are done" in capsys.readouterr().out
    # a defect in one of them too
    order = iter([RuntimeError("defect"), 0, 0])

    def do(job: batch.Job) -> int:
        now = next(order)
        if isinstance(now, Exception):
            raise now
        return now

    assert batch.run(workplace / "jobs.toml", do, lambda line: None, again=True) == 1
    assert [row["message"] for row in rows(workplace)] == ["RuntimeError: defect", "", ""]


def test_a_mesh_of_an_edit_that_was_changed_is_simulated_again(workplace):
    (workplace / "flag.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (workplace / "edit.toml").write_text('[[body]]\nname = "flag"\nmesh = "flag.obj"\n[[collider]]\nname = "w"\nmesh = "wall.obj"\n')
    job = batch.read_jobs(workplace / "jobs.toml")[0]
    first = job.digest()
    assert job.digest() == first
    for name in ("flag.obj", "wall.obj"):
        (workplace / name).write_text("v 0 0 0\nv 2 0 0\nv 0 1 0\nv 1 1 1\nf 1 2 3\n")
        assert job.digest() != first
        first = job.digest()


def test_several_edits_of_one_clip(workplace):
    once = '[[job]]\nname = "field"\nclip = "clip.mp4"\ntake = "a.take"\n'
    edit = '[[job]]\nname = "{0}"\n{1}take = "a.take"\nedit = "edit.toml"\nedit_take = "{0}.take"\n'
    (workplace / "jobs.toml").write_text(once + edit.format("one", "") + edit.format("two", 'clip = "clip.mp4"\n'))
    assert commands.main(["batch", str(workplace / "jobs.toml")]) == 0
    assert [row["outcome"] for row in rows(workplace)] == ["done", "done", "done"]
    assert all((workplace / f"{name}.take" / "bodies" / "leaf.npz").is_file() for name in ("one", "two"))


def test_options_become_words(workplace):
    job = batch.read_jobs(workplace / "jobs.toml")[0]
    assert job.recover_options() == [
        str(workplace / "clip.mp4"), "--take", str(workplace / "leaf.take"), "--box", "20", "20", "44", "44", "--distance", "2.0",
    ]  # fmt: skip
    assert job.edit_take == workplace / "leaf.edit.take"
    (workplace / "jobs.toml").write_text(
        '[[job]]\nclip = "clip.mp4"\ntake = "t"\nrecover = { no_gravity = true, mask = "m.png", seed = 4 }\n'
    )
    assert batch.read_jobs(workplace / "jobs.toml")[0].recover_options()[3:] == [
        "--no-gravity", "--mask", str(workplace / "m.png"), "--seed", "4",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no \\[\\[job\\]\\]"),
        ("x = 3", "no \\[\\[job\\]\\]"),
        ("[[job]", "no TOML"),
        ('[[job]]\nclip = "clip.mp4"', "no take"),
        ('[[job]]\ntake = "t"', "neither a clip nor"),
        ('[[job]]\ntake = "t"\nclip = "none.mp4"', "no file"),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\ncolour = "red"', "unknown key colour"),
        ('[[job]]\ntake = 3\nclip = "clip.mp4"', "no text"),
        ('[[job]]\nname = "a"\ntake = "t"\nclip = "clip.mp4"\n[[job]]\nname = "a"\ntake = "u"\nclip = "clip.mp4"', "Two jobs"),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\n[[job]]\ntake = "t"\nclip = "edit.toml"', "job 1 and job 2 recover different"),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nsave = "a"\n[[job]]\ntake = "u"\nclip = "clip.mp4"\nsave = "a"', "both write"),
    ],
)
def test_wrong_files_are_refused_before_anything_is_done(workplace, text, says):
    (workplace / "jobs.toml").write_text(text)
    with pytest.raises(UsageError, match=says):
        batch.read_jobs(workplace / "jobs.toml")


@pytest.mark.parametrize("argv", [["batch"], ["batch", "--again"], ["batch", "a.toml", "b.toml"], ["batch", "no.toml"]])
def test_wrong_usage(workplace, argv):
    assert commands.main(argv) == 2
