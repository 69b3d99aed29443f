"""Asking a vision-language model from the panel: the real engine and a server on this machine with prepared answers."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from seeing_wind.ui import freshness
from seeing_wind.ui.job import status, worker_command
from seeing_wind.ui.job.install import choices, preferences
from seeing_wind.ui.recover.request import RecoverRequest

KEY = "sk-a-key-that-nobody-may-keep"
SQUARE = {"object": "white card", "material": "paper", "type": "elastoplastic", "box": [16, 16, 48, 48]}
NUMBERS = {"density": 800.0, "youngs_modulus": 2.5e9, "poisson_ratio": 0.2, "yield_stress": 3e7, "viscosity": None}

pytestmark = pytest.mark.usefixtures("stand_in")


@pytest.fixture
def seen(server):
    """The model that sees a white card."""
    server.answers = [{"objects": [SQUARE]}, NUMBERS]
    return server


@pytest.fixture
def chosen(monkeypatch):
    """Preferences as the user fills them in."""
    engine = {"python": sys.executable, "wheels": "", "outline_model": ""}
    values = SimpleNamespace(**engine, material_endpoint="", material_model="a-model", material_key=KEY)
    monkeypatch.setattr(choices, "preferences", lambda: values)
    return values


def test_what_is_in_the_clip_is_shown_used_and_can_be_changed(scene, workplace, seen, chosen, tmp_path) -> None:
    chosen.material_endpoint = seen.url
    settings = scene.seeing_wind
    settings.clip, settings.take = str(workplace / "clip.mp4"), str(tmp_path / "asked é.take")
    assert bpy.ops.seeing_wind.identify() == {"FINISHED"}
    assert [each["Authorization"] for each in seen.headers] == [f"Bearer {KEY}"] * 2
    guess = settings.guesses[0]
    assert (guess.name, guess.made_of, guess.law) == ("white_card", "paper", "VON_MISES") and Path(guess.mask).is_file()
    assert settings.object_mode == "BOX" and not settings.use_density  # nothing is changed by the answer
    assert bpy.ops.seeing_wind.use_guess() == {"FINISHED"}
    request = RecoverRequest.of(scene)
    assert request.observe.mask == guess.mask and (request.build.law, request.build.density) == ("von_mises", 800.0)
    assert request.build.yield_stress == 3e7 and request.build.viscosity is None
    settings.density = 900.0
    assert RecoverRequest.of(scene).build.density == 900.0
    # the key is neither in the file nor in the take
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"), compress=False)
    kept = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(kept) >= 3 and all(KEY.encode() not in path.read_bytes() for path in kept)
    assert KEY not in str(scene.seeing_wind.items())


def test_the_key_is_for_the_server_of_the_preferences_only(scene, workplace, seen, chosen, tmp_path) -> None:
    chosen.material_endpoint = "http://127.0.0.1:9/v1"
    scene.seeing_wind.clip, scene.seeing_wind.take = str(workplace / "clip.mp4"), str(tmp_path / "asked.take")
    assert bpy.ops.seeing_wind.identify(endpoint=seen.url) == {"FINISHED"}
    assert len(seen.asked) == 2 and not any("Authorization" in each for each in seen.headers)
    assert worker_command.KEY_VARIABLE not in worker_command.environment()


def test_what_stands_in_the_way_is_said_with_its_mend(scene, workplace, chosen, tmp_path) -> None:
    def failed(says: str) -> status.Step:
        with pytest.raises(RuntimeError, match=says):
            bpy.ops.seeing_wind.identify()
        return status.of(scene.session_uid).steps["identify"]

    scene.seeing_wind.clip, scene.seeing_wind.take = str(workplace / "clip.mp4"), str(tmp_path / "asked.take")
    assert failed("No model is named").mend == "open_preferences"
    chosen.material_endpoint = "https://models.example.org/v1"
    assert failed("on the network").mend == "allow_online"
    chosen.material_endpoint = "http://127.0.0.1:9/v1"
    assert failed("127.0.0.1").state == "failed"
    assert not len(scene.seeing_wind.guesses)
    with pytest.raises(RuntimeError, match="Nothing was found"):
        bpy.ops.seeing_wind.use_guess()
    freshness.refresh(scene)
    assert status.of(scene.session_uid).running == ""


def test_the_key_is_a_password_in_blenders_preferences(scene) -> None:
    rna = preferences.SEEING_WIND_AP_preferences.bl_rna.properties["material_key"]
    assert rna.subtype == "PASSWORD" and rna.description
