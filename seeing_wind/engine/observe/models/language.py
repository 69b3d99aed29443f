"""The object's material from a vision-language model (paper, section 3.1): first its type, then the properties of that type.

An answer is one JSON object with exactly the wanted keys. It is checked against physical ranges; if it fails, it is sent back once with the
reason. Accepted answers are kept in the take, so that the model is not asked about the same frame again.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ...conventions import in_units
from ...errors import ModelError, TakeError
from ...masks import box_of, rows_columns
from ...progress import Progress
from ...reading import parse_json
from ...records import Observation
from ...settings import BuildSettings
from ...take import Take, stamp_of
from .endpoint import Endpoint, ask

VERSION = 1
"""Part of the key of a kept answer; to be raised when the questions change."""

FILE = "materials.json"
"""Where a take keeps the answers."""

TYPES = ("elastic", "elastoplastic", "viscoplastic")
"""The material types of the paper's Table 4."""

RANGES = {
    "density": (5.0, 23_000.0),
    "youngs_modulus": (1e2, 1.3e12),
    "poisson_ratio": (0.0, 0.495),
    "yield_stress": (1.0, 1e10),
    "viscosity": (1e-2, 1e14),
}
"""Accepted ranges, SI: from aerogels to osmium, and from soft gels to diamond. Auxetics (nu < 0) are not everyday materials."""

STIFF = 5e8
"""Young's modulus [Pa] above which an elastic body gets the corotated law, which suits small strains; below, neo-Hookean."""

ATTEMPTS = 2

CROP_MARGIN = 0.25
"""Margin of the crop round the object, in units of the object's size: the context tells a leaf from a painted one."""

WHAT = """The first image is a frame of a video, the second one shows the object of interest in it, cut out of the same frame.
What is this object, and what is it mainly made of? Answer with one JSON object and nothing else, with exactly these keys:
{"object": the everyday name of the object, "material": the name of the material,
"type": "elastic" if it springs back, "elastoplastic" if it keeps dents whatever the speed, "viscoplastic" if it flows slowly under load}"""

PROPERTIES = """The frame shows this object: OBJECT, made of MATERIAL (TYPE).
From common knowledge, what are typical properties of this material at room temperature, for this object as a whole (with the air in
it, if it is a foam or a fabric)? Answer with one JSON object and nothing else, with exactly these keys, numbers in SI units:
{"density": kg/m3, "youngs_modulus": Pa, "poisson_ratio": a number below 0.495,
"yield_stress": Pa for elastoplastic and viscoplastic materials, else null, "viscosity": Pa s for viscoplastic materials, else null}"""

AGAIN = "\nYour last answer was refused: REASON Answer again."


@dataclass(frozen=True)
class Estimate:
    """A material as the model estimates it."""

    object: str
    material: str
    type: str
    """One of `TYPES`."""
    density: float
    """kg/m³."""
    youngs_modulus: float
    """Pa."""
    poisson_ratio: float
    yield_stress: float | None
    """Pa; None for elastic materials."""
    viscosity: float | None
    """Pa s; None for all but viscoplastic materials."""

    @property
    def law(self) -> str:
        """The constitutive law for the type."""
        if self.type == "elastic":
            return "corotated" if self.youngs_modulus > STIFF else "neo_hookean"
        return "von_mises" if self.type == "elastoplastic" else "viscoplastic"


def estimate(endpoint: Endpoint, frame: np.ndarray, mask: np.ndarray, progress: Progress) -> Estimate:
    """Ask what the object in `mask` (H, W) bool of `frame` (H, W, 3) uint8 RGB is, then what properties such a thing has.

    Raises:
        ModelError: the endpoint does not answer, or gives two unusable answers to a question.
    """
    crop = crop_object(frame, mask)
    what = checked(endpoint, WHAT, [frame, crop], check_what, progress)
    return properties(endpoint, what, crop, progress)


def properties(endpoint: Endpoint, what: dict[str, str], crop: np.ndarray, progress: Progress) -> Estimate:
    """Ask the second question: the properties of the object that `crop` (h, w, 3) uint8 RGB shows and `what` (object, material, type)
    describes. Raises as `estimate` does."""
    question = PROPERTIES
    for key in ("object", "material", "type"):
        question = question.replace(key.upper(), what[key])
    numbers = checked(endpoint, question, [crop], lambda values: check_properties(values, what["type"]), progress)
    return Estimate(**what, **numbers)  # type: ignore[arg-type]


