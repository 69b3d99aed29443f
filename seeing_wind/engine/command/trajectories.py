"""3D trajectories from outside (another simulator, motion capture) as particles and targets."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..conventions import FARTHEST, FRAME_RATES
from ..errors import MaterialError, ObjectError, UsageError
from ..materials import adjusted, find
from ..reading import array_names, read_arrays
from ..records import Attachment, Material, Particles, PointTargets

FIXED_DEPTH = 0.5
"""Grid cells (`RecoverSettings.clamp_depth`) at first. A file's `fixed` is what hardly moved: that reaches some way above what is held."""
DENSITY, POISSON_RATIO = 300.0, 0.3
"""Of a body whose file does not say [kg/m³]: those of foam. The stiffness is not guessed: forces that bend go with it."""
NUMBERS = {"density": "rho", "youngs_modulus": "E", "poisson_ratio": "nu"}
"""Properties of `Material` -> keys of the file."""
HELD_WAY = 0.2
"""Particle spacings that held particles may move without a word."""

FASTEST = 1000.0
"""Speed [m/s] of most of a body's points that no wind gives: three times that of sound."""
FINEST = 1e-9
"""Metres: no position is more certain."""
FEW = 8
"""Points below which a body has no shape to speak of."""

READ = ("x", "fps", "rho", "E", "nu", "yield_stress", "fixed", "gravity", "visible", "sigma", "covariance", "material")
"""Keys of a file."""
SHEET_KEYS = ("faces", "areal_density", "thickness", "damping")
"""Keys of a file whose points are the vertices of a sheet (`sheets`): `faces` says that they are."""
TRUTH = ("v", "acc", "name", "field", "wind", "force")
"""What simulators write besides, for a comparison: velocities and forces are to be found."""
BEHAVIOURS = ("elastic", "elastoplastic")
"""What simulators write as `material` and is no material: the law is that of `yield_stress`."""
OTHER_NAMES = {
    **NUMBERS, "young_modulus": "E", "poissons_ratio": "nu", "pinned": "fixed", "held": "fixed", "frame_rate": "fps", "noise": "sigma",
}  # fmt: skip
"""What the same things are called elsewhere."""


@dataclass(frozen=True)
class Trajectories:
    """What `recover-trajectories` starts from."""

    particles: Particles
    material: Material
    targets: PointTargets
    fps: float
    gravity: tuple[float, float, float]
    clamp_depth: float = FIXED_DEPTH
    notes: tuple[str, ...] = ()
    """What was assumed because neither file nor options say it, what of the file is not used, and what contradicts itself."""


def read_trajectories(
    path: str | os.PathLike[str],
    material: Material | None = None,
    gravity: tuple[float, float, float] | None = None,
    **properties: Any,
) -> Trajectories:
    """Read an NPZ with `x` (T+1,N,3) m and `fps`.

    Needed is `E` Pa, too, or a `material` of the library, where no option gives them. Optional are `rho` kg/m³, `nu`, `yield_stress` Pa,
    `fixed` (N,) bool, `gravity` (3,) m/s², `visible` (T+1,N) bool, all of it true in picture 0, and the errors of x: `sigma` m, the
    standard deviation of a coordinate, or `covariance` (3,3) or (N,3,3) m². Where a point is not visible, its x is not used.
    Velocities and forces in the file, if any, are not read: they are what is to be found.

    Args:
        material: in place of all that the file says of the material.
        gravity: [m/s²], in place of the file's.
        properties: as of `materials.adjusted`, in place of the file's and the material's; None leaves those.

    Raises:
        UsageError: no such file, no NPZ, a key missing, of the wrong type or shape, or a number out of its bounds.
        ObjectError: too few pictures or particles, points that picture 0 does not show, visible positions that are not finite, a body that
            jumps.
        MaterialError: as `materials.adjusted`, a material that the library does not have, or no stiffness.
    """
    values, notes = values_of(path)
    x, visible, fixed, fps = motion_of(values, path)
    sigma, covariance = _errors(values, x.shape[1], float(np.ptp(x[visible], axis=0).max()), path)
    spacing = particle_spacing(x[0])
    particles = Particles(x=x[0], volume=np.full(x.shape[1], spacing**3), pinned=fixed, spacing=spacing)
    everyone = Attachment(index=np.arange(x.shape[1], dtype=np.int32)[:, None], weight=np.ones((x.shape[1], 1)))
    targets = PointTargets(np.where(visible[..., None], x, np.nan), visible, everyone, sigma, covariance)
    found, assumed = _material(values, material, properties, path)
    down = gravity_of(values, path) if gravity is None else gravity
    if gravity is None and "gravity" not in values:
        assumed.append("The file has no gravity, and no option gives it: it counts as part of the field.")
    notes = [*_few(x.shape[1]), *assumed, *notes, *_moving(targets.x[:, fixed], spacing)]
    return Trajectories(particles, found, targets, fps, down, notes=tuple(notes))


