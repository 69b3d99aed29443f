"""`blender --command seeing_wind ...`: the worker's verbs and exit codes, plus a saved file."""

from __future__ import annotations

from pathlib import Path

import bpy
import extension
import pytest

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.take import Take
from seeing_wind.ui import commands
from seeing_wind.ui.job import status
from tests.ui.jobs import notes_of


@pytest.fixture(autouse=True)
def workplace(clean_file, tmp_path, monkeypatch) -> Path:
    """The user's folder, with a clip; the stand-in in the engine's place."""
    extension.make_clip(tmp_path / "clip.mp4")
    monkeypatch.chdir(tmp_path)
    with extension.switched_on(monkeypatch, tmp_path):
        yield tmp_path


def test_recover_with_relative_paths_saves_a_file(workplace, capsys) -> None:
    assert commands.main(["recover", "clip.mp4", "--take", "out.take", "--box", "20", "20", "44", "44", "--save", "out.blend"]) == 0
    out = capsys.readouterr().out
    assert "recover  100 %" in out and "converged" in out and str(workplace / "out.blend") in out
    bpy.ops.wm.open_mainfile(filepath=str(workplace / "out.blend"))
    settings = bpy.context.scene.seeing_wind
    assert settings.field_object.field.type == "TEXTURE" and settings.recovered_object.data.shape_keys
    assert bpy.context.scene.camera is not None


def test_resimulate_saves_the_bodies_with_their_motion(workplace) -> None:
    assert commands.main(["recover", "clip.mp4", "--take", "out.take", "--box", "20", "20", "44", "44"]) == 0
    report = Take(workplace / "out.take").read_json("report.json")
    Take(workplace / "out.take").write_json("report.json", {**report, "notes": ["Nothing was marked as held."]})
    (workplace / "edit.toml").write_text(
        'gravity = [0, 0, -9.81]\n[[body]]\nname = "leaf"\nmesh = "recovered"\nmass_scale = 2.0\n', encoding="utf-8"
    )
    assert commands.main(["resimulate", "out.take", "--edit", "edit.toml", "--take", "new.take", "--save", "new.blend"]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(workplace / "new.blend"))
    leaf = bpy.data.objects["leaf"]
    assert len(leaf.data.shape_keys.key_blocks) == 13
    drop = leaf.data.shape_keys.key_blocks[12].data[0].co.z - leaf.data.shape_keys.key_blocks[0].data[0].co.z
    assert drop == pytest.approx(-0.5 * 9.81 * 0.25 / 2.0, rel=1e-5)
    assert notes_of(bpy.context.scene) == ["Nothing was marked as held."]


def test_a_preview_is_saved_as_one(workplace) -> None:
    assert commands.main(["recover", "clip.mp4", "--take", "out.take", "--box", "20", "20", "44", "44"]) == 0
    (workplace / "quick.toml").write_text(
        'gravity = [0, 0, -9.81]\ncoarseness = 2.0\nframes = 5\n[[body]]\nname = "leaf"\nmesh = "recovered"\nmass_scale = 2.0\n',
        encoding="utf-8",
    )
    assert commands.main(["resimulate", "out.take", "--edit", "quick.toml", "--take", "quick.take", "--save", "quick.blend"]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(workplace / "quick.blend"))
    scene = bpy.context.scene
    assert len(bpy.data.objects["leaf"].data.shape_keys.key_blocks) == 6
    assert status.of(scene.session_uid).previewed == ["leaf"] and scene.seeing_wind.simulated_take == ""


def test_an_option_is_found_in_both_spellings() -> None:
    assert commands.value_of(["a", "--take", "b"], "--take") == commands.value_of(["--take=b"], "--take") == "b"


def test_every_verb_of_the_engine_is_one_of_blenders_command() -> None:
    (verbs,) = [action.choices for action in parser()._actions if action.dest == "verb"]
    assert set(verbs) <= {*commands.VERBS, *commands.FILED}


@pytest.mark.parametrize(
    ("argv", "code", "says"),
    [
        ([], 2, "usage"),
        (["--help"], 0, "resimulate"),
        (["fly"], 2, "no verb 'fly'"),
        (["recover", "clip.mp4", "--take", "x", "--save", "picture.png"], 2, "--save takes"),
        (["sample", "x", "--save", "a.blend"], 2, "--save takes"),
        (["recover", "clip.mp4", "--take", "x", "--save", "no/folder/a.blend"], 2, "no folder"),
    ],
)
def test_wrong_usage(argv, code, says, capsys) -> None:
    assert commands.main(argv) == code
    said = capsys.readouterr()
    assert says in said.out + said.err


@pytest.mark.parametrize(("behaviour", "code", "says"), [("error", 1, "outside the frame"), ("die", 1, "SIGKILL"), ("mute", 1, "code 1")])
def test_exit_codes_are_kept_and_nothing_is_saved(workplace, monkeypatch, capsys, behaviour, code, says) -> None:
    monkeypatch.setenv("SEEING_WIND_FAKE", behaviour)
    assert commands.main(["recover", "clip.mp4", "--take", "out.take", "--save", "out.blend"]) == code
    assert says in capsys.readouterr().err
    assert not (workplace / "out.blend").exists()


def test_a_missing_engine_is_one_sentence(monkeypatch, capsys) -> None:
    monkeypatch.setenv("SEEING_WIND_PYTHON", "/no/python")
    assert commands.main(["doctor"]) == 1
    assert "/no/python" in capsys.readouterr().err
