"""One frozen dataclass of settings per stage. Unknown keys are refused, so that a typing error never runs with a default.

The same fields are the command line's options, the panel's properties and the table of a take's `take.toml`.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from dataclasses import dataclass
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from .conventions import DEFAULT_FOV_DEGREES, GRAVITY
from .errors import UsageError

T = TypeVar("T")


@dataclass(frozen=True)
class ObserveSettings:
    """From a clip to masks, depth and tracks."""

    fps: float | None = None
    """Frames per second; None takes the file's."""
    frames: tuple[int, int] | None = None
    """First and last picture (inclusive) as indices in the file; None takes all."""
    mask: str | None = None
    """PNG of the first picture, non-zero = object."""
    box: tuple[float, float, float, float] | None = None
    """X0 Y0 X1 Y1 [px] round the object in the first picture."""
    points: tuple[float, ...] | None = None
    """X0 Y0 X1 Y1 ... [px], points on the object in the first picture."""
    tracks: str | None = None
    """NPZ with xy (T+1,K,2) [px] and visible (T+1,K), instead of tracking."""
    depth: str | None = None
    """NPY (H, W) metres along the view axis, infinite off the object."""
    distance: float | None = None
    """Metres from the camera to the object."""
    pixels_per_metre: float | None = None
    """Image scale in the object's plane; gives the distance."""
    camera: str | None = None
    """JSON: width height fx fy cx cy camera_to_world, optional k1 k2 p1 p2 k3; or a nerfstudio transforms.json."""
    fov: float = DEFAULT_FOV_DEGREES
    """Horizontal field of view [degrees] when no camera is given."""
    pin: str | None = None
    """PNG of the first picture, non-zero = held in place."""
    depth_model: str | None = None
    """Folder or hub name of a network that gives metric depth; a distance scales it."""
    prompt: str | None = None
    """What the object is, in words, for `detector_model`."""
    detector_model: str | None = None
    """Folder or hub name of a network that finds a box from words."""
    mask_model: str | None = None
    """Folder or hub name of a network that cuts out the object and follows it."""
    track_model: str | None = None
    """Folder or hub name of a network that follows points."""
    seed: int = 0


PARTICLES, FLOWING_PARTICLES = 600, 1800
"""How many particles stand for a body. Near its yield stress, one that flows answers a load that is 4 % too small with 15 % less flow: a
ball of 600 particles asked for forces 17 % off, one of 1800 for 8 %."""


@dataclass(frozen=True)
class BuildSettings:
    """From an observation to a body."""

    material: str = "leaf"
    law: str | None = None
    density: float | None = None
    """kg/m³."""
    youngs_modulus: float | None = None
    """Pa."""
    poisson_ratio: float | None = None
    yield_stress: float | None = None
    """Pa."""
    viscosity: float | None = None
    """Pa s."""
    estimated_material: str | None = None
    """What a vision-language model calls the material, if the numbers above are its own; `estimated_by` names object and model."""
    estimated_by: str | None = None
    thickness: float | None = None
    """Metres behind the visible surface; None guesses from the silhouette."""
    particles: int | None = None
    """Roughly how many particles stand for the body; None is PARTICLES, or FLOWING_PARTICLES where the material flows."""
    seed: int = 0


@dataclass(frozen=True)
class RecoverSettings:
    """From targets to a force field."""

    gravity: tuple[float, float, float] = GRAVITY
    """Known acceleration [m/s²] that is not part of the field."""
    clamp_depth: float = 0.0
    """Where a held part begins to be held: so many grid cells (1.6 particle spacings each) below the border of what is marked as held."""
    stiffness: str = "free"
    """given, or free: of an elastic body that is held it is found together with the force."""
    representation: str = "causal_triplane"
    device: str = "auto"
    iterations: int = 12
    """Gauss-Newton iterations of a window at most, once the body is followed; 1 gives a draft, with a knot every four frames."""
    schedule: str = "default"
    """default, or paper: gradient descent frame by frame."""
    objective: str = "tracking"
    """tracking, or with schedule paper: image, flow_depth."""
    frame_iterations: int = 60
    """Gradient-descent iterations per frame at most, with schedule paper."""
    refine: int = 0
    """Steps by which the distilled field is refined through the simulator at most, see `recovery.refinement`."""
    seed: int = 0


REPORTS = ("none", "quick", "full")


@dataclass(frozen=True)
class ReportSettings:
    """What is drawn of a recovery."""

    report: str = "quick"
    """One of REPORTS. none: nothing; quick: report.json, report.png, overlay.mp4; full: resimulated.mp4 and the look of the clip, too."""


@dataclass(frozen=True)
class BodyEdit:
    """One body of an edit; see `engine/stages.py` resimulate."""

    name: str
    mesh: str
    """Path of an OBJ, PLY or NPZ (vertices (V,3) m, triangles (M,3)), or "recovered": the clip's own object."""
    material: str | None = None
    density: float | None = None
    youngs_modulus: float | None = None
    poisson_ratio: float | None = None
    law: str | None = None
    yield_stress: float | None = None
    viscosity: float | None = None
    loss_factor: float | None = None
    """Damping, as of `Material`."""
    mass: float | None = None
    """Of the whole body [kg], instead of a density."""
    mass_scale: float = 1.0
    youngs_modulus_scale: float = 1.0
    """Factor on Young's modulus."""
    pin: str | None = None
    """NPY of vertex indices; of particle indices for the recovered object."""
    pin_weights: str | None = None
    """NPY of one weight in 0..1 per index of `pin`: 1 holds firmly, less draws back like a spring. None holds all firmly."""
    free: str | None = None
    """NPY of particle indices of the recovered object that are held in the clip and let go here."""
    velocity: tuple[float, float, float] | None = None
    """Initial velocity [m/s]; None is rest for a mesh, the recovered one for the recovered object."""
    start_frame: int = 0
    """The body stands still before this frame."""
    shell: bool | None = None
    """True: a thin shell; False: a solid. None: a shell if its mesh is open and its material comes as a sheet."""
    areal_density: float | None = None
    """kg/m², instead of the material's, as are the next three. Of shells only."""
    thickness: float | None = None
    """m."""
    tensile_stiffness: float | None = None
    """N/m."""
    bending_stiffness: float | None = None
    """N m."""


