"""The file of jobs, their order and the summary: no engine, no Blender."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.command.batch.delivery import Incoming, files_of, order_of
from seeing_wind.engine.command.batch.in_order import run_in_order
from seeing_wind.engine.command.batch.jobs import FIELD, Job, read_jobs
from seeing_wind.engine.command.batch.summary import Summary
from seeing_wind.engine.command.lock import held
from seeing_wind.engine.conventions import DISTRUST
from seeing_wind.engine.errors import SeeingWindError, TakeError, UsageError
from seeing_wind.engine.progress import Cancelled, NoProgress
from seeing_wind.engine.take import Take

TABLE = '[[job]]\nname = "{0}"\nclip = "clip.mp4"\ntake = "{0}.take"\n'
FULL = """
[[job]]
name = "leaf"
clip = "clip.mp4"
take = "leaf.take"
recover = { box = [20, 20, 44, 44], distance = 2.0 }
edit = "edit.toml"
save = "out/leaf.blend"
"""

VIEW = '[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = { view = ["side.mp4", "side.json", "side.png"] }'


def given(options: str) -> str:
    """A file with one job, which has these options."""
    return f'[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = {{ {options} }}'


@pytest.fixture
def workplace(tmp_path: Path) -> Path:
    """Files that the jobs name."""
    (tmp_path / "clip.mp4").write_bytes(b"a clip")
    for ending in ("mp4", "json", "png"):
        (tmp_path / f"side.{ending}").write_bytes(b"of a further view")
    (tmp_path / "edit.toml").write_text('[[body]]\nname = "leaf"\nmesh = "recovered"\n')
    (tmp_path / "jobs.toml").write_text(FULL)
    return tmp_path


def rows(folder: Path) -> list[dict]:
    return json.loads((folder / "jobs.summary.json").read_text())["jobs"]


def make(job: Job, made: bool) -> None:
    """What stands for the engine: the takes' last files, and their stamp."""
    for take, last in ((job.take, FIELD), (job.edit_take, "resimulation.json")):
        if take is not None:
            take.mkdir(exist_ok=True)
            (take / last).touch()
    if job.edit_take is not None:
        Take(job.edit_take).finish("resimulate", "0", {"edit": str(job.edit)})


def run(folder: Path, do=make, again: bool = False, whole: bool = False) -> int:
    """A batch that `do` does; the exit code."""
    path = folder / "jobs.toml"
    summary = Summary(path, read_jobs(path), whole=whole, again=again)
    run_in_order(summary, do, lambda line: None)
    return summary.exit_code


def stop(job: Job, made: bool) -> None:
    raise Cancelled


def test_a_summary_that_cannot_be_written_is_told_first(workplace):
    (workplace / "jobs.summary.json").mkdir()
    with pytest.raises(UsageError, match="summary"):
        run(workplace, do=lambda job, made: pytest.fail("no job is begun"))


def test_a_failed_job_does_not_stop_the_others_and_is_tried_again(workplace):
    (workplace / "jobs.toml").write_text(TABLE.format("a") + TABLE.format("b") + TABLE.format("c"))
    done = []
    ends = iter([SeeingWindError("No object.", "Draw a box."), RuntimeError("defect"), None, None, None])

    def do(job: Job, made: bool) -> None:
        done.append(job.name)
        end = next(ends)
        if end is not None:
            raise end
        make(job, made)

    assert run(workplace, do) == 1
    assert [row["outcome"] for row in rows(workplace)] == ["failed", "failed", "done"]
    assert [row["message"] for row in rows(workplace)] == ["No object. Draw a box.", "RuntimeError: defect", ""]
    assert run(workplace, do) == 0
    assert done == ["a", "b", "c", "a", "b"] and [row["outcome"] for row in rows(workplace)] == ["done", "done", "skipped"]


def test_a_job_that_needs_the_take_of_a_failed_one_does_not_run_on_an_older_take(workplace):
    later = '[[job]]\nname = "later"\ntake = "a.take"\nedit = "edit.toml"\n'
    (workplace / "jobs.toml").write_text(TABLE.format("a") + later + TABLE.format("b"))
    (workplace / "a.take").mkdir()
    (workplace / "a.take" / FIELD).write_bytes(b"of last week")
    path, begun = workplace / "jobs.toml", []

    def go(recovers: bool) -> list[dict]:
        summary = Summary(path, read_jobs(path), whole=False, again=True)

        def do(job: Job, made: bool) -> None:
            begun.append(job.name)
            if job.name == "a" and recovers:
                summary.recovered.add(job.take)
            if job.name == "a":
                raise SeeingWindError("No object.", "Draw a box.")
            make(job, made)

        run_in_order(summary, do, lambda line: None)
        return rows(workplace)

    ended = go(recovers=False)
    assert begun == ["a", "b"] and [row["outcome"] for row in ended] == ["failed", "failed", "done"]
    assert ended[1]["message"].startswith("Left out: it needs ") and '"a", which makes that, failed' in ended[1]["message"]
    go(recovers=True)  # and failed after that, say where it saves a file
    assert begun[2:] == ["a", "later", "b"]


