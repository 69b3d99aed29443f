"""Units, axes and letters used by every floor of the engine.

SI throughout: metres, seconds, kilograms, pascals. The force field is a body-force density f(x, t) in N/m³: a particle of rest
volume V feels f V, a body of density rho accelerates by f / rho. Gravity is a separate, known acceleration and no part of the field.

World: Blender's, right-handed, Z up. Cameras: OpenCV's axes (x right, y down, z forward) with a 4x4 `camera_to_world`; pixel
centres are at integers, so the principal point of an image w wide is (w - 1) / 2.

Time: a *frame* is video time, a *substep* solver time, an *iteration* optimiser time. A clip of T + 1 frames has T
intervals; the force of interval t is constant from frame t to frame t + 1.

Letters
    T   intervals (frames: T + 1)               N   particles           K   tracked points
    x   particle positions [m]                  v   velocities [m/s]    C   affine velocity [1/s]     F   deformation gradient
    X   positions at rest (frame 0) [m]         E   Young's modulus [Pa], nu Poisson's ratio, mu, lam Lamé's parameters [Pa]
    dx  grid spacing [m]                        dt  substep [s]         f   force density [N/m³]      a   acceleration [m/s²]

The paper (arXiv 2512.00762) calls the deformation gradient D; the MPM literature calls it F, and so does this code.

A number on which the physics or the statistics depend is a field of a frozen record, a `constant` with its unit, reason and source:

    materials.py                    SolverLimits     LIMITS   grid, substeps, damping
    recovery/prior/constants.py     PriorConstants   PRIOR    what is assumed of the force and the body beforehand
    recovery/targets/constants.py   NoiseConstants   NOISE    errors of the observations, and of the solver's body
    recovery/solve/constants.py     PaceConstants    PACE     how far and how finely the solve goes

docs/reference/constants.md is written from them, and `make sensitivity` halves and doubles each. Numbers that only concern rounding, memory
or the number of cores are not among them; they stand where they are used.
"""

from __future__ import annotations

import math
import os
import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import numpy as np

Number = TypeVar("Number", float, "np.ndarray")

GRAVITY = (0.0, 0.0, -9.81)
"""Standard gravity in Blender's world [m/s²]."""
NO_GRAVITY = (0.0, 0.0, 0.0)

LARGEST_IMAGE = 2**26
"""Pixels, eight thousand squared: a larger image is a mistake, or its header is false, and it is not decoded."""

FARTHEST = 2e7
"""Distance from the origin [m] beyond which a unit must be wrong: map coordinates reach 1e7."""

FRAME_RATES = (0.1, 1e6)
"""Lowest and highest frame rate of a clip [1/s]: from a time-lapse to the fastest camera."""

DEFAULT_FOV_DEGREES = 50.0
"""Horizontal field of view assumed when no camera is given: a 39 mm lens on Blender's 36 mm sensor, a phone's main camera in video mode."""


BEAUFORT = (0.3, 1.6, 3.4, 5.5, 8.0, 10.8, 13.9, 17.2, 20.8, 24.5, 28.5, 32.7)
"""Least speed [m/s] of the Beaufort numbers 1 to 12 (WMO-No. 8, Guide to Instruments, annex 5.A)."""


def beaufort(speed: float) -> int:
    """Beaufort number, 0 to 12, of a speed [m/s]."""
    return bisect_right(BEAUFORT, speed)


def front_view(distance: float) -> np.ndarray:
    """`camera_to_world` (4, 4) of Blender's front view: at (0, -distance, 0) [m], looking along +Y, image right +X, image up +Z."""
    import numpy as np  # not above: Blender needs the constants when it switches the extension on, and NumPy takes a tenth of a second

    pose = np.eye(4)
    pose[:3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    pose[:3, 3] = [0.0, -distance, 0.0]
    return pose


def lame(youngs_modulus: Number, poisson_ratio: Number) -> tuple[Number, Number]:
    """Lamé's parameters (mu, lam) [Pa] from Young's modulus [Pa] and Poisson's ratio, numbers or arrays."""
    mu = youngs_modulus / (2.0 * (1.0 + poisson_ratio))
    lam = youngs_modulus * poisson_ratio / ((1.0 + poisson_ratio) * (1.0 - 2.0 * poisson_ratio))
    return mu, lam


IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".exr"}


def is_sequence(path: str) -> bool:
    """Whether a path is that of a sequence of images: a folder, or a pattern such as shot_%04d.png that is not itself a file's name."""
    if Path(path).is_file():
        return False
    return Path(path).is_dir() or "*" in path or re.search(r"%0?\d*d", Path(path).name) is not None


def image_files(path: str) -> list[Path]:
    """The files of a sequence, ordered by the numbers in their names; empty if there are none."""
    place = Path(path)
    if place.is_dir():
        files = [file for file in place.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES]
    elif "*" in path:
        files = list(place.parent.glob(place.name)) if place.parent.is_dir() else []
    else:
        name = re.sub(r"%0?\d*d", r"(\\d+)", re.sub(r"([.()\[\]+])", r"\\\1", place.name))
        files = [file for file in place.parent.glob("*") if re.fullmatch(name, file.name)] if place.parent.is_dir() else []
    return sorted(files, key=lambda file: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)])


