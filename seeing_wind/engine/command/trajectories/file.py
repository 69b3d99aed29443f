"""Reads a trajectory file and checks each key: its numbers, its motion and its gravity."""

from __future__ import annotations

import difflib
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...conventions import FARTHEST, FRAME_RATES, counted, in_figures, in_units
from ...errors import ObjectError, UsageError
from ...reading import array_names, read_arrays

FASTEST = 1000.0
"""A speed [m/s], three times that of sound, that no wind gives to most of a body's points."""
ACROSS = (5e-4, 50.0)
"""Range [m] of the longest side of things filmed in the wind, from a seed's hair to all but the tallest trees. Outside it, a note asks
whether the unit is another one."""
NUMBERS = {"density": "rho", "youngs_modulus": "E", "poisson_ratio": "nu"}
"""Properties of `Material` -> keys of the file."""
MEANT = {
    "rho": ("the density", "kg/m³"), "E": ("Young's modulus", "Pa"), "nu": ("Poisson's ratio", ""), "yield_stress": ("", "Pa"),
    "areal_density": ("", "kg/m²"), "thickness": ("", "m"), "damping": ("the loss factor", ""),
}  # fmt: skip
"""Keys of the file that are properties of a material -> their name in words ("" where the key is clear) and their unit."""
STRONGEST = 1e4
"""Largest gravity [m/s²] along an axis, as in `RecoverSettings.gravity`."""
READ = ("x", "fps", "rho", "E", "nu", "yield_stress", "fixed", "gravity", "visible", "sigma", "covariance", "material")
"""Keys that are read from a file."""
SHEET_KEYS = ("faces", "areal_density", "thickness", "damping")
"""Additional keys of a file whose points are the vertices of a sheet (`sheets`), which is one that has `faces`."""
TRUTH = ("v", "acc", "name", "field", "wind", "force")
"""Further keys that simulators write, for comparison. They are not read, as velocities and forces are to be recovered."""
OTHER_NAMES = {
    **NUMBERS, "young_modulus": "E", "poissons_ratio": "nu", "pinned": "fixed", "held": "fixed", "frame_rate": "fps", "noise": "sigma",
}  # fmt: skip
"""Other programs' names of keys -> the keys."""


def values_of(path: str | os.PathLike[str], keys: tuple[str, ...] = READ) -> tuple[dict[str, np.ndarray], list[str]]:
    """The file's arrays under these keys, and a note on unknown keys, if any. Raises UsageError if the file cannot be read."""
    if not Path(path).is_file():
        raise UsageError(f"There is no file {path}.", "Give an NPZ with x (T+1,N,3) in metres and fps.")
    try:
        unknown = [name for name in array_names(path) if name not in keys + TRUTH]
        values = read_arrays(path, keys)
    except (OSError, ValueError) as error:
        hint = "Write it with numpy.savez, each key an array of numbers or bool: numpy.array(..., dtype=float)."
        raise UsageError(f"{path} cannot be read as trajectories: {error}.", hint) from error
    if not unknown:
        return values, []
    meant = [f"{near} by {name}" for name in unknown if (near := _near(name, keys)) is not None]
    asked = f" Did you mean {', '.join(meant)}?" if meant else ""
    names = f"{', '.join(unknown)} {'is' if len(unknown) == 1 else 'are'}"
    return values, [f"The file's {names} not read.{asked} Known keys: {', '.join(keys)}."]


def _near(name: str, keys: tuple[str, ...]) -> str | None:
    """The one of `keys` that `name` was probably meant to be; None if no key is similar."""
    known = {key.lower(): key for key in keys} | {other: key for other, key in OTHER_NAMES.items() if key in keys}
    close = difflib.get_close_matches(name.lower(), known, n=1)
    return known[close[0]] if close else None


