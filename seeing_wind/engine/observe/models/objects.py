"""All objects of a clip's first frame, each with a material and a mask. The paper's order (section 3.1): object types, properties, masks by
type, assignment of each pixel to one object."""

from __future__ import annotations

import os
import re
import shlex
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from ...errors import ObjectError, UsageError
from ...progress import Progress
from ...reading import read_json
from ...settings.tables import RESERVED
from ...take import Take
from ..mask.from_box import mask_in_box
from .endpoint import LONGEST_SIDE, Endpoint
from .language import RANGES, Estimate, check_what, checked, crop_object, exact_keys, properties

MOST = 8
"""Largest number of objects."""

LEAST_PIXELS = 16

WHICH = """The image is the first frame of a video, WIDTH pixels wide and HEIGHT pixels high. Which things in it can be moved or bent by
wind, water or other forces (not the ground, walls, sky or water themselves)? Name at most 8. Answer with one JSON object and nothing else:
{"objects": [{"object": its everyday name in a word or two, "material": the name of what it is mainly made of,
"type": "elastic" if it springs back, "elastoplastic" if it keeps dents whatever the speed, "viscoplastic" if it flows slowly under load,
"box": [left, top, right, bottom] in pixels of this frame}, ...]}"""


@dataclass(frozen=True)
class Found:
    """One object of the frame."""

    estimate: Estimate
    mask: np.ndarray
    """(H, W) bool; no pixel belongs to two objects."""

    def options(self, mask_path: str) -> str:
        """The options of `recover` for this object, whose mask is the file `mask_path`."""
        values = {"law": self.estimate.law} | {key: getattr(self.estimate, key) for key in RANGES}
        words = [f"--{key.replace('_', '-')} {value}" for key, value in values.items() if value is not None]
        return f"--mask {shlex.quote(mask_path)} {' '.join(words)}"


def find_objects(endpoint: Endpoint, frame: np.ndarray, detector: str | None, masker: str | None, progress: Progress) -> list[Found]:
    """The objects of `frame` (H, W, 3) uint8 RGB.

    Args:
        detector, masker: names of networks that find an object by its name, and that cut it out. Without the former, the language model's
            box is used; without the latter, GrabCut cuts the object out.

    Raises:
        ObjectError: no object that stands out. ModelError, MissingPackage: the endpoint or a network cannot be used.
    """
    progress.begin("material", f"asking {endpoint.name} what is in the frame")
    height, width = frame.shape[:2]
    scale = min(1.0, LONGEST_SIDE / max(height, width))
    size = (round(width * scale), round(height * scale))
    question = WHICH.replace("WIDTH", str(size[0])).replace("HEIGHT", str(size[1]))
    things = checked(endpoint, question, [frame], lambda values: _check_things(values, size), progress)
    found = []
    for number, (what, box) in enumerate(things):
        progress.update(number / len(things), f"{what['object']} of {what['material']}")
        grown = [value / scale for value in box]
        try:
            mask = _mask(frame, (grown[0], grown[1], grown[2], grown[3]), what["object"], detector, masker, progress)
        except ObjectError as error:
            progress.warn(f"{what['object']}: {error}")
            continue
        found.append(Found(properties(endpoint, what, crop_object(frame, mask), progress), mask))
    found = _assign_pixels(found)
    if not found:
        raise ObjectError(f"{endpoint.name} names no object that stands out in the frame.", "Draw a --box round it with `recover`.")
    return found


def _check_things(values: Any, size: tuple[int, int]) -> list[tuple[dict[str, str], list[float]]]:
    things = exact_keys(values, ("objects",))["objects"]
    if not isinstance(things, list) or not 1 <= len(things) <= MOST:
        raise ValueError(f"objects is not a list of 1 to {MOST}.")
    result = []
    for thing in things:
        thing = exact_keys(thing, ("object", "material", "type", "box"))
        box = thing["box"]
        if not isinstance(box, list) or len(box) != 4 or not all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in box):
            raise ValueError("box is not a list of four numbers.")
        low, high = np.clip(box[:2], 0, np.array(size) - 1), np.clip(box[2:], 0, np.array(size) - 1)
        if not np.isfinite(box).all() or (high - low < 2).any():
            raise ValueError(f"the box {box} has no area inside the frame.")
        result.append((check_what({key: thing[key] for key in ("object", "material", "type")}), [*map(float, low), *map(float, high)]))
    return result


