"""Several objects in one frame, each with a material and a mask of its own."""

from __future__ import annotations

import argparse
import json
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest

from seeing_wind.engine.command.arguments import parser, settings_of
from seeing_wind.engine.command.verbs import identify, recover
from seeing_wind.engine.errors import ModelError, ObjectError, UsageError
from seeing_wind.engine.observe.mask.first_mask import read_mask
from seeing_wind.engine.observe.models.endpoint import endpoint_of
from seeing_wind.engine.observe.models.language import RANGES
from seeing_wind.engine.observe.models.objects import find_objects, read_objects
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.settings import BuildSettings

BALL = {"object": "Rubber ball", "material": "rubber", "type": "elastic", "box": [16, 26, 64, 74]}
CLAY = {"object": "brick", "material": "clay", "type": "elastoplastic", "box": [96, 40, 144, 90]}
RUBBER_NUMBERS = {"density": 930.0, "youngs_modulus": 2e6, "poisson_ratio": 0.48, "yield_stress": None, "viscosity": None}
CLAY_NUMBERS = {"density": 1900.0, "youngs_modulus": 1e6, "poisson_ratio": 0.4, "yield_stress": 3e4, "viscosity": None}


def frame() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    image = (90 + rng.normal(0, 3, (120, 160, 3))).astype(np.uint8)
    ball, brick = np.zeros((120, 160), np.uint8), np.zeros((120, 160), np.uint8)
    cv2.circle(ball, (40, 50), 20, 1, -1)
    cv2.rectangle(brick, (100, 44), (140, 86), 1, -1)
    image[ball > 0], image[brick > 0] = (210, 40, 30), (40, 60, 200)
    return image, ball > 0, brick > 0


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def test_types_then_properties_then_masks(server) -> None:
    image, ball, brick = frame()
    server.answers = [{"objects": [BALL, CLAY]}, RUBBER_NUMBERS, CLAY_NUMBERS]
    found = find_objects(endpoint_of(server.url, "any"), image, None, None, NoProgress())
    assert [one.estimate.law for one in found] == ["neo_hookean", "von_mises"]
    assert iou(found[0].mask, ball) > 0.95 and iou(found[1].mask, brick) > 0.95
    assert "160" in server.question(0) and "rubber" in server.question(1) and "clay" in server.question(2)


def test_networks_find_each_by_its_name_and_overlaps_go_to_the_smaller(server, monkeypatch: pytest.MonkeyPatch) -> None:
    image, ball, brick = frame()
    asked = []

    class Whole:
        def __init__(self, name: str) -> None:
            assert name == "sam"

        def in_box(self, _: np.ndarray, box: tuple) -> np.ndarray:
            return np.ones_like(ball) if box == (0, 0, 1, 1) else ball

    def find_box(name: str, text: str, *_: object) -> tuple:
        asked.append((name, text))
        return (0, 0, 1, 1) if text == "brick" else (16, 26, 64, 74)

    monkeypatch.setattr("seeing_wind.engine.observe.models.masks.find_box", find_box)
    monkeypatch.setattr("seeing_wind.engine.observe.models.masks.MaskModel", Whole)
    server.answers = [{"objects": [CLAY, BALL]}, CLAY_NUMBERS, RUBBER_NUMBERS]
    found = find_objects(endpoint_of(server.url, "any"), image, "dino", "sam", NoProgress())
    assert asked == [("dino", "brick"), ("dino", "Rubber ball")]
    assert np.array_equal(found[1].mask, ball) and np.array_equal(found[0].mask, ~ball)


def test_what_does_not_stand_out_is_told_and_left_out(server) -> None:
    image, ball, _ = frame()
    image[:, 70:] = 90
    server.answers = [{"objects": [BALL, CLAY]}, RUBBER_NUMBERS]
    told: list[dict] = []
    found = find_objects(endpoint_of(server.url, "any"), image, None, None, Progress(told.append))
    assert len(found) == 1 and any("brick" in one["message"] for one in told if one["type"] == "warning")
    image[:] = 90
    server.answers = [{"objects": [BALL]}]
    with pytest.raises(ObjectError, match="no object"):
        find_objects(endpoint_of(server.url, "any"), image, None, None, NoProgress())


@pytest.mark.parametrize(
    "lie",
    [
        {"objects": []},
        {"objects": [BALL] * 9},
        {"objects": [{**BALL, "box": [10, 10, 10, 10]}]},
        {"objects": [{**BALL, "box": [500, 500, 600, 600]}]},
        {"objects": [{**BALL, "box": "left"}]},
        {"objects": [{**BALL, "box": [True, 1, 20, 20]}]},
        {"objects": ["ball"]},
        [BALL],
    ],
)
def test_lies_about_objects_are_refused(server, lie) -> None:
    server.answers = [lie]
    with pytest.raises(ModelError, match="no usable answer"):
        find_objects(endpoint_of(server.url, "any"), frame()[0], None, None, NoProgress())