def motion_of(values: dict[str, np.ndarray], path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """x (T+1, N, 3) [m], visible (T+1, N), fixed (N,) and fps of a file, checked. Raises as `read_trajectories`."""
    for key in ("x", "fps"):
        if key not in values:
            raise UsageError(f"{path} lacks {key}.", "It needs x (T+1,N,3) in metres and fps.")
    x = numbers_in(values["x"], "x", path)
    if x.ndim != 3 or x.shape[2] != 3:
        raise UsageError(f"{path}: x has shape {x.shape}.", "It must be (T+1,N,3).")
    if len(x) < 4 or x.shape[1] < 1:
        raise ObjectError(f"{path} has {len(x)} pictures of {x.shape[1]} particles.", "At least four pictures of one particle are needed.")
    visible = _visible(values, x, path)
    fixed = flags_in(values.get("fixed", np.zeros(x.shape[1], dtype=bool)), "fixed", x.shape[1:2], path)
    fps = number_in(values["fps"], "fps", path)
    if not FRAME_RATES[0] <= fps <= FRAME_RATES[1]:
        raise UsageError(f"{path}: fps is {fps:g}.", f"It must lie between {FRAME_RATES[0]:g} and {FRAME_RATES[1]:g} frames per second.")
    _check_places(x, visible, fps, path)
    return x, visible, fixed, fps


def values_of(path: str | os.PathLike[str], keys: tuple[str, ...] = READ) -> tuple[dict[str, np.ndarray], list[str]]:
    """What the file holds of these keys, and a note on keys that nobody knows."""
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
    """The key in `keys` that `name` was perhaps meant to be."""
    known = {key.lower(): key for key in keys} | {other: key for other, key in OTHER_NAMES.items() if key in keys}
    close = difflib.get_close_matches(name.lower(), known, n=1)
    return known[close[0]] if close else None


def _visible(values: dict[str, np.ndarray], x: np.ndarray, path: str | os.PathLike[str]) -> np.ndarray:
    """(T+1, N) which points of x (T+1, N, 3) count, all if the file does not say."""
    visible = flags_in(values.get("visible", np.ones(x.shape[:2], dtype=bool)), "visible", x.shape[:2], path)
    if not visible[0].all():
        hidden = np.flatnonzero(~visible[0])
        raise ObjectError(
            f"{path}: {len(hidden)} of {x.shape[1]} points are not visible in picture 0, the first of them point {hidden[0]}.",
            "The body is built from picture 0: begin with a picture that shows every point, or remove those points.",
        )
    if not visible[1:].any():
        raise ObjectError(f"{path}: no point is visible after picture 0.", "Mend visible, or leave it out: then every point counts.")
    lost = np.argwhere(visible & ~np.isfinite(x).all(axis=2))
    if len(lost):
        t, n = lost[0]
        raise ObjectError(
            f"{path}: the position of particle {n} in picture {t} is not finite.",
            "Mend the file or remove that particle; after picture 0, `visible` may say that it is not seen.",
        )
    return visible


def _check_places(x: np.ndarray, visible: np.ndarray, fps: float, path: str | os.PathLike[str]) -> None:
    """Refuse visible positions x (T+1, N, 3) [m] beyond `FARTHEST`, and a body most of whose points move faster than `FASTEST`."""
    far = float(np.abs(x[visible]).max())
    if far > FARTHEST:
        raise UsageError(f"{path}: a position lies {far:.3g} m from the origin.", "Check the unit: metres.")
    step = np.where(visible[1:] & visible[:-1], np.linalg.norm(np.diff(x, axis=0), axis=2), np.nan)
    way = np.nan_to_num([np.nanmedian(row) if np.isfinite(row).any() else 0.0 for row in step])
    worst = int(way.argmax())
    if way[worst] * fps > FASTEST:
        raise ObjectError(
            f"{path}: from picture {worst} to picture {worst + 1} the body jumps {way[worst]:.3g} m, which is {way[worst] * fps:.3g} m/s.",
            "Check the unit of x (metres), fps, and that the points keep their order; cut the file where the body jumps.",
        )


def _few(count: int) -> Iterator[str]:
    """A note on a body of too few points."""
    if 1 < count < FEW:
        yield f"The body is {count} points: each is simulated as a lump of its own, and only their mean motion tells of a force."


def _errors(
    values: dict[str, np.ndarray], count: int, extent: float, path: str | os.PathLike[str]
) -> tuple[float | None, np.ndarray | None]:
    """What the file says of the errors of x: one standard deviation [m], or covariances (N, 3, 3) [m²]; None where it does not say.

    `extent` [m] is how far x reaches in space and time.
    """
    if "sigma" in values and "covariance" in values:
        raise UsageError(f"{path} has both sigma and covariance.", "Leave one of them out.")
    if "sigma" in values:
        sigma = number_in(values["sigma"], "sigma", path)
        if not FINEST <= sigma <= extent:
            hint = f"It must lie between {FINEST:g} m and what x reaches, {extent:.3g} m; without it, it is estimated."
            raise UsageError(f"{path}: sigma is {sigma:g}.", hint)
        return sigma, None
    if "covariance" not in values:
        return None, None
    covariance = numbers_in(values["covariance"], "covariance", path)
    if covariance.shape not in ((3, 3), (count, 3, 3)):
        raise UsageError(f"{path}: covariance has shape {covariance.shape}.", f"It must be (3,3) or ({count},3,3), in m².")
    if not np.isfinite(covariance).all() or np.abs(covariance).max() > extent**2 or not _is_covariance(covariance):
        raise UsageError(
            f"{path}: covariance is none of errors within what x reaches, {extent:.3g} m.",
            "Each matrix must be finite, symmetric and without negative eigenvalues, in m².",
        )
    return None, np.broadcast_to(covariance, (count, 3, 3)).copy()


def _is_covariance(matrices: np.ndarray) -> bool:
    """Whether (..., 3, 3) are symmetric without negative eigenvalues, but for rounding."""
    size = np.abs(matrices).max(axis=(-1, -2), keepdims=True)
    symmetric = np.abs(matrices - np.swapaxes(matrices, -1, -2)) <= 1e-6 * size
    return bool(symmetric.all() and (np.linalg.eigvalsh(matrices) >= -1e-6 * size[..., 0]).all())


def gravity_of(values: dict[str, np.ndarray], path: str | os.PathLike[str]) -> tuple[float, float, float]:
    gravity = numbers_in(values.get("gravity", np.zeros(3)), "gravity", path)
    if gravity.shape not in ((), (3,)) or not np.isfinite(gravity).all() or (gravity.shape == () and gravity != 0.0):
        raise UsageError(f"{path}: gravity is {gravity.tolist()}.", "It must be three finite numbers in m/s².")
    x, y, z = np.broadcast_to(gravity, (3,)).tolist()
    return x, y, z


def _moving(x: np.ndarray, spacing: float) -> Iterator[str]:
    """A note where held particles x (T+1, M, 3), NaN where not seen, move further than those do that are only near a clamp."""
    way = float(np.nan_to_num(np.linalg.norm(x - x[0], axis=2)).max()) if x.size else 0.0
    if way > HELD_WAY * spacing:
        yield f"Particles that `fixed` marks as held move by up to {1e3 * way:.2g} mm; they are simulated standing still."


def flags_in(value: np.ndarray, key: str, shape: tuple[int, ...], path: str | os.PathLike[str]) -> np.ndarray:
    value = np.asarray(value)
    if value.shape != shape or value.dtype.kind not in "biu":
        raise UsageError(f"{path}: {key} is {value.dtype} of shape {value.shape}.", f"It must be {shape} of true and false.")
    return value.astype(bool)


def numbers_in(value: np.ndarray, key: str, path: str | os.PathLike[str]) -> np.ndarray:
    if np.asarray(value).dtype.kind not in "fiu":
        raise UsageError(f"{path}: {key} holds {np.asarray(value).dtype}, not numbers.", "Write plain numbers in SI units.")
    return np.asarray(value, dtype=np.float64)


def number_in(value: np.ndarray, key: str, path: str | os.PathLike[str]) -> float:
    numbers = numbers_in(value, key, path)
    if numbers.size != 1:
        raise UsageError(f"{path}: {key} is not one number but has shape {numbers.shape}.", "Give one number for the whole body.")
    if not np.isfinite(numbers).all():
        raise UsageError(f"{path}: {key} is {numbers.item()}, which is not finite.", "Give a finite number in SI units.")
    return float(numbers.item())


def particle_spacing(x: np.ndarray) -> float:
    """Median distance of nearest neighbours [m] among particles x (N, 3).

    Raises:
        ObjectError: when most particles coincide.
    """
    from scipy.spatial import cKDTree

    if len(x) == 1:
        return 0.01
    distance = cKDTree(x).query(x, k=2)[0][:, 1]
    spacing = float(np.median(distance))
    if spacing <= 1e-9 * max(1.0, float(np.abs(x).max())):
        raise ObjectError("Most particles coincide with another.", "Give every particle a place of its own in the first picture.")
    return spacing


def _material(
    values: dict[str, np.ndarray], preset: Material | None, properties: dict[str, Any], path: str | os.PathLike[str]
) -> tuple[Material, list[str]]:
    """The material that options and file state, foam-like numbers for what both leave out, and notes on what is assumed or not used.

    Simulators that write such files (Genesis, taichi_elements) yield at a norm |dev tau| = Y of the deviatoric stress; the uniaxial
    yield stress that `Material` and the literature speak of is sqrt(3/2) times that.
    """
    stated: dict[str, Any] = {name: number_in(values[key], key, path) for name, key in NUMBERS.items() if key in values}
    yield_stress = float(np.sqrt(1.5)) * number_in(values.get("yield_stress", np.zeros(())), "yield_stress", path)
    if yield_stress != 0.0:
        stated["yield_stress"] = yield_stress
    if preset is not None:
        unused = [NUMBERS.get(name, name) for name in stated if properties.get(name) is None]
        notes = [f"The material {preset.name} replaces what the file says: {', '.join(unused)}."] if unused else []
        return adjusted(preset, **properties), notes
    given = {name for name, value in properties.items() if value is not None}
    named = _named(values, path)
    if named is not None:
        return adjusted(adjusted(named, **stated), **properties), []
    if "youngs_modulus" not in given and "youngs_modulus" not in stated:
        raise MaterialError(
            f"{path} lacks E, Young's modulus in Pa, and no option gives it.",
            "The force on a body that bends is in proportion to it: add E, or give --youngs-modulus or --material.",
        )
    law = "von_mises" if yield_stress > 0.0 else "corotated"
    guesses = {"density": DENSITY, "poisson_ratio": POISSON_RATIO}
    assumed = {name: value for name, value in guesses.items() if name not in given and name not in stated}
    sources = {"from the trajectory file": [name for name in stated if name not in given], "assumed": list(assumed)}
    source = "; ".join(f"{where}: {', '.join(names)}" for where, names in sources.items() if names)
    notes = []
    if assumed:
        missing = [f"{NUMBERS[name]} ({value:g}{' kg/m³' if name == 'density' else ''})" for name, value in assumed.items()]
        proportion = " Forces are in proportion to the density." if "density" in assumed else ""
        notes.append(f"The file lacks {', '.join(missing)}, and no option gives it: assumed.{proportion}")
    modulus = stated.get("youngs_modulus") or properties["youngs_modulus"]
    whole = Material("trajectories", law, **{**guesses, "youngs_modulus": modulus, **stated}, source=source)
    return adjusted(whole, **properties), notes


def _named(values: dict[str, np.ndarray], path: str | os.PathLike[str]) -> Material | None:
    """The library's material that the file names; None without a name, or with one of `BEHAVIOURS`.

    Raises:
        MaterialError: a name that the library does not have.
    """
    if "material" not in values:
        return None
    name = values["material"]
    if name.dtype.kind != "U" or name.size != 1:
        raise UsageError(f"{path}: material is {name.dtype} of shape {name.shape}.", "Write the name of one material, or leave it out.")
    if str(name.item()).strip().lower() in BEHAVIOURS:
        return None
    try:
        return find(str(name.item()))
    except MaterialError as error:
        hint = f"{error.hint} Or write {' or '.join(BEHAVIOURS)}, with E and rho."
        raise MaterialError(f"{path}: {error.message}", hint) from error