def test_a_field_of_no_use_is_told_each_time_and_by_the_exit_code(workplace: Path) -> None:
    def useless(job: Job, made: bool) -> None:
        make(job, made)
        notes = ["The tracks are off.", f"{DISTRUST}: 48 pixels off."]
        np.savez(job.take / "trajectory.npz", notes=np.array(json.dumps(notes)))

    for outcome in ("done", "skipped"):
        assert run(workplace, do=useless) == 3
        assert [(row["outcome"], row["warnings"]) for row in rows(workplace)] == [(outcome, [f"{DISTRUST}: 48 pixels off."])]
    again = TABLE.format("b").replace('clip = "clip.mp4"', 'edit = "edit.toml"').replace("b.take", "leaf.take")
    (workplace / "jobs.toml").write_text(again)  # simulates in the same field
    for outcome in ("done", "skipped"):
        assert run(workplace) == 3
        assert [(row["outcome"], row["warnings"]) for row in rows(workplace)] == [(outcome, [f"{DISTRUST}: 48 pixels off."])]
    (workplace / "jobs.toml").write_text(FULL)
    (workplace / "leaf.take" / "trajectory.npz").write_bytes(b"damaged")
    assert run(workplace) == 3
    assert "cannot be read" in rows(workplace)[0]["warnings"][0]


def test_a_cancel_leaves_the_rest_and_forgets_nothing_that_was_done_before(workplace):
    text = TABLE.format("a") + TABLE.format("b")
    (workplace / "jobs.toml").write_text(text)
    assert run(workplace, stop) == 130
    assert [row["outcome"] for row in rows(workplace)] == ["cancelled", "left"]
    assert run(workplace) == 0
    (workplace / "jobs.toml").write_text(text.replace('"a.take"', '"c.take"'))
    assert run(workplace, stop) == 130
    assert run(workplace) == 0
    assert [row["outcome"] for row in rows(workplace)] == ["done", "skipped"]


def test_done_is_what_has_all_its_results_of_the_same_text_and_files(workplace):
    for change in (
        lambda: (workplace / "clip.mp4").write_bytes(b"another clip"),
        lambda: (workplace / "jobs.toml").write_text(FULL.replace("2.0", "3.0")),
        lambda: (workplace / "leaf.take" / FIELD).unlink(),
        lambda: (workplace / "leaf.edit.take" / "resimulation.json").unlink(),
    ):
        assert run(workplace) == 0 and rows(workplace)[0]["message"] == "save and render are left for Blender"
        assert run(workplace) == 0 and rows(workplace)[0]["outcome"] == "skipped"
        change()
    assert run(workplace) == 0 and rows(workplace)[0]["outcome"] == "done"
    assert run(workplace, again=True) == 0 and rows(workplace)[0]["outcome"] == "done"


def test_blender_makes_what_is_left_and_no_take_twice(workplace):
    assert run(workplace) == 0
    were_made = []

    def save(job: Job, made: bool) -> None:
        were_made.append(made)
        assert job.save is not None
        job.save.parent.mkdir(exist_ok=True)
        job.save.touch()

    assert run(workplace, save, whole=True) == 0 and were_made == [True]
    assert run(workplace, save, whole=True) == 0 and rows(workplace)[0]["outcome"] == "skipped"
    assert run(workplace) == 0 and run(workplace, save, whole=True) == 0 and were_made == [True]


def test_a_take_of_another_edit_is_neither_taken_for_done_nor_written_over(workplace):
    assert run(workplace) == 0
    Take(workplace / "leaf.edit.take").finish("resimulate", "1", {"edit": str(workplace / "panel.toml")})
    assert run(workplace) == 1
    assert "holds the re-simulation of another edit" in rows(workplace)[0]["message"] and "panel.toml" in rows(workplace)[0]["message"]


