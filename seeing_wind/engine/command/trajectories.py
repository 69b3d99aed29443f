"""3D trajectories from outside (another simulator, motion capture) as particles and targets."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ObjectError, UsageError
from ..materials import adjusted
from ..records import Attachment, Material, Particles, PointTargets
from ..take import DAMAGED

FIXED_DEPTH = 0.5
"""Grid cells (`RecoverSettings.clamp_depth`) at first. A file's `fixed` is what hardly moved: that reaches some way above what is held."""
DENSITY, YOUNGS_MODULUS, POISSON_RATIO = 300.0, 1e5, 0.3
"""Of a body whose file does not say [kg/m³], [Pa]: those of foam."""
NUMBERS = {"density": "rho", "youngs_modulus": "E", "poisson_ratio": "nu"}
"""Properties of `Material` -> keys of the file."""
HELD_WAY = 0.2
"""Particle spacings that held particles may move without a word."""

READ = ("x", "fps", "rho", "E", "nu", "yield_stress", "fixed", "gravity", "visible", "sigma", "covariance")
"""Keys of a file."""
TRUTH = ("v", "acc", "material", "name", "field")
"""What simulators write besides, for a comparison: velocities and forces are to be found, and the law is that of `yield_stress`."""
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

    Optional are `rho` kg/m³, `E` Pa, `nu`, `yield_stress` Pa, `fixed` (N,) bool, `gravity` (3,) m/s², `visible` (T+1,N) bool, all of it
    true in picture 0, and the errors of x: `sigma` m, the standard deviation of a coordinate, or `covariance` (3,3) or (N,3,3) m². Where a
    point is not visible, its x is not used.
    Velocities and forces in the file, if any, are not read: they are what is to be found.

    Args:
        material: in place of all that the file says of the material.
        gravity: [m/s²], in place of the file's.
        properties: as of `materials.adjusted`, in place of the file's and the material's; None leaves those.

    Raises:
        UsageError: no such file, no NPZ, a key missing, of the wrong type or shape, or a number that means nothing.
        ObjectError: too few pictures or particles, points that picture 0 does not show, visible positions that are not finite.
        MaterialError: as `materials.adjusted`.
    """
    values, notes = _values(path)
    for key in ("x", "fps"):
        if key not in values:
            raise UsageError(f"{path} lacks {key}.", "It needs x (T+1,N,3) in metres and fps.")
    x = _numbers(values["x"], "x", path)
    if x.ndim != 3 or x.shape[2] != 3:
        raise UsageError(f"{path}: x has shape {x.shape}.", "It must be (T+1,N,3).")
    if len(x) < 4 or x.shape[1] < 1:
        raise ObjectError(f"{path} has {len(x)} pictures of {x.shape[1]} particles.", "At least four pictures of one particle are needed.")
    visible = _visible(values, x, path)
    fixed = _flags(values.get("fixed", np.zeros(x.shape[1], dtype=bool)), "fixed", x.shape[1:2], path)
    fps = _number(values["fps"], "fps", path)
    if fps <= 0.0:
        raise UsageError(f"{path}: fps is {fps:g}.", "It must be above zero.")
    sigma, covariance = _errors(values, x.shape[1], path)
    spacing = particle_spacing(x[0])
    particles = Particles(x=x[0], volume=np.full(x.shape[1], spacing**3), pinned=fixed, spacing=spacing)
    everyone = Attachment(index=np.arange(x.shape[1], dtype=np.int32)[:, None], weight=np.ones((x.shape[1], 1)))
    targets = PointTargets(np.where(visible[..., None], x, np.nan), visible, everyone, sigma, covariance)
    found, assumed = _material(values, material, properties, path)
    down = _gravity(values, path) if gravity is None else gravity
    if gravity is None and "gravity" not in values:
        assumed.append("The file has no gravity, and no option gives it: it counts as part of the field.")
    notes += assumed + list(_moving(targets.x[:, fixed], spacing))
    return Trajectories(particles, found, targets, fps, down, notes=tuple(notes))


def _values(path: str | os.PathLike[str]) -> tuple[dict[str, np.ndarray], list[str]]:
    """What the file holds of the keys in READ, and a note on keys that nobody knows."""
    if not Path(path).is_file():
        raise UsageError(f"There is no file {path}.", "Give an NPZ with x (T+1,N,3) in metres and fps.")
    values: dict[str, np.ndarray] = {}
    key: str | None = None
    try:
        with np.load(path, allow_pickle=False) as data:
            unknown = [name for name in data.files if name not in READ + TRUTH]
            for key in [name for name in data.files if name in READ]:
                values[key] = data[key]
    except DAMAGED as error:
        if key is None:
            raise UsageError(f"{path} is no NPZ without pickle: {error}.", "Write it with numpy.savez.") from error
        hint = f"Its dtype must be a plain number type, not object: numpy.savez(..., {key}=numpy.array({key}, dtype=float)), or bool."
        raise UsageError(f"{path}: {key} cannot be read: {error}.", hint) from error
    if not unknown:
        return values, []
    meant = [f"{near} by {name}" for name in unknown if (near := _near(name)) is not None]
    asked = f" Did you mean {', '.join(meant)}?" if meant else ""
    names = f"{', '.join(unknown)} {'is' if len(unknown) == 1 else 'are'}"
    return values, [f"The file's {names} not read.{asked} Known keys: {', '.join(READ)}."]


def _near(name: str) -> str | None:
    """The key in READ that `name` was perhaps meant to be."""
    keys = {key.lower(): key for key in READ} | OTHER_NAMES
    close = difflib.get_close_matches(name.lower(), keys, n=1)
    return keys[close[0]] if close else None


def _visible(values: dict[str, np.ndarray], x: np.ndarray, path: str | os.PathLike[str]) -> np.ndarray:
    """(T+1, N) which points of x (T+1, N, 3) count, all if the file does not say."""
    visible = _flags(values.get("visible", np.ones(x.shape[:2], dtype=bool)), "visible", x.shape[:2], path)
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


def _errors(values: dict[str, np.ndarray], count: int, path: str | os.PathLike[str]) -> tuple[float | None, np.ndarray | None]:
    """What the file says of the errors of x: one standard deviation [m], or covariances (N, 3, 3) [m²]; None where it does not say."""
    if "sigma" in values and "covariance" in values:
        raise UsageError(f"{path} has both sigma and covariance.", "Leave one of them out.")
    if "sigma" in values:
        sigma = _number(values["sigma"], "sigma", path)
        if sigma <= 0.0:
            raise UsageError(f"{path}: sigma is {sigma:g}.", "It must be above zero, in metres; without it, it is estimated.")
        return sigma, None
    if "covariance" not in values:
        return None, None
    covariance = _numbers(values["covariance"], "covariance", path)
    if covariance.shape not in ((3, 3), (count, 3, 3)):
        raise UsageError(f"{path}: covariance has shape {covariance.shape}.", f"It must be (3,3) or ({count},3,3), in m².")
    return None, np.broadcast_to(covariance, (count, 3, 3)).copy()


def _gravity(values: dict[str, np.ndarray], path: str | os.PathLike[str]) -> tuple[float, float, float]:
    gravity = _numbers(values.get("gravity", np.zeros(3)), "gravity", path)
    if gravity.shape not in ((), (3,)) or not np.isfinite(gravity).all() or (gravity.shape == () and gravity != 0.0):
        raise UsageError(f"{path}: gravity is {gravity.tolist()}.", "It must be three finite numbers in m/s².")
    x, y, z = np.broadcast_to(gravity, (3,)).tolist()
    return x, y, z


def _moving(x: np.ndarray, spacing: float) -> Iterator[str]:
    """A note where held particles x (T+1, M, 3), NaN where not seen, move further than those do that are only near a clamp."""
    way = float(np.nan_to_num(np.linalg.norm(x - x[0], axis=2)).max()) if x.size else 0.0
    if way > HELD_WAY * spacing:
        yield f"Particles that `fixed` marks as held move by up to {1e3 * way:.2g} mm; they are simulated standing still."


def _flags(value: np.ndarray, key: str, shape: tuple[int, ...], path: str | os.PathLike[str]) -> np.ndarray:
    value = np.asarray(value)
    if value.shape != shape or value.dtype.kind not in "biu":
        raise UsageError(f"{path}: {key} is {value.dtype} of shape {value.shape}.", f"It must be {shape} of true and false.")
    return value.astype(bool)


def _numbers(value: np.ndarray, key: str, path: str | os.PathLike[str]) -> np.ndarray:
    if np.asarray(value).dtype.kind not in "fiu":
        raise UsageError(f"{path}: {key} holds {np.asarray(value).dtype}, not numbers.", "Write plain numbers in SI units.")
    return np.asarray(value, dtype=np.float64)


def _number(value: np.ndarray, key: str, path: str | os.PathLike[str]) -> float:
    numbers = _numbers(value, key, path)
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
    stated = {name: _number(values[key], key, path) for name, key in NUMBERS.items() if key in values}
    yield_stress = float(np.sqrt(1.5)) * _number(values.get("yield_stress", np.zeros(())), "yield_stress", path)
    if yield_stress != 0.0:
        stated["yield_stress"] = yield_stress
    if preset is not None:
        unused = [NUMBERS.get(name, name) for name in stated if properties.get(name) is None]
        notes = [f"The material {preset.name} replaces what the file says: {', '.join(unused)}."] if unused else []
        return adjusted(preset, **properties), notes
    law = "von_mises" if yield_stress > 0.0 else "corotated"
    guesses = {"density": DENSITY, "youngs_modulus": YOUNGS_MODULUS, "poisson_ratio": POISSON_RATIO}
    given = {name for name, value in properties.items() if value is not None}
    assumed = {name: value for name, value in guesses.items() if name not in given and name not in stated}
    sources = {"from the trajectory file": [name for name in stated if name not in given], "assumed": list(assumed)}
    source = "; ".join(f"{where}: {', '.join(names)}" for where, names in sources.items() if names)
    notes = []
    if assumed:
        units = {"density": " kg/m³", "youngs_modulus": " Pa"}
        missing = [f"{NUMBERS[name]} ({value:g}{units.get(name, '')})" for name, value in assumed.items()]
        proportion = " Forces are in proportion to the density." if "density" in assumed else ""
        notes.append(f"The file lacks {', '.join(missing)}, and no option gives it: assumed.{proportion}")
    return adjusted(Material("trajectories", law, **{**guesses, **stated}, source=source), **properties), notes