def motion_of(values: dict[str, np.ndarray], path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """x (T+1, N, 3) [m], visible (T+1, N), fixed (N,) and fps of a file, checked. Raises as `bodies.read_trajectories`."""
    for key in ("x", "fps"):
        if key not in values:
            raise UsageError(f"{path} lacks {key}.", "It needs x (T+1,N,3) in metres and fps.")
    x = numbers_in(values["x"], "x", path)
    if x.ndim != 3 or x.shape[2] != 3:
        raise UsageError(f"{path}: x has shape {x.shape}.", "It must be (T+1,N,3).")
    if len(x) < 4 or x.shape[1] < 1:
        has = f"{path} has {counted(len(x), 'frame')} of {counted(x.shape[1], 'particle')}."
        raise ObjectError(has, "At least four frames of one particle are needed.")
    visible = _visible(values, x, path)
    fixed = flags_in(values.get("fixed", np.zeros(x.shape[1], dtype=bool)), "fixed", x.shape[1:2], path)
    fps = number_in(values["fps"], "fps", path)
    if not FRAME_RATES[0] <= fps <= FRAME_RATES[1]:
        raise UsageError(f"{path}: fps is {fps:g}.", f"It must lie between {FRAME_RATES[0]:g} and {FRAME_RATES[1]:g} frames per second.")
    _check_places(x, visible, fps, path)
    return x, visible, fixed, fps


def _visible(values: dict[str, np.ndarray], x: np.ndarray, path: str | os.PathLike[str]) -> np.ndarray:
    """(T+1, N) bool: which points of x (T+1, N, 3) are visible; all of them if the file does not say.

    Raises:
        ObjectError: a point is not visible in frame 0, none is later, or a visible position is not finite.
    """
    visible = flags_in(values.get("visible", np.ones(x.shape[:2], dtype=bool)), "visible", x.shape[:2], path)
    if not visible[0].all():
        hidden = np.flatnonzero(~visible[0])
        raise ObjectError(
            f"{path}: {len(hidden)} of {x.shape[1]} points are not visible in frame 0, the first of them point {hidden[0]}.",
            "The body is built from frame 0: begin with a frame that shows every point, or remove those points.",
        )
    if not visible[1:].any():
        raise ObjectError(f"{path}: no point is visible after frame 0.", "Mend visible, or leave it out: then every point counts.")
    lost = np.argwhere(visible & ~np.isfinite(x).all(axis=2))
    if len(lost):
        t, n = lost[0]
        raise ObjectError(
            f"{path}: the position of particle {n} in frame {t} is not finite.",
            "Mend the file or remove that particle; after frame 0, `visible` may say that it is not seen.",
        )
    return visible


def _check_places(x: np.ndarray, visible: np.ndarray, fps: float, path: str | os.PathLike[str]) -> None:
    """Refuse visible positions x (T+1, N, 3) [m] beyond `FARTHEST`, and a body of which most points move faster than `FASTEST`."""
    far = float(np.abs(x[visible]).max())
    if far > FARTHEST:
        raise UsageError(f"{path}: a position lies {in_units(far, 'm')} from the origin.", "Check the unit: metres.")
    step = np.where(visible[1:] & visible[:-1], np.linalg.norm(np.diff(x, axis=0), axis=2), np.nan)
    way = np.nan_to_num([np.nanmedian(row) if np.isfinite(row).any() else 0.0 for row in step])
    worst = int(way.argmax())
    if way[worst] * fps > FASTEST:
        raise ObjectError(
            f"{path}: from frame {worst} to frame {worst + 1} the body jumps {in_units(way[worst], 'm')}, which is "
            f"{in_figures(way[worst] * fps)} m/s.",
            "Check the unit of x (metres), fps, and that the points keep their order; cut the file where the body jumps.",
        )


def size_note(x: np.ndarray) -> list[str]:
    """A note on points x (N, 3) [m] whose extent suggests another unit. A single point has no extent to judge by."""
    size = float(np.ptp(x, axis=0).max())
    if len(x) == 1 or ACROSS[0] <= size <= ACROSS[1]:
        return []
    other = "millimetres" if size > ACROSS[1] else "another unit"
    return [f"The body is {in_units(size, 'm', 2)} across: are its points in {other}? They are taken as metres."]


def gravity_of(
    values: dict[str, np.ndarray], given: Sequence[float] | None, path: str | os.PathLike[str]
) -> tuple[tuple[float, float, float], list[str]]:
    """Gravity (3,) [m/s²]: `given` or, if that is None, the file's; and a note if neither states it, in which case it is zero."""
    if given is not None:
        return (given[0], given[1], given[2]), []
    gravity = numbers_in(values.get("gravity", np.zeros(3)), "gravity", path)
    if gravity.shape not in ((), (3,)) or not np.isfinite(gravity).all() or (gravity.shape == () and gravity != 0.0):
        raise UsageError(f"{path}: gravity is {gravity.tolist()}.", "It must be three finite numbers in m/s².")
    if (np.abs(gravity) > STRONGEST).any():
        raise UsageError(f"{path}: gravity is {gravity.tolist()} m/s².", f"Give at most {STRONGEST:g} m/s² along each axis.")
    x, y, z = np.broadcast_to(gravity, (3,)).tolist()
    missing = "The file has no gravity, and no option gives it: it counts as part of the field."
    return (x, y, z), [] if "gravity" in values else [missing]


def flags_in(value: np.ndarray, key: str, shape: tuple[int, ...], path: str | os.PathLike[str]) -> np.ndarray:
    """The array as bool. Raises UsageError if it has another type or shape."""
    value = np.asarray(value)
    if value.shape != shape or value.dtype.kind not in "biu":
        raise UsageError(f"{path}: {key} is {value.dtype} of shape {value.shape}.", f"It must be {shape} of true and false.")
    return value.astype(bool)


def numbers_in(value: np.ndarray, key: str, path: str | os.PathLike[str]) -> np.ndarray:
    """The array as float64. Raises UsageError if it does not hold numbers."""
    if np.asarray(value).dtype.kind not in "fiu":
        raise UsageError(f"{path}: {key} holds {np.asarray(value).dtype}, not numbers.", "Write plain numbers in SI units.")
    return np.asarray(value, dtype=np.float64)


def number_in(value: np.ndarray, key: str, path: str | os.PathLike[str]) -> float:
    """The array's only number. Raises UsageError if it is not a single finite number."""
    numbers = numbers_in(value, key, path)
    if numbers.size != 1:
        raise UsageError(f"{path}: {key} is not one number but has shape {numbers.shape}.", "Give one number for the whole body.")
    if not np.isfinite(numbers).all():
        raise UsageError(f"{path}: {key} is {numbers.item()}, which is not finite.", "Give a finite number in SI units.")
    return float(numbers.item())


def as_stated(key: str, value: float, path: str | os.PathLike[str]) -> str:
    """A sentence that states the file's value under a key of `MEANT`, in the file's own unit."""
    what, unit = MEANT[key]
    return f"{path}: {key}, {what}, is {value:g} {unit}".replace(", ,", "").rstrip() + "."