def test_a_mesh_of_an_edit_that_was_changed_is_simulated_again(workplace):
    (workplace / "flag.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (workplace / "edit.toml").write_text('[[body]]\nname = "flag"\nmesh = "flag.obj"\n[[collider]]\nname = "w"\nmesh = "wall.obj"\n')
    job = read_jobs(workplace / "jobs.toml")[0]
    first = job.takes_digest()
    assert job.takes_digest() == first
    for name in ("flag.obj", "wall.obj"):
        (workplace / name).write_text("v 0 0 0\nv 2 0 0\nv 0 1 0\nv 1 1 1\nf 1 2 3\n")
        assert job.takes_digest() != first
        first = job.takes_digest()


def test_options_become_words(workplace):
    clip, edit, take, edit_take = (str(workplace / name) for name in ("clip.mp4", "edit.toml", "leaf.take", "leaf.edit.take"))
    assert read_jobs(workplace / "jobs.toml")[0].calls() == [
        ["recover", clip, "--take", take, "--box", "20", "20", "44", "44", "--distance", "2.0"],
        ["resimulate", take, "--edit", edit, "--take", edit_take],
    ]
    (workplace / "jobs.toml").write_text(
        '[[job]]\ntrajectories = "clip.mp4"\ntake = "t"\nrecover = { no_gravity = true, mask = "x/../m.png", seed = 4, pin = false }\n'
    )
    (workplace / "m.png").touch()
    ((verb, *options),) = read_jobs(workplace / "jobs.toml")[0].calls()
    assert verb == "recover-trajectories" and options[3:] == ["--no-gravity", "--mask", str(workplace / "m.png"), "--seed", "4"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "it is empty"),
        ("x = 3", r"has no \[\[job\]\], only x"),
        ('[[jobs]]\ntake = "t"', r"has no \[\[job\]\], only jobs"),
        ('[job]\ntake = "t"', r'job is \{"take" = "t"\}, not a list of \[\[job\]\]'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = { no_gravity = "yes" }', r'no_gravity in recover of "job 1" is "yes"'),
        ("[[job]", "not valid TOML"),
        ('[[job]]\nclip = "clip.mp4"', "no take"),
        ('[[job]]\ntake = "t"', '"job 1" has nothing to do'),
        ('[[job]]\ntake = "made.take"', '"job 1" has nothing to do'),
        ('[[job]]\ntake = "t"\nedit = "edit.toml"', "neither a clip nor"),
        ('[[job]]\ntake = "t"\nclip = "none.mp4"', "no file"),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\ncolour = "red"', "unknown key colour"),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\ntrajectories = "clip.mp4"', "a clip and trajectories"),
        ('[[job]]\ntake = "t"\ntrajectories = "clip.mp4"\nrender = "a.mp4"', "goes over a clip"),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrender = "a.avi"', "a.avi cannot be written"),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = { material = "leef" }', "no material 'leef'"),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = { mask = "m.png" }', r'mask of "job 1": there is no file'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = { mask = ["m.png"] }', r'is \["m.png"\]\. Write the path of one file in'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = { material = 3 }', r'is 3\. Write the name of one material, such as "leaf"'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = { outline_model = "n.tgz" }', r'outline_model of "job 1": there is no file'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = { outline_model = 3 }', r'outline_model in recover of "job 1" is 3'),
        (given('outline_model = ""'), r'outline_model in recover of "job 1" is ""\. Write the path of one file, or "none", in quotation'),
        (given('depth_model = ""'), r'depth_model in recover of "job 1" is ""\. Write the name of one network in quotation marks'),
        (given('body = " "'), r'body in recover of "job 1" is " "\. Write the path of one folder in quotation marks'),
        (VIEW.replace("side.json", "none.json"), r'view of "job 1": there is no file \S*none\.json'),
        (VIEW.replace("side.mp4", "none.mp4"), r'view of "job 1": there is no file \S*none\.mp4'),
        (VIEW.replace('view = ["side.mp4", ', "view = ["), r'view in recover of "job 1" is \["side.json", "side.png"\]'),
        (VIEW.replace('view = ["side.mp4", "side.json", "side.png"]', "view = []"), r'view in recover of "job 1" is \[\]'),
        ('[[job]]\ntake = "made.take"\nrecover = { distance = 2.0 }', '"job 1" has a table recover, but nothing to recover'),
        ('[[job]]\ntake = "made.take"\nedit = "edit.toml"\nrecover = {}', '"job 1" has a table recover, but nothing to recover'),
        ('[[job]]\ntake = "clip.mp4"\nclip = "clip.mp4"', r'take of "job 1", \S*clip.mp4, cannot be written: \S*clip.mp4 is not a folder'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nsave = "made.blend"', r'save of "job 1", \S*made.blend, is a folder'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrender = "made.mp4"', r'render of "job 1", \S*made.mp4, is a folder'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nsave = "edit.toml/x/a.blend"', r"cannot be written: \S*edit.toml is not a folder"),
        pytest.param(
            f'[[job]]\ntake = "t"\nclip = "clip.mp4"\nsave = "{"x" * 300}.blend"', 'save of "job 1" cannot be written: File name too long',
            marks=pytest.mark.skipif(os.name == "nt", reason="Windows has other words for it"),
        ),
        (FULL + 'edit_take = "leaf.take"', r'The edit_take of "leaf" is the take of "leaf", \S*leaf.take'),
        (FULL + 'edit_take = "b.take"\n' + TABLE.format("b"), r'The edit_take of "leaf" is the take of "b"'),
        (FULL + 'edit_take = "leaf.take/edit"', r'"leaf" writes \S*edit, which is inside the take \S*leaf.take\.'),
        (FULL + TABLE.format("b").replace("b.take", "leaf.edit.take/b.take"), r'"b" writes \S*b.take, which is inside the take'),
        (FULL + TABLE.format("b") + 'edit = "edit.toml"\nedit_take = "leaf.edit.take"', '"leaf" and "b" both write'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = { objects = "none.json" }', r'objects of "job 1": there is no file'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = { body = "none.take" }', r'body of "job 1": there is no folder'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nsave = "a.blend.zip"', r'save of "job 1": a.blend.zip cannot be saved'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrender = "clip.mp4"', r'"job 1" would write \S*clip\.mp4, which "job 1" reads'),
        ('[[job]]\ntake = "t"\nclip = "shot_%04d.png"', "there are no images"),
        ('[[job]]\ntake = 3\nclip = "clip.mp4"', "take of job 1 is 3"),
        ('[[job]]\nname = ""\ntake = "t"\nclip = "clip.mp4"', 'name of job 1 is ""'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = "box"', 'recover of "job 1" is "box", not a table'),
        (given("frames = [0, 5]"), r'frames in recover of "job 1" is \[0, 5\]\.'),
        (given('box = "1 2 3 4"'), r'box in recover of "job 1" is "1 2 3 4"\.'),
        (given("box = [20, 20]"), r'box in recover of "job 1" is \[20, 20\]\.'),
        (given("distance = true"), r'distance in recover of "job 1" is true\.'),
        (given("distance = [2.0]"), r'distance in recover of "job 1" is \[2\.0\]\.'),
        (given("particles = 1e2"), r'particles in recover of "job 1" is 100\.0\. Write a whole number without .*, such as 100\.'),
        (given("particles = inf"), r'particles in recover of "job 1" is inf\. Write a whole number without a point or exponent\.'),
        (given("points = [12, 20]"), r'points in recover of "job 1" is \[12, 20\]\.'),
        ('[[job]]\nname = "a"\ntake = "t"\nclip = "clip.mp4"\n[[job]]\nname = "a"\ntake = "u"\nclip = "clip.mp4"', "Two jobs"),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\n[[job]]\ntake = "t"\nclip = "edit.toml"', '"job 1" and "job 2" recover different'),
        ('[[job]]\ntake = "t"\nclip = "clip.mp4"\nsave = "a.blend"\n[[job]]\ntake = "u"\nclip = "clip.mp4"\nsave="a.blend"', "both write"),
    ],
)
def test_wrong_files_are_refused_before_anything_is_done(workplace, text, says):
    for name in ("made.take", "made.blend", "made.mp4"):
        (workplace / name).mkdir()
    (workplace / "made.take" / FIELD).touch()
    (workplace / "jobs.toml").write_text(text)
    with pytest.raises(UsageError, match=says):
        read_jobs(workplace / "jobs.toml")


