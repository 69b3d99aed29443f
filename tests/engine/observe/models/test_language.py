"""Materials from a vision-language model: the two questions, strict answers, what is kept, and what a bad endpoint does."""

from __future__ import annotations

import base64
import dataclasses
import json
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from seeing_wind.engine.errors import ModelError, UsageError
from seeing_wind.engine.observe.models.endpoint import KEY_VARIABLE, LONGEST_SIDE, ask, endpoint_of
from seeing_wind.engine.observe.models.language import FILE, ask_material, check_properties, crop_object, estimate, kept_estimate
from seeing_wind.engine.progress import Cancelled, NoProgress, Progress
from seeing_wind.engine.settings import BuildSettings
from seeing_wind.engine.take import Take

WHAT = {"object": "balloon", "material": "latex", "type": "elastic"}
NUMBERS = {"density": 920.0, "youngs_modulus": 1.2e6, "poisson_ratio": 0.49, "yield_stress": None, "viscosity": None}
FRAME = np.random.default_rng(0).integers(0, 255, (60, 80, 3), dtype=np.uint8)
MASK = np.zeros((60, 80), bool)
MASK[20:40, 30:50] = True


@dataclasses.dataclass
class Seen:
    """The part of an observation that `ask_material` needs."""

    image: np.ndarray
    masks: np.ndarray


def test_first_the_type_then_the_properties_of_that_type(server) -> None:
    server.answers = [WHAT, NUMBERS]
    found = estimate(endpoint_of(server.url, "any"), FRAME, MASK, NoProgress())
    assert (found.object, found.density, found.youngs_modulus, found.law) == ("balloon", 920.0, 1.2e6, "neo_hookean")
    assert len(server.images(0)) == 2 and len(server.images(1)) == 1, "frame and crop, then the crop"
    assert "balloon" in server.question(1) and "latex" in server.question(1) and "balloon" not in server.question(0)
    crop = cv2.imdecode(np.frombuffer(base64.b64decode(server.images(1)[0].split(",")[1]), np.uint8), cv2.IMREAD_COLOR)
    assert crop.shape == crop_object(FRAME, MASK).shape and crop.shape[0] < 60


@pytest.mark.parametrize(
    ("kind", "modulus", "law"),
    [
        ("elastic", 1e6, "neo_hookean"),
        ("elastic", 2e11, "corotated"),
        ("elastoplastic", 7e10, "von_mises"),
        ("viscoplastic", 1e6, "viscoplastic"),
    ],
)
def test_type_and_stiffness_give_the_law(server, kind: str, modulus: float, law: str) -> None:
    server.answers = [{**WHAT, "type": kind}, {**NUMBERS, "youngs_modulus": modulus, "yield_stress": 1e4, "viscosity": 1e5}]
    found = estimate(endpoint_of(server.url, "any"), FRAME, MASK, NoProgress())
    assert found.law == law
    assert (found.yield_stress is None) == (kind == "elastic") and (found.viscosity is None) == (kind != "viscoplastic")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"density": 0.9}, "density"),
        ({"density": "920"}, "no number"),
        ({"density": True}, "no number"),
        ({"density": None}, "no number"),
        ({"youngs_modulus": 1e15}, "outside"),
        ({"poisson_ratio": 0.5}, "outside"),
        ({"poisson_ratio": -0.2}, "outside"),
        ({"yield_stress": 5e6}, "above Young's modulus"),
        ({"yield_stress": None}, "no number"),
        ({"mass": 1.0}, "keys"),
    ],
)
def test_unphysical_answers_are_refused(change: dict, says: str) -> None:
    good = {**NUMBERS, "yield_stress": 1e4}
    check_properties(good, "elastoplastic")
    with pytest.raises(ValueError, match=says):
        check_properties({**good, **change}, "elastoplastic")


LIES = ["rubber", "[1, 2]", '{"object": 1}', '{"density": NaN}', "[" * 30_000, {**WHAT, "type": "magic"}, {**WHAT, "object": "x" * 99}]


@pytest.mark.parametrize("lie", LIES)
def test_a_lie_is_sent_back_once_with_the_reason_then_it_is_an_error(server, lie) -> None:
    server.answers = [lie]
    with pytest.raises(ModelError, match="no usable answer") as caught:
        estimate(endpoint_of(server.url, "any"), FRAME, MASK, NoProgress())
    assert len(server.asked) == 2 and "refused" in server.question(1)
    assert "--material" in caught.value.hint


def test_a_mended_answer_and_a_code_fence_are_accepted(server) -> None:
    server.answers = ["rubber!", f"```json\n{json.dumps(WHAT)}\n```", NUMBERS]
    assert estimate(endpoint_of(server.url, "any"), FRAME, MASK, NoProgress()).material == "latex"


