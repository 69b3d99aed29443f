"""What `sample`, `export` and `resimulate` do with a take: their results, and what they say of one that is useless or damaged."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from benchmarks.scenes.gusts import GustField
from seeing_wind.engine.conventions import DISTRUST, DRAFT
from seeing_wind.engine.field.confidence import ConfidenceMap
from seeing_wind.engine.field.representations.point import ForceFieldPoint
from seeing_wind.engine.take import Take


def test_a_take_without_a_field_cannot_be_sampled(engine, tmp_path: Path) -> None:
    np.save(tmp_path / "p.npy", np.zeros((3, 3)))
    error = engine("sample", tmp_path, "--points", tmp_path / "p.npy", "--frame", 0, "--out", tmp_path / "o.npz", expect=2)[-2]
    assert "no recovered field" in error["message"] and not (tmp_path / "o.npz").exists()


def test_samples_say_how_far_from_the_object_they_are(engine, tmp_path: Path) -> None:
    x = np.random.default_rng(0).uniform(size=(4, 50, 3))
    seen = ConfidenceMap(x, np.ones((4, 50)), 0.02)
    for name in ("field", "wind"):
        field = ForceFieldPoint(np.array([[0.0] * 3, [1.0] * 3]), 25.0, 4, x, np.ones((4, 50, 3)), seen)
        field.kind = {"field": "force"}.get(name, name)
        field.save(tmp_path / f"{name}.safetensors")
    np.save(tmp_path / "p.npy", np.array([x[2, 7], [0.5, 0.5, 3.0]]))
    engine("sample", tmp_path, "--points", tmp_path / "p.npy", "--frame", 2, "--out", tmp_path / "o.npz", expect=0)
    with np.load(tmp_path / "o.npz") as found:
        assert found["distance"] == pytest.approx([0.0, np.linalg.norm(x[2] - [0.5, 0.5, 3.0], axis=1).min() - 0.01])
        np.testing.assert_array_equal(found["wind_distance"], found["distance"])


def test_a_field_that_fades_is_weaker_away_from_the_object_in_samples_and_exports(engine, tmp_path: Path) -> None:
    x = np.random.default_rng(0).uniform(0.0, 0.1, (4, 50, 3))
    box = np.array([[0.0] * 3, [1.0] * 3])
    for name in ("field", "wind"):
        field = ForceFieldPoint(box, 25.0, 4, x, 3.0 + x, ConfidenceMap(x, np.ones((4, 50)), 0.02))
        field.kind = {"field": "force"}.get(name, name)
        field.save(tmp_path / f"{name}.safetensors")
    np.save(tmp_path / "p.npy", np.array([x[2, 7], [0.3, 0.3, 0.3], [0.9, 0.9, 0.9], [0.05, 0.05, -0.2]]))
    found = {}
    for out, fades in (("whole", []), ("faded", ["--fade", 0.6])):
        engine("sample", tmp_path, "--points", tmp_path / "p.npy", "--frame", 2, "--out", tmp_path / f"{out}.npz", *fades, expect=0)
        engine("export", tmp_path, "--format", "npz", "--out", tmp_path / f"{out}_box.npz", *fades, expect=0)
        found[out] = [dict(np.load(tmp_path / f"{out}{of}.npz")) for of in ("", "_box")]

    def left(distance):
        t = np.clip(distance / 0.6, 0.0, 1.0)
        return (1.0 - t * t * (3.0 - 2.0 * t))[..., None]

    (whole, whole_box), (faded, faded_box) = found["whole"], found["faded"]
    beside, away = left(np.array([0.0, 0.0, 0.0, 0.2])), field.away(np.clip(np.load(tmp_path / "p.npy"), *box), 2)[0]
    for key in ("force_density", "wind_velocity"):
        np.testing.assert_allclose(faded[key], whole[key] * left(away) * beside)
        share = np.stack([left(field.away(whole_box["points"], t)[0]) for t in range(4)])
        np.testing.assert_allclose(faded_box[key], whole_box[key] * share)
        assert (share > 0.9).any() and (share < 0.1).any()
    for key in ("confidence", "distance"):
        np.testing.assert_array_equal(faded[key], whole[key])
    said = engine("sample", tmp_path, "--points", tmp_path / "p.npy", "--frame", 2, "--out", tmp_path / "o.npz", "--fade", 0, expect=2)[-2]
    assert "--fade" in said["message"] and "above 0" in said["message"]


def test_a_useless_field_is_told_and_used_all_the_same(engine, windy: Path, tmp_path: Path) -> None:
    (tmp_path / "edit.toml").write_text('[[body]]\nname = "flag"\nmesh = "flag.obj"\nmaterial = "cotton"\n')
    (tmp_path / "flag.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0.1 0.1 0\nf 1 2 4 3\n")
    verbs = (
        ["sample", windy, "--points", tmp_path / "p.npy", "--frame", 0, "--out", tmp_path / "o.npz"],
        ["export", windy, "--format", "ply", "--out", tmp_path / "o"],
        ["resimulate", windy, "--edit", tmp_path / "edit.toml", "--take", tmp_path / "r.take"],
    )
    bad = f"{DISTRUST}: 48 pixels off."
    draft = f"The field of {windy} is a draft, from one iteration: what is made from it is as rough."
    for notes, told in ((None, []), (["A note."], []), (["A note.", bad], [bad]), ([bad, f"{DRAFT}, from one iteration."], [bad, draft])):
        if notes is not None:
            Take(windy).write_arrays("trajectory.npz", {"notes": np.array(json.dumps(notes))})
        for verb in verbs:
            messages = engine(*verb, expect=0)
            said = [one["message"] for one in messages if one["type"] == "warning"]
            assert [one for one in said if DISTRUST in one or "draft" in one] == told


def test_a_useless_field_of_a_clip_is_told_with_its_frames_counted_as_in_the_file(engine, windy: Path, tmp_path: Path) -> None:
    notes = [f"In frame 3 it is 48 pixels off. {DISTRUST}: check."]
    Take(windy).write_arrays("trajectory.npz", {"notes": np.array(json.dumps(notes))})
    sample = ["sample", windy, "--points", tmp_path / "p.npy", "--frame", 0, "--out", tmp_path / "o.npz"]
    for first, told in ((None, notes), (20, [f"In frame 23 of the file it is 48 pixels off. {DISTRUST}: check."])):
        if first is not None:
            Take(windy).write_arrays("observation.npz", {"first_frame": np.array(first)})
        assert [one["message"] for one in engine(*sample, expect=0) if one["type"] == "warning" and DISTRUST in one["message"]] == told
    Take(windy).file("observation.npz").write_bytes(b"no arrays")
    said = " ".join(one.get("message", "") for one in engine(*sample, expect=0))
    assert "The first frame in" in said and "cannot be read" in said


def test_a_further_field_that_is_none_is_refused_before_a_batch(engine, windy: Path, tmp_path: Path) -> None:
    (tmp_path / "flag.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0.1 0.1 0\nf 1 2 4 3\n")
    body = '[[body]]\nname = "flag"\nmesh = "flag.obj"\nmaterial = "cotton"\n'
    (tmp_path / "edit.toml").write_text(body + '[[further_field]]\nfile = "flag.obj"\n')
    (tmp_path / "jobs.toml").write_text(f'[[job]]\nname = "a"\ntake = "{windy.name}"\nedit = "edit.toml"\n')
    said = engine("batch", tmp_path / "jobs.toml", "--check", expect=2)[-2]
    assert "flag.obj cannot be read as a field" in said["message"] and "field.safetensors or wind.safetensors" in said["hint"]


def test_a_damaged_further_field_is_told_with_its_take(engine, windy: Path, tmp_path: Path) -> None:
    (tmp_path / "flag.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0.1 0.1 0\nf 1 2 4 3\n")
    edit = '[[body]]\nname = "flag"\nmesh = "flag.obj"\n[[further_field]]\nfile = "other.take/field.safetensors"\n'
    (tmp_path / "edit.toml").write_text(edit)
    (tmp_path / "other.take").mkdir()
    whole = (windy / "field.safetensors").read_bytes()
    box = b"[[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]"
    for content, says in (
        (whole[: len(whole) // 2], "cannot be read as a field"),
        (whole.replace(b'"fps"', b'"fpz"'), "it lacks fps."),
        (whole.replace(box, box.replace(b"1.0", b"0.0")), "two corners (2, 3) in metres, the lower one first."),
    ):
        (tmp_path / "other.take" / "field.safetensors").write_bytes(content)
        said = engine("resimulate", windy, "--edit", tmp_path / "edit.toml", "--take", tmp_path / "r.take", expect=2)[-2]
        assert "other.take" in said["message"] and says in said["message"] and ".." not in said["message"]
        assert "run `recover` for that take again" in said["hint"]


def test_a_useless_further_field_is_told(engine, windy: Path, tmp_path: Path) -> None:
    other, bad = tmp_path / "other.take", f"{DISTRUST}: 48 pixels off."
    shutil.copytree(windy, other, ignore=lambda *_: [other.name])
    Take(other).write_arrays("trajectory.npz", {"notes": np.array(json.dumps([bad]))})
    fields = 2 * '[[further_field]]\nfile = "other.take/field.safetensors"\n'  # told once
    (tmp_path / "edit.toml").write_text(f'[[body]]\nname = "flag"\nmesh = "flag.obj"\nmaterial = "cotton"\n{fields}')
    (tmp_path / "flag.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0.1 0.1 0\nf 1 2 4 3\n")
    messages = engine("resimulate", windy, "--edit", tmp_path / "edit.toml", "--take", tmp_path / "r.take", expect=0)
    assert [one["message"] for one in messages if one["type"] == "warning" and DISTRUST in one["message"]] == [bad]


def test_a_field_that_acts_twice_is_told(engine, windy: Path, tmp_path: Path) -> None:
    other, own = tmp_path / "other.take", windy / "field.safetensors"
    other.mkdir()
    wind = GustField(1, np.array([[0.0] * 3, [1.0] * 3]), 25.0, 4, np.zeros(3), 2.0, wavelength=1.0, period=0.8)
    wind.kind = "wind"
    wind.save(other / "wind.safetensors")
    copy = GustField(2, np.array([[0.0] * 3, [1.0] * 3]), 25.0, 4, np.zeros(3), 2.0, wavelength=1.0, period=0.8)
    copy.save(other / "field.safetensors")
    shutil.copy(other / "field.safetensors", tmp_path / "copy.safetensors")
    np.save(tmp_path / "place.npy", np.tile(np.eye(4) + 0.5 * np.eye(4, k=3), (4, 1, 1)))
    (tmp_path / "flag.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0.1 0.1 0\nf 1 2 4 3\n")
    (force, gust, copied, mine), moved = (other / "field.safetensors", other / "wind.safetensors", "copy.safetensors", own), "place.npy"
    twice, causes = "The same field acts twice at one place, as ", "The force and the wind of one take act together, as "
    for fields, says in (
        ([(force, None)], []),
        ([(force, None), (force, moved)], []),
        ([(mine, moved)], []),
        ([(mine, None)], [f"{twice}the take's own field and further field 1 ({mine})."]),
        ([(force, None), (copied, None)], [f"{twice}further field 1 ({force}) and further field 2 ({copied})."]),
        ([(force, moved), (gust, moved)], [f"{causes}further field 1 ({force}) and further field 2 ({gust}), although"]),
    ):
        text = '[[body]]\nname = "flag"\nmesh = "flag.obj"\nmaterial = "cotton"\n'
        for file, place in fields:
            text += f"[[further_field]]\nfile = '{file}'\n" + (f"place = '{place}'\n" if place else "")
        (tmp_path / "edit.toml").write_text(text)
        messages = engine("resimulate", windy, "--edit", tmp_path / "edit.toml", "--take", tmp_path / "r.take", expect=0)
        told = [one["message"] for one in messages if one["type"] == "warning" and "Leave one out" in one["message"]]
        assert len(told) == len(says) and all(one.startswith(start) for one, start in zip(told, says, strict=True)), told


def test_a_re_simulation_lists_its_further_fields(engine, windy: Path, tmp_path: Path) -> None:
    (tmp_path / "other.take").mkdir()
    shutil.copy(windy / "field.safetensors", tmp_path / "other.take")
    (tmp_path / "flag.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0.1 0.1 0\nf 1 2 4 3\n")
    body, take = '[[body]]\nname = "flag"\nmesh = "flag.obj"\nmaterial = "cotton"\n', str(tmp_path / "other.take")
    field_of = '[[further_field]]\nfile = "other.take/field.safetensors"\nstrength = 0.5\n'
    found = {"source": take, "file": "field.safetensors"}
    further = [{**found, "name": None}, {**found, "name": "Breeze"}]
    for text, listed in ((body, []), (f'{body}{field_of}{field_of}name = "Breeze"\n', further)):
        (tmp_path / "edit.toml").write_text(text)
        engine("resimulate", windy, "--edit", tmp_path / "edit.toml", "--take", tmp_path / "r.take", expect=0)
        assert Take(tmp_path / "r.take").read_json("resimulation.json")["further_fields"] == listed


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_results_do_not_replace_what_is_no_file(engine, windy: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    (tmp_path / "folder.npz").mkdir()
    np.save(tmp_path / "p.npy", np.array([[0.0, np.nan, 0.0]]))  # which is told later
    for verb in (["sample", windy, "--points", tmp_path / "p.npy", "--frame", 0], ["export", windy, "--format", "npz"]):
        for name in ("pipe.npz", "folder.npz"):
            error = engine(*verb, "--out", tmp_path / name, expect=2)[-2]
            assert "not a regular file" in error["message"] and error["hint"]
        error = engine(*verb, "--out", windy / "field.safetensors" / "o.npz", expect=2)[-2]
    assert (tmp_path / "pipe.npz").is_fifo()


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("take.toml", "= broken", "take.toml cannot be read"),
        ("take.toml", "format = 99", "of a newer version"),
        ("field.safetensors", "no field", "cannot be read as a field"),
        ("wind.safetensors", "no wind", "cannot be read as a field"),
    ],
)
def test_a_damaged_take_is_wrong_input(engine, windy: Path, tmp_path: Path, name: str, text: str, says: str) -> None:
    (windy / name).write_text(text)
    (tmp_path / "edit.toml").write_text('field = "wind"\n[[body]]\nname = "leaf"\nmesh = "recovered"\n')
    for verb in (
        ["sample", windy, "--points", tmp_path / "p.npy", "--frame", 0, "--out", tmp_path / "o.npz"],
        ["export", windy, "--format", "ply", "--out", tmp_path / "o"],
        ["resimulate", windy, "--edit", tmp_path / "edit.toml", "--take", tmp_path / "r.take"],
    ):
        error = engine(*verb, expect=2)[-2]
        assert says in error["message"] and error["hint"]


def test_a_take_that_has_lost_its_object_is_not_said_to_be_of_trajectories(engine, windy: Path, tmp_path: Path) -> None:
    (tmp_path / "edit.toml").write_text('[[body]]\nname = "leaf"\nmesh = "recovered"\n')
    words = ["resimulate", windy, "--edit", tmp_path / "edit.toml", "--take", tmp_path / "o.take"]
    assert "came from trajectories" in engine(*words, expect=2)[-2]["hint"]
    Take(windy).finish("build", "stamp", {})
    assert "particles.npz is missing" in engine(*words, expect=2)[-2]["hint"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no limit of a file's size")
def test_a_full_disk_leaves_no_traceback(engine, windy: Path, tmp_path: Path) -> None:
    """A limit of the file's size stops a write half-way, as a full disk does."""
    out = tmp_path / "o.npz"
    error = engine("sample", windy, "--points", tmp_path / "p.npy", "--frame", 0, "--out", out, expect=1, file_bytes=50_000)[-2]
    assert "Cannot write" in error["message"] and error["hint"] and not out.exists()