def test_a_file_that_a_job_above_makes_need_not_be_there(workplace: Path) -> None:
    below = TABLE.format("b") + 'recover = { pin = "a.take/held.png" }\n'
    (workplace / "jobs.toml").write_text(TABLE.format("a") + below)
    assert len(read_jobs(workplace / "jobs.toml")) == 2
    (workplace / "jobs.toml").write_text(below + TABLE.format("a"))
    with pytest.raises(UsageError, match='pin of "b": there is no file'):
        read_jobs(workplace / "jobs.toml")


def test_a_network_is_found_from_the_file_of_jobs_and_none_is_no_file(workplace: Path) -> None:
    (workplace / "net.tgz").touch()
    for said, meant in (('"net.tgz"', str(workplace / "net.tgz")), ('"none"', "none"), ("false", "none")):
        (workplace / "jobs.toml").write_text(f'[[job]]\ntake = "t"\nclip = "clip.mp4"\nrecover = {{ outline_model = {said} }}')
        (job,) = read_jobs(workplace / "jobs.toml")
        assert job.recover["outline_model"] == meant
        assert [key for key, _ in job.named_files()] == (["outline_model"] if meant != "none" else [])


def test_networks_go_to_a_node_and_none_does_not(workplace: Path) -> None:
    (workplace / "net.tgz").touch()
    (workplace / "depth" / "more").mkdir(parents=True)
    files = [workplace / "depth" / "config.json", workplace / "depth" / "more" / "model.safetensors"]
    for file in files:
        file.touch()

    def sent(*options: str) -> tuple[list[str], list[Path], list[str]]:
        """What is a path in the order for a node; the files that are sent with it, without the clip; the words of the call."""
        (workplace / "jobs.toml").write_text(given(", ".join(options)))
        (job,) = read_jobs(workplace / "jobs.toml")
        order = order_of(job, 1, shared=False)
        return order.paths[2:], files_of(job)[1:], order.calls[0][4:]

    archive = str(workplace / "net.tgz")
    assert sent('outline_model = "net.tgz"') == ([archive], [workplace / "net.tgz"], ["--outline-model", archive])
    for key in ("outline_model", "depth_model"):
        folder = str(workplace / "depth")
        assert sent(f'{key} = "depth"') == ([folder], files, [f"--{key.replace('_', '-')}", folder])
    assert sent('outline_model = "none"', 'depth_model = "apple/DepthPro-hf"') == (
        [], [], ["--outline-model", "none", "--depth-model", "apple/DepthPro-hf"]
    )  # fmt: skip
    assert sent() == ([], [], [])