def test_answers_are_kept_in_the_take_without_the_key(server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, "secret-3f9a")
    server.answers = [WHAT, NUMBERS]
    take, endpoint = Take(tmp_path / "a.take"), endpoint_of(server.url, "any")
    first = kept_estimate(take, endpoint, FRAME, MASK, NoProgress())
    assert kept_estimate(take, endpoint, FRAME, MASK, NoProgress()) == first and len(server.asked) == 2
    assert server.headers[0]["Authorization"] == "Bearer secret-3f9a"
    written = b"".join(path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    assert b"latex" in written and b"secret-3f9a" not in written and "secret" not in repr(endpoint)
    # another frame or another model is another question
    server.answers = [WHAT, {**NUMBERS, "density": 1000.0}, WHAT, NUMBERS]
    assert kept_estimate(take, endpoint, FRAME[::-1], MASK, NoProgress()).density == 1000.0
    kept_estimate(take, endpoint_of(server.url, "other"), FRAME, MASK, NoProgress())
    assert len(server.asked) == 6


@pytest.mark.parametrize("damage", ["{", "[]", None])
def test_damaged_or_forged_kept_answers_are_asked_again(server, tmp_path: Path, damage: str | None) -> None:
    server.answers = [WHAT, NUMBERS, WHAT, NUMBERS]
    take, endpoint = Take(tmp_path / "a.take"), endpoint_of(server.url, "any")
    kept_estimate(take, endpoint, FRAME, MASK, NoProgress())
    path = take.file(FILE)
    path.write_text(damage if damage is not None else path.read_text().replace("920.0", "-5.0"))
    assert kept_estimate(take, endpoint, FRAME, MASK, NoProgress()).density == 920.0 and len(server.asked) == 4


def test_estimates_fill_what_the_user_left_open(server, tmp_path: Path) -> None:
    server.answers = [WHAT, NUMBERS]
    seen = Seen(FRAME, MASK[None])
    endpoint = endpoint_of(server.url, "any")
    settings, notes = ask_material(Take(tmp_path), endpoint, seen, BuildSettings(density=500.0), NoProgress())  # type: ignore[arg-type]
    assert not notes
    assert (settings.density, settings.youngs_modulus, settings.law, settings.estimated_material) == (500.0, 1.2e6, "neo_hookean", "latex")
    assert settings.estimated_by == "balloon, by any at 127.0.0.1"


def test_an_unreachable_endpoint_is_a_warning_and_the_fallback(server, tmp_path: Path) -> None:
    endpoint = endpoint_of(server.url, "any")
    server.close()
    told: list[dict] = []
    settings = BuildSettings(material="cotton")
    seen = Seen(FRAME, MASK[None])
    kept, notes = ask_material(Take(tmp_path), endpoint, seen, settings, Progress(told.append))  # type: ignore[arg-type]
    assert kept == settings
    warning = [message["message"] for message in told if message["type"] == "warning"]
    assert len(warning) == 1 and "does not answer" in warning[0] and "cotton" in warning[0]
    assert notes == warning


@pytest.mark.parametrize(("status", "says"), [(401, KEY_VARIABLE), (404, "model's name"), (500, "server runs")])
def test_refusals_say_what_to_do_and_hide_the_key(server, monkeypatch: pytest.MonkeyPatch, status: int, says: str) -> None:
    monkeypatch.setenv(KEY_VARIABLE, "secret-3f9a")
    server.status, server.answers = status, [b"no entry for secret-3f9a"]
    with pytest.raises(ModelError, match=str(status)) as caught:
        ask(endpoint_of(server.url, "any"), "what?", [FRAME], NoProgress())
    assert says in caught.value.hint and "secret-3f9a" not in str(caught.value)


def test_a_redirect_is_not_followed(server) -> None:
    server.status, server.location, server.answers = 307, server.url, [b""]
    with pytest.raises(ModelError, match="307"):
        ask(endpoint_of(server.url, "any"), "what?", [], NoProgress())
    assert len(server.asked) == 1


@pytest.mark.parametrize("data", [b"<html>hello</html>", b"{}", b'{"choices": []}', b'{"choices": [{"message": {"content": null}}]}'])
def test_other_servers_are_recognised(server, data: bytes) -> None:
    server.answers = [data]
    with pytest.raises(ModelError, match="no chat completion"):
        ask(endpoint_of(server.url, "any"), "what?", [], NoProgress())


def test_large_frames_are_sent_smaller(server) -> None:
    server.answers = ["yes"]
    ask(endpoint_of(server.url, "any"), "what?", [np.zeros((300, 4000, 3), np.uint8)], NoProgress())
    sent = cv2.imdecode(np.frombuffer(base64.b64decode(server.images(0)[0].split(",")[1]), np.uint8), cv2.IMREAD_COLOR)
    assert max(sent.shape) == LONGEST_SIDE


def test_waiting_can_be_cancelled(server) -> None:
    server.slow, server.answers = True, ["late"]
    stop = threading.Event()
    threading.Timer(0.3, stop.set).start()
    with pytest.raises(Cancelled):
        ask(endpoint_of(server.url, "any"), "what?", [], Progress(cancelled=stop.is_set))


ADDRESSES = ["", "localhost:1234/v1", "ftp://host/v1", "http://", "http://me:word@host/v1", "ftp://me:word@host", "https://host/v1?key=1"]


@pytest.mark.parametrize("url", [*ADDRESSES, "http://[::1/v1", "http://host:99999/"])
def test_addresses_refused(url: str) -> None:
    with pytest.raises(UsageError) as caught:
        endpoint_of(url, "any")
    assert caught.value.hint and "word" not in str(caught.value)


def test_a_key_is_not_sent_in_the_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, "secret-3f9a")
    with pytest.raises(UsageError, match="unencrypted"):
        endpoint_of("http://example.org/v1", "any")
    assert endpoint_of("https://example.org/v1/", "any").url == "https://example.org/v1"
    assert endpoint_of("http://localhost:8000/v1", "any").key == "secret-3f9a"