@dataclass(frozen=True)
class ColliderEdit:
    """Something in the way of the bodies that they do not move: a mesh or a plane."""

    name: str
    mesh: str | None = None
    """Path of a closed OBJ, PLY or NPZ; bodies stay outside."""
    plane: tuple[float, float, float, float, float, float] | None = None
    """A point [m] and the normal of an infinite plane; bodies stay on the side that the normal points to."""
    kind: str = "separate"
    """separate: may leave, may not enter. slip: slides and does not leave. sticky: stands still on it."""
    friction: float = 0.3
    """Coulomb's coefficient, for separate and slip."""


@dataclass(frozen=True)
class Edit:
    """What to simulate in a recovered field."""

    body: tuple[BodyEdit, ...]
    collider: tuple[ColliderEdit, ...] = ()
    gravity: tuple[float, float, float] = GRAVITY
    field_strength: float | tuple[float, ...] = 1.0
    """Factor on the field, or one factor per frame."""
    contact: bool = False
    """True: all bodies share one grid and push each other. False: each moves alone."""


def from_mapping(cls: type[T], values: dict[str, Any], where: str) -> T:
    """Build the dataclass `cls` from a plain mapping (TOML, JSON, argparse), lists turned into tuples.

    Raises:
        UsageError: for a key that `cls` does not have or one that it needs, or a value of another kind; `where` names the source in the
            message.
    """
    fields = {field.name: field for field in dataclasses.fields(cls)}  # type: ignore[arg-type]
    unknown = sorted(set(values) - set(fields))
    if unknown:
        raise UsageError(f"{where}: unknown setting {', '.join(unknown)}.", f"Known settings: {', '.join(fields)}.")
    required = [
        name for name, field in fields.items() if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    missing = [name for name in required if name not in values]
    if missing:
        raise UsageError(f"{where}: {', '.join(missing)} is missing.", f"Required: {', '.join(required)}.")
    hints = get_type_hints(cls)
    for name, value in values.items():
        if not _fits(value, hints[name]):
            raise UsageError(f"{where}: {name} is {value!r}.", f"It must be {_kind(hints[name])}.")
    return cls(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})


_KINDS = {float: "a finite number", int: "a whole number", bool: "true or false", str: "a text in quotes"}


def _fits(value: Any, hint: Any) -> bool:
    """Whether a plain value may stand where the dataclass says `hint`: a list for a tuple, a whole number for a float."""
    if get_origin(hint) is tuple:
        kinds = get_args(hint)
        if not isinstance(value, (list, tuple)):
            return False
        if kinds[-1] is Ellipsis:
            return all(_fits(item, kinds[0]) for item in value)
        return len(value) == len(kinds) and all(_fits(item, kind) for item, kind in zip(value, kinds))
    if get_args(hint):  # a union
        return any(_fits(value, kind) for kind in get_args(hint))
    if hint in (float, int) and isinstance(value, bool):
        return False
    if hint is float:
        return isinstance(value, (int, float)) and math.isfinite(value)
    return isinstance(value, hint)


def _kind(hint: Any) -> str:
    """What `_fits` wants, in words."""
    if get_origin(hint) is tuple:
        kinds = get_args(hint)
        count = "a list" if kinds[-1] is Ellipsis else f"a list of {len(kinds)}"
        return f"{count}, each {_kind(kinds[0])}"
    if get_args(hint):
        return " or ".join(_kind(kind) for kind in get_args(hint) if kind is not type(None))
    return _KINDS.get(hint, f"a table of {hint.__name__}")


def to_mapping(settings: Any) -> dict[str, Any]:
    """The settings as plain values, None left out (TOML has no null)."""
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in dataclasses.asdict(settings).items()
        if value is not None
    }


def toml_text(values: dict[str, Any]) -> str:
    """Plain values, lists, nested tables and lists of tables as TOML text (the standard library reads TOML but does not write it).

    Raises:
        TypeError: for a value that TOML does not have.
    """
    return "\n\n".join(_toml_blocks(values, "", ())) + "\n"


def _toml_blocks(values: dict[str, Any], header: str, path: tuple[str, ...]) -> list[str]:
    """One block of text per table, the table's own values first (TOML allows them nowhere else)."""
    lines, nested = [], []
    for key, value in values.items():
        inner = (*path, key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key))
        if isinstance(value, dict):
            nested += _toml_blocks(value, f"[{'.'.join(inner)}]", inner)
        elif isinstance(value, (list, tuple)) and value and all(isinstance(item, dict) for item in value):
            for item in value:
                nested += _toml_blocks(item, f"[[{'.'.join(inner)}]]", inner)
        else:
            lines.append(f"{inner[-1]} = {_toml_value(value)}")
    # a table without values of its own needs no header, unless it is empty or one of a list
    if header and (lines or not nested or header.startswith("[[")):
        lines.insert(0, header)
    return (["\n".join(lines)] if lines else []) + nested


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml_value(item) for item in value) + "]"
    raise TypeError(f"no TOML for {type(value).__name__}")