def test_further_views_are_found_from_the_file_of_jobs(workplace: Path) -> None:
    side = [str(workplace / f"side.{ending}") for ending in ("mp4", "json", "png")]
    two = VIEW.replace("view = [", "view = [[").replace("] }", '], ["side.mp4", "side.json", "side.png"]] }')
    for text, count in ((VIEW, 1), (two, 2)):
        (workplace / "jobs.toml").write_text(text)
        (job,) = read_jobs(workplace / "jobs.toml")
        assert job.calls()[0][4:] == ["--view", *side] * count
    before = job.digest()
    (workplace / "side.png").write_bytes(b"drawn once more, larger")
    assert job.digest() != before
    (workplace / "side.mp4").unlink()
    (workplace / "shots").mkdir()
    (workplace / "jobs.toml").write_text(VIEW.replace("side.mp4", "shots"))
    with pytest.raises(UsageError, match='view of "job 1": there is no file'):
        read_jobs(workplace / "jobs.toml")
    (workplace / "shots" / "0.png").touch()
    assert len(read_jobs(workplace / "jobs.toml")) == 1


def test_a_body_may_be_that_of_a_job_above(workplace: Path) -> None:
    (workplace / "jobs.toml").write_text(TABLE.format("a") + TABLE.format("b") + 'recover = { body = "a.take" }\n')
    assert read_jobs(workplace / "jobs.toml")[1].calls()[0][4:] == ["--body", str(workplace / "a.take")]


def test_a_take_from_a_node_takes_the_place_of_a_folder_of_inputs_but_not_of_one_in_use(tmp_path: Path) -> None:
    folder = tmp_path / "leaf.take"
    folder.mkdir()
    (folder / "mask.png").write_bytes(b"sent with the job, and returned")
    for content in (b"first", b"second"):
        incoming = Incoming([str(folder)], NoProgress())
        for name in (FIELD, "mask.png"):
            incoming.write(str(folder), name, content)
        if content == b"second":
            with held(Take(folder), "recover", NoProgress()), pytest.raises(TakeError, match="is in use"):
                incoming.accept()
        else:
            incoming.accept()
        assert (folder / FIELD).read_bytes() == b"first"


def test_a_job_s_options_name_no_other_take(workplace: Path) -> None:
    (workplace / "jobs.toml").write_text(FULL.replace("distance = 2.0", 'take = "x"'))
    with pytest.raises(UsageError, match="names a take"):
        read_jobs(workplace / "jobs.toml")
