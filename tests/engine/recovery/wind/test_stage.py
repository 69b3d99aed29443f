"""The stage *wind*: what it writes into a take, and how the verbs use that."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.command.verbs import VERBS
from seeing_wind.engine.errors import ObjectError, TakeError, UsageError
from seeing_wind.engine.field import distill, distillation, load_field
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.record_arrays import to_arrays
from seeing_wind.engine.recovery.wind.stage import FIELD, read_wind, wind_stage
from seeing_wind.engine.settings import RecoverSettings, WindSettings
from seeing_wind.engine.take import Take
from tests.engine.fields import UniformField
from tests.engine.recovery.wind.blown_plate import FPS, FRAMES, SPEED

SOLVING = RecoverSettings(gravity=(0.0, 0.0, 0.0))


def run(*words):
    arguments = parser().parse_args([str(word) for word in words])
    return VERBS[arguments.verb](arguments, NoProgress())


def read(take, recovery, particles, material, field="wind", solving=SOLVING):
    return wind_stage(take, None, particles, material, recovery, FPS, WindSettings(field), solving, NoProgress())


@pytest.fixture(scope="module")
def taken(blown, tmp_path_factory):
    """A take with a force and its wind."""
    recovery, particles, material = blown
    take = Take(tmp_path_factory.mktemp("blown.take"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(distillation, "ITERATIONS", 100)
        take.write_arrays("trajectory.npz", to_arrays(recovery))
        distill(recovery, particles, FPS).save(take.file("field.safetensors"))
        wind = read(take, *blown, field="auto")
    return take, wind


def test_auto_chooses_the_wind_and_says_why(taken):
    take, wind = taken
    assert wind.told["field"] == "wind"
    assert wind.told["log_odds_of_wind"] > 0.0
    assert any("more probable than a force" in note for note in wind.notes)
    assert json.loads(take.file("wind.json").read_text())["beaufort"]["mean"] == 4


def test_the_field_of_the_wind_is_in_metres_per_second(taken, blown):
    take, _ = taken
    field = read_wind(take)
    assert field.kind == "wind"
    velocity, _ = field.sample(blown[0].x[4], 4)
    np.testing.assert_allclose(velocity[:, 2], SPEED, rtol=0.1)
    assert load_field(take.file("field.safetensors")).kind == "force"


def test_a_finished_stage_is_read_back(taken, blown):
    take, wind = taken
    before = take.file(FIELD).stat().st_mtime_ns
    again = read(take, *blown, field="auto")
    assert again.told == json.loads(json.dumps(wind.told))
    assert take.file(FIELD).stat().st_mtime_ns == before


@pytest.mark.parametrize("damaged", [FIELD, "wind.json"])
def test_a_finished_stage_that_is_damaged_is_done_again(taken, blown, tmp_path, monkeypatch, damaged):
    take, wind = taken
    monkeypatch.setattr(distillation, "ITERATIONS", 2)
    copy = Take(shutil.copytree(take.path, tmp_path / "copy.take"))
    copy.file(damaged).write_text("{}")
    assert read(copy, *blown, field="auto").told == wind.told
    assert read_wind(copy) is not None and json.loads(copy.file("wind.json").read_text())["field"] == "wind"


def test_a_kind_that_does_not_fit_its_unit_is_refused(tmp_path):
    field = UniformField(np.array([[0.0, 0, 0], [1, 1, 1]]), 25.0, 2, np.ones(3))
    field.kind = "wind"
    field.save(tmp_path / "wind.safetensors")
    damaged = (tmp_path / "wind.safetensors").read_bytes().replace(b'"units":"m/s"', b'"units":"kts"')
    (tmp_path / "other.safetensors").write_bytes(damaged)
    with pytest.raises(TakeError, match="kts"):
        load_field(tmp_path / "other.safetensors")


def test_sample_and_export_carry_the_wind(taken, blown, tmp_path):
    take, _ = taken
    np.save(tmp_path / "p.npy", blown[0].x[3, :5])
    run("sample", take.path, "--points", tmp_path / "p.npy", "--frame", 3, "--out", tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz") as values:
        assert values["wind_velocity"].shape == (5, 3)
        assert values["wind_confidence"].shape == (5,)
        np.testing.assert_allclose(values["wind_velocity"][:, 2], SPEED, rtol=0.1)
    run("export", take.path, "--format", "npz", "--out", tmp_path / "f.npz")
    with np.load(tmp_path / "f.npz") as values:
        assert values["wind_velocity"].shape == values["force_density"].shape
    for kind, name in (("fga", "wind_0000.fga"), ("ply", "frame_0000.ply")):
        run("export", take.path, "--format", kind, "--out", tmp_path / kind)
        assert (tmp_path / kind / name).is_file()
    assert b"property float ux" in (tmp_path / "ply" / "frame_0000.ply").read_bytes()


@pytest.mark.parametrize(("asked", "says"), [("gale", "field must be force or wind; this is 'gale'"), ("wind", "has no wind")])
def test_an_edit_that_asks_for_another_field(tmp_path, asked, says):
    take = Take(tmp_path / "force.take")
    take.prepare()
    UniformField(np.array([[-1.0, -1, -1], [1, 1, 1]]), FPS, FRAMES, np.ones(3)).save(take.file("field.safetensors"))
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    (tmp_path / "edit.toml").write_text(f'field = "{asked}"\n[[body]]\nname = "a"\nmesh = "a.obj"\n')
    with pytest.raises(UsageError, match=says):
        run("resimulate", take.path, "--edit", tmp_path / "edit.toml", "--take", tmp_path / "out")


def test_a_force_that_is_no_wind_is_refused_in_words_and_auto_keeps_it(blown, tmp_path):
    recovery, particles, material = blown
    force = np.zeros_like(recovery.force_density)
    force[..., 2] = 9.81 * material.density
    stands = replace(recovery, x=np.repeat(recovery.x[:1], FRAMES + 1, axis=0), force_density=force)
    take, falling = Take(tmp_path / "stands.take"), replace(SOLVING, gravity=(0.0, 0.0, -9.81))
    take.write_arrays("trajectory.npz", to_arrays(stands))
    with pytest.raises(ObjectError, match="against gravity"):
        read(take, stands, particles, material, "wind", falling)
    wind = read(take, stands, particles, material, "auto", falling)
    assert wind.field is None
    assert wind.told["field"] == "force"
    assert "against gravity" in wind.notes[0]


def test_force_removes_the_wind_of_an_earlier_run(blown, tmp_path):
    take = Take(tmp_path / "t.take")
    take.prepare()
    take.file(FIELD).write_bytes(b"old")
    assert read(take, *blown, field="force").field is None
    assert not take.file(FIELD).exists()