def crop_object(frame: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The part of `frame` (H, W, 3) round the object in `mask` (H, W) bool, with `CROP_MARGIN`."""
    x0, y0, x1, y1 = box_of(mask)
    return frame[rows_columns(box_of(mask, max(8, round(CROP_MARGIN * (max(x1 - x0, y1 - y0) - 1)))))]


def checked(endpoint: Endpoint, question: str, images: list[np.ndarray], check: Callable[[Any], Any], progress: Progress) -> Any:
    """`check(answer)` for the JSON object that answers `question`; a refused answer is sent back once with the reason.

    `check` raises ValueError with a sentence for the model if the answer is not what was asked for.

    Raises:
        ModelError: the endpoint does not answer, or both answers are refused.
    """
    reason = ""
    for _ in range(ATTEMPTS):
        text = ask(endpoint, question + (AGAIN.replace("REASON", reason) if reason else ""), images, progress)
        try:
            return check(_parse(text))
        except ValueError as error:
            reason = str(error)
    raise ModelError(f"{endpoint.name} gives no usable answer: {reason}", "Ask a larger model, or name the material with --material.")


def _parse(text: str) -> Any:
    fenced = re.fullmatch(r"\s*```(?:json)?\s*(.*?)\s*```\s*", text, re.DOTALL)
    try:
        return parse_json(fenced[1] if fenced else text, constants=False)
    except ValueError as error:
        raise ValueError(f"it is not JSON ({str(error)[:80]}).") from error


def exact_keys(values: Any, keys: tuple[str, ...]) -> dict[str, Any]:
    """`values` if it is an object with exactly these `keys`; else raises ValueError."""
    if not isinstance(values, dict):
        raise ValueError("it is not a JSON object.")
    if set(values) != set(keys):
        raise ValueError(f"its keys are {', '.join(map(str, values))[:200]}; wanted are exactly {', '.join(keys)}.")
    return values


def check_what(values: Any) -> dict[str, str]:
    """The answer to the first question, checked; raises ValueError with the reason if it is refused."""
    values = exact_keys(values, ("object", "material", "type"))
    for key, value in values.items():
        if not isinstance(value, str) or not value.strip() or len(value) > 80 or not value.isprintable():
            raise ValueError(f"{key} is not a short text.")
    if values["type"] not in TYPES:
        raise ValueError(f"the type is {values['type']!r}; it must be one of {', '.join(TYPES)}.")
    return {key: value.strip() for key, value in values.items()}


def check_properties(values: Any, kind: str) -> dict[str, float | None]:
    """The answer to the second question for a material of type `kind`, checked; raises ValueError with the reason if it is refused."""
    values = exact_keys(values, tuple(RANGES))
    wanted = {"density", "youngs_modulus", "poisson_ratio"}
    wanted |= {"yield_stress"} if kind != "elastic" else set()
    wanted |= {"viscosity"} if kind == "viscoplastic" else set()
    result: dict[str, float | None] = {}
    for key, (least, most) in RANGES.items():
        value = values[key]
        if key not in wanted:
            result[key] = None
            continue
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise ValueError(f"{key} is {str(value)[:40]}, which is no number.")
        if not least <= value <= most:
            raise ValueError(f"{key} is {value:g}, outside {least:g} to {most:g} in SI units.")
        result[key] = float(value)
    yields, stiff = result["yield_stress"], result["youngs_modulus"]
    if yields is not None and stiff is not None and yields > stiff:
        raise ValueError(f"the yield stress {in_units(yields, 'Pa')} is above Young's modulus {in_units(stiff, 'Pa')}.")
    return result


def kept_estimate(take: Take, endpoint: Endpoint, frame: np.ndarray, mask: np.ndarray, progress: Progress) -> Estimate:
    """The same as `estimate`, but an answer for the same frame, mask and model that the take already holds is used again."""
    key = stamp_of("material", VERSION, endpoint.url, endpoint.model, np.ascontiguousarray(frame), np.ascontiguousarray(mask))
    try:
        kept = take.read_json(FILE) if take.file(FILE).is_file() else {}
    except TakeError as error:
        progress.warn(f"The kept answers are not used: {error.message}")
        kept = {}
    if isinstance(kept, dict) and isinstance(kept.get(key), dict):
        try:
            values = dict(kept[key])
            what = check_what({name: values.pop(name, None) for name in ("object", "material", "type")})
            return Estimate(**what, **check_properties(values, what["type"]))  # type: ignore[arg-type]
        except ValueError as error:
            progress.warn(f"A kept answer is not used: {error}")
    found = estimate(endpoint, frame, mask, progress)
    take.write_json(FILE, {**(kept if isinstance(kept, dict) else {}), key: asdict(found)})
    return found


def ask_material(
    take: Take, endpoint: Endpoint, observation: Observation, settings: BuildSettings, progress: Progress
) -> tuple[BuildSettings, list[str]]:
    """`settings` with the model's numbers for the observed object, and notes for the result. The user's own numbers take precedence.

    If the endpoint does not answer, or gives no usable answer, the settings' own material stays, and a warning and a note say so.
    """
    progress.begin("material", f"asking {endpoint.name} what the object is made of")
    try:
        found = kept_estimate(take, endpoint, observation.image, observation.masks[0], progress)
    except ModelError as error:
        note = f"{error.message} The material {settings.material} is used instead. {error.hint}"
        progress.warn(note)
        return settings, [note]
    stiff = in_units(found.youngs_modulus, "Pa", 2)
    progress.update(1.0, f"{found.object}, {found.material}: {found.density:.0f} kg/m³, {stiff}, {found.type}")
    return with_estimate(settings, found, endpoint.name), []


def with_estimate(settings: BuildSettings, found: Estimate, by: str) -> BuildSettings:
    """`settings` with the numbers that the user did not give filled in from `found`, which was estimated by the model named `by`."""
    values = {name: getattr(found, name) for name in ("law", *RANGES)}
    missing = {name: value for name, value in values.items() if getattr(settings, name) is None and value is not None}
    return replace(settings, **missing, estimated_material=found.material, estimated_by=f"{found.object}, by {by}")