def test_the_verb_writes_masks_and_options_that_recover_takes(server, tmp_path: Path) -> None:
    image, ball, brick = frame()
    for number in range(2):
        cv2.imwrite(str(tmp_path / f"p{number}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    server.answers = [{"objects": [BALL, CLAY]}, RUBBER_NUMBERS, CLAY_NUMBERS]
    words = ["identify", str(tmp_path / "p%d.png"), "--take", str(tmp_path / "a take"), "--material-endpoint", server.url]
    arguments: argparse.Namespace = parser().parse_args([*words, "--material-model", "any"])
    listed = identify(arguments, NoProgress())["objects"]
    assert [one["name"] for one in listed] == ["rubber_ball", "brick"]
    assert json.loads((tmp_path / "a take" / "objects.json").read_text())["objects"] == listed
    page = (Path(__file__).parents[4] / "docs" / "reference" / "formats.md").read_text(encoding="utf-8")
    told = page.split("### Objects\n")[1].split("\n### ")[0]
    assert [key for key in listed[0] if f"`{key}`" not in told] == []
    assert iou(read_mask(listed[1]["mask"], 120, 160), brick) > 0.95
    again = parser().parse_args(["recover", "clip.mp4", "--take", "b", *shlex.split(listed[1]["options"])])
    assert (again.mask, again.law, again.density, again.yield_stress) == (listed[1]["mask"], "von_mises", 1900.0, 3e4)


def test_all_objects_of_a_clip_get_their_mask_material_and_pin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listed = []
    for number, (name, law, numbers) in enumerate([("ball", "neo_hookean", RUBBER_NUMBERS), ("brick", "von_mises", CLAY_NUMBERS)]):
        mask = np.zeros((120, 160), np.uint8)
        mask[24:60, 16 + 72 * number : 56 + 72 * number] = 255
        cv2.imwrite(str(tmp_path / f"{name}.png"), mask)
        listed.append({"name": name, "object": name, "material": name, "mask": str(tmp_path / f"{name}.png"), "law": law, **numbers})
    pin = np.zeros((120, 160), np.uint8)
    pin[24:30, 16:56] = 255
    cv2.imwrite(str(tmp_path / "pin.png"), pin)
    (tmp_path / "objects.json").write_text(json.dumps({"objects": listed}))
    done: list[argparse.Namespace] = []

    def one(arguments: argparse.Namespace, _: Progress) -> dict:
        done.append(arguments)
        return {"outcome": "converged" if len(done) == 1 else "max_iterations", "take": arguments.take}

    monkeypatch.setattr("seeing_wind.engine.command.recover.recover_one", one)
    words = ["recover", "clip.mp4", "--take", str(tmp_path / "takes"), "--objects", str(tmp_path / "objects.json"), "--fps", "30"]
    result = recover(parser().parse_args([*words, "--distance", "1", "--pin", str(tmp_path / "pin.png")]), NoProgress())
    assert [(own.mask, own.law, own.density) for own in done] == [(a["mask"], a["law"], a["density"]) for a in listed]
    assert [own.pin for own in done] == [str(tmp_path / "pin.png"), None], "only the object under the pin is held"
    built = [settings_of(BuildSettings, own) for own in done]
    assert [one.estimated_material for one in built] == ["ball", "brick"] and built[1].yield_stress == 3e4
    assert [own.take for own in done] == [str(tmp_path / "takes" / f"{name}.take") for name in ("ball", "brick")]
    assert result["outcome"] == "max_iterations" and [one["name"] for one in result["objects"]] == ["ball", "brick"]
    assert json.loads((tmp_path / "takes" / "objects_recovered.json").read_text())["objects"] == result["objects"]


@pytest.mark.parametrize(
    "text", ["", "[]", "5", '{"objects": []}', '{"objects": [{"name": "a"}]}', '{"objects": [{"name": "../a", "mask": "m.png"}]}', None]
)
def test_lists_of_objects_that_are_none(tmp_path: Path, text: str | None) -> None:
    path = tmp_path / "objects.json"
    if text is not None:
        path.write_text(text)
    says = "values of object 1 are missing or of the wrong kind: object, material" if text and '"a"' in text else "objects|mask"
    with pytest.raises(UsageError, match=says):
        recover(parser().parse_args(["recover", "clip", "--take", str(tmp_path / "t"), "--objects", str(path)]), NoProgress())


def test_an_object_s_take_must_be_a_folder_on_every_system(tmp_path: Path) -> None:
    (tmp_path / "m.png").touch()
    mask = str(tmp_path / "m.png")
    one = {"name": "NUL", "object": "leaf", "material": "leaf", "mask": mask, "law": "neo_hookean"} | dict.fromkeys(RANGES)
    (tmp_path / "objects.json").write_text(json.dumps({"objects": [one]}))
    with pytest.raises(UsageError, match="the name of object 1, 'NUL', cannot be"):
        read_objects(str(tmp_path / "objects.json"))
    (tmp_path / "objects.json").write_text(json.dumps({"objects": [one | {"name": "null"}]}))
    assert read_objects(str(tmp_path / "objects.json"))[0]["name"] == "null"


def test_a_mask_that_is_gone_is_told_before_the_first_object_is_recovered(tmp_path: Path) -> None:
    (tmp_path / "a.png").touch()
    one = {"name": "a", "object": "leaf", "material": "leaf", "mask": str(tmp_path / "a.png"), "law": "neo_hookean"} | dict.fromkeys(RANGES)
    gone = one | {"name": "b", "mask": str(tmp_path / "b.png")}
    (tmp_path / "objects.json").write_text(json.dumps({"objects": [one, gone]}))
    with pytest.raises(UsageError, match=r"the mask of object 2, \S*b\.png, is not a file"):
        read_objects(str(tmp_path / "objects.json"))