def in_the_way(path: Path) -> Path | None:
    """The part of a folder's path, or the whole of it, that exists and is not a folder, so that the folder cannot be made."""
    # unlike Path's, these functions accept names that no file system allows
    return next((part for part in (path, *path.parents) if os.path.exists(part) and not os.path.isdir(part)), None)


FRAME = re.compile(r"(?<![\w/\\-])frame (0|[1-9]\d*)\b(?: to frame (\d+)\b)?(?! (?:to \d+ )?of the file)(?![./\\-]\S)")
"""A frame, or a span of frames, as `frame_named` and `frames_named` write it; what is part of a file's name is none."""
FRAME_OF_FILE = re.compile(r"\bframe (\d+)(?: to (\d+))? of the file\b")
"""The same as `as_in_file` writes it."""


def frame_named(t: int) -> str:
    """The name, in a message, of frame t of a clip, counted from the first frame used: see `as_in_file`."""
    return f"frame {t}"


def as_in_file(text: str, first_frame: int) -> str:
    """A text about a clip with its frames counted from the beginning of the file, as --frames and all other options count them.

    The engine counts from `first_frame`, the first that is used, and so the text is changed where it leaves the engine. The panel replaces
    both ways of counting by the scene's.
    """

    def counted_anew(found: re.Match[str]) -> str:
        last = f" to {first_frame + int(found[2])}" if found[2] else ""
        return f"frame {first_frame + int(found[1])}{last} of the file"

    return FRAME.sub(counted_anew, text)


def frames_named(first: int, last: int) -> str:
    """The name of consecutive frames, with a preposition, as a part of a sentence."""
    return f"from {frame_named(first)} to {frame_named(last)}" if last > first else f"in {frame_named(first)}"


DISTRUST = "Do not use this field"
"""Part of every note that calls a field useless."""


def distrusted(notes: Sequence[str]) -> list[str]:
    """The notes of a recovery that call its field useless."""
    return [note for note in notes if DISTRUST in note]


DRAFT = "This is a draft"
"""Beginning of the note on a field from one iteration."""
UNHELD = "Nothing was marked as held"
"""Beginning of the note on a force that only balances gravity: by it the panel recognises the note, and offers the remedy."""
HELD_PLACE = "held place"
"""Subject of a preview's verdict on the held place, by which the panel recognises it in the same way."""
EDIT, OF_SCENE = "edit.toml", "# scene "
"""File of an edit that the panel has written into the folder of its re-simulation, and the beginning of its first line."""
PANEL_INPUTS = "blender_inputs"
"""Folder in a take for the files that the panel makes from the scene, which may be there before the take is."""
BODY, TIME = "body", "time"
"""Subjects of a preview's verdicts on the solve, which are valid only for the material and the held place that it was given."""


def constant(value: Any, unit: str, reason: str, source: str) -> Any:
    """A field of a record of constants: a number or a tuple of numbers, its unit ("1" for none), its meaning or reason, and its source."""
    return field(default=value, metadata={"unit": unit, "reason": reason, "source": source})


SCALES = {
    "m": ((1e-3, "mm"), (1.0, "m"), (1e3, "km")),
    "m²": ((1e-4, "cm²"), (1.0, "m²")),
    "m³": ((1e-6, "cm³"), (1e-3, "l"), (1.0, "m³")),
    "kg": ((1e-6, "mg"), (1e-3, "g"), (1.0, "kg")),
    "kg/m²": ((1e-3, "g/m²"), (1.0, "kg/m²")),
    "Pa": ((1.0, "Pa"), (1e3, "kPa"), (1e6, "MPa"), (1e9, "GPa")),
    "N m": ((1e-6, "µN m"), (1e-3, "mN m"), (1.0, "N m")),
    "B": ((1.0, "B"), (1e3, "kB"), (1e6, "MB"), (1e9, "GB")),
}
"""Units in which a quantity is shown to a person: the size of each in the SI unit, and its name."""
PLAIN = (1e-9, 1e15)
"""Numbers outside this range are written with a power of ten."""


def in_figures(value: float, figures: int = 3) -> str:
    """A number for a person, with so many significant figures: without a power of ten or trailing zeros."""
    rounded = float(f"{value:.{figures}g}")
    if rounded == 0.0 or not PLAIN[0] <= abs(rounded) < PLAIN[1]:
        return f"{rounded:g}"
    decimals = max(figures - 1 - math.floor(math.log10(abs(rounded))), 0)
    text = f"{rounded:,.{decimals}f}" if abs(rounded) >= 1e5 else f"{rounded:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def in_units(value: float, unit: str, figures: int = 3) -> str:
    """A quantity in `unit` for a person, in a unit that suits its size: 0.00112 kg becomes 1.12 g. Units not in `SCALES` are kept."""
    scales, size = SCALES.get(unit, ()), abs(float(f"{value:.{figures}g}"))
    if size == 0.0 or not math.isfinite(size) or not scales:
        return f"{in_figures(value, figures)} {unit}"
    scale, word = next((each for each in reversed(scales) if size >= each[0]), scales[0])
    return f"{in_figures(value / scale, figures)} {word}"


def counted(number: int, what: str) -> str:
    """A number of things whose plural ends in s: 1 frame, 2 frames."""
    return f"{number} {what}{'s' * (number != 1)}"


def weight_in_words(areal_density: float, area: float) -> str:
    """Areal density [kg/m²] and mass of a sheet of `area` [m²], for a person."""
    return f"{in_units(areal_density, 'kg/m²')}, {in_units(areal_density * area, 'kg')}"