def _mask(
    frame: np.ndarray, box: tuple[float, float, float, float], text: str, detector: str | None, masker: str | None, progress: Progress
) -> np.ndarray:
    if detector is not None:
        from .masks import find_box

        box = find_box(detector, text, frame, progress)
    if masker is not None:
        from .masks import MaskModel

        return MaskModel(masker).in_box(frame, box)
    return mask_in_box(frame, box, None, progress)


def _assign_pixels(found: list[Found]) -> list[Found]:
    """Assign every pixel to one object: where masks overlap, to the smaller object, which lies in front of or on the larger one."""
    taken = np.zeros(found[0].mask.shape, bool) if found else np.zeros((0, 0), bool)
    result: dict[int, Found] = {}
    for index in sorted(range(len(found)), key=lambda one: int(found[one].mask.sum())):
        free = found[index].mask & ~taken
        taken |= free
        if free.sum() >= LEAST_PIXELS:
            result[index] = Found(found[index].estimate, free)
    return [result[index] for index in sorted(result)]


def write_objects(take: Take, found: list[Found]) -> list[dict[str, Any]]:
    """Write `objects.json` and a mask PNG per object, in `objects/`, into the take; returns the list in the JSON."""
    listed = []
    names: set[str] = set()
    for number, one in enumerate(found, start=1):
        word = re.sub(r"[^a-z0-9]+", "_", one.estimate.object.lower()).strip("_") or "object"
        name = word if word not in names else f"{word}_{number}"
        names.add(name)
        with take.writing(f"objects/{name}.png") as path:
            done, coded = cv2.imencode(".png", one.mask.astype(np.uint8) * 255)
            assert done
            path.write_bytes(coded.tobytes())
        place = str(take.file(f"objects/{name}.png"))
        numbers = {**asdict(one.estimate), "law": one.estimate.law}
        listed.append({"name": name, "mask": place, "pixels": int(one.mask.sum()), **numbers, "options": one.options(place)})
    take.write_json("objects.json", {"objects": listed})
    return listed


def read_objects(path: str) -> list[dict[str, Any]]:
    """The list that `write_objects` wrote to the file at `path`, checked.

    Raises:
        UsageError: no such file, one of another kind, or a mask that is not there.
    """
    advice = "Give the objects.json that `identify` writes."
    try:
        values = read_json(path)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} lists no objects: {getattr(error, 'strerror', None) or error}.", advice) from error
    listed = values.get("objects") if isinstance(values, dict) else None
    if not isinstance(listed, list) or not listed or not all(isinstance(one, dict) for one in listed):
        raise UsageError(f"{path} lists no objects.", advice)
    texts, numbers = ("name", "object", "material", "mask", "law"), tuple(RANGES)
    for number, one in enumerate(listed, start=1):
        wrong = [key for key in texts if not isinstance(one.get(key), str) or not one[key]]
        wrong += [key for key in numbers if one.get(key, "") is not None and not isinstance(one.get(key), (int, float))]
        if wrong:
            raise UsageError(f"{path}: these values of object {number} are missing or of the wrong kind: {', '.join(wrong)}.", advice)
        if not os.path.isfile(one["mask"]):
            hint = "Run `identify` again, or correct the path; it counts from the folder in which `recover` is run."
            raise UsageError(f"{path}: the mask of object {number}, {one['mask']}, is not a file.", hint)
        if not re.fullmatch(r"[A-Za-z0-9_-]+", one["name"]) or one["name"].upper() in RESERVED:
            raise UsageError(f"{path}: the name of object {number}, {one['name'][:40]!r}, cannot be a file's name.", advice)
    names = [one["name"] for one in listed]
    if len(set(names)) < len(names):
        raise UsageError(f"{path}: two objects have the same name.", advice)
    return listed
