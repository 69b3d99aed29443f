"""3D trajectories from outside (another simulator, motion capture) as particles and targets."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .errors import ObjectError, UsageError
from .materials import adjusted
from .records import Attachment, Material, Particles, PointTargets
from .take import DAMAGED

FIXED_DEPTH = 0.5
"""Grid cells (`RecoverSettings.clamp_depth`) at first. A file's `fixed` is what hardly moved: that reaches some way above what is held."""
DENSITY, YOUNGS_MODULUS, POISSON_RATIO = 300.0, 1e5, 0.3
"""Of a body whose file does not say [kg/m³], [Pa]: those of foam."""
HELD_WAY = 0.2
"""Particle spacings that held particles may move without a word."""


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
    """What was assumed because the file does not say it, and what contradicts itself."""


def read_trajectories(path: str | os.PathLike[str]) -> Trajectories:
    """Read an NPZ with `x` (T+1,N,3) m and `fps`; optional `rho` kg/m³, `E` Pa, `nu`, `yield_stress` Pa, `fixed` (N,), `gravity` (3,) m/s².

    Velocities and forces in the file, if any, are not read: they are what is to be found.

    Raises:
        UsageError: no such file, no NPZ, a key missing or of the wrong shape.
        ObjectError: too few pictures or particles, positions that are not finite.
    """
    if not Path(path).is_file():
        raise UsageError(f"There is no file {path}.", "Give an NPZ with x (T+1,N,3) in metres and fps.")
    try:
        with np.load(path, allow_pickle=False) as data:
            values = {key: data[key] for key in data.files if key not in ("acc", "v")}
    except DAMAGED as error:
        raise UsageError(f"{path} is no NPZ without pickle: {error}.", "Write it with numpy.savez.") from error
    for key in ("x", "fps"):
        if key not in values:
            raise UsageError(f"{path} lacks {key}.", "It needs x (T+1,N,3) in metres and fps.")
    x = _numbers(values["x"], "x", path)
    if x.ndim != 3 or x.shape[2] != 3:
        raise UsageError(f"{path}: x has shape {x.shape}.", "It must be (T+1,N,3).")
    if len(x) < 4 or x.shape[1] < 1:
        raise ObjectError(f"{path} has {len(x)} pictures of {x.shape[1]} particles.", "At least four pictures of one particle are needed.")
    if not np.isfinite(x).all():
        t, n, _ = np.argwhere(~np.isfinite(x))[0]
        raise ObjectError(f"{path}: the position of particle {n} in picture {t} is not finite.", "Remove that particle or mend the file.")
    fixed = np.asarray(values.get("fixed", np.zeros(x.shape[1], dtype=bool)))
    if fixed.shape != (x.shape[1],) or fixed.dtype.kind not in "biu":
        raise UsageError(f"{path}: fixed is {fixed.dtype} of shape {fixed.shape}.", f"It must be ({x.shape[1]},) of true and false.")
    fixed = fixed.astype(bool)
    gravity = _numbers(values.get("gravity", np.zeros(3)), "gravity", path)
    if gravity.shape not in ((), (3,)) or not np.isfinite(gravity).all() or (gravity.shape == () and gravity != 0.0):
        raise UsageError(f"{path}: gravity is {gravity.tolist()}.", "It must be three finite numbers in m/s².")
    fps = _number(values["fps"], "fps", path)
    if fps <= 0.0:
        raise UsageError(f"{path}: fps is {fps:g}.", "It must be above zero.")
    spacing = particle_spacing(x[0])
    particles = Particles(x=x[0], volume=np.full(x.shape[1], spacing**3), pinned=fixed, spacing=spacing)
    everyone = Attachment(index=np.arange(x.shape[1], dtype=np.int32)[:, None], weight=np.ones((x.shape[1], 1)))
    targets = PointTargets(x=x, visible=np.ones(x.shape[:2], dtype=bool), attachment=everyone)
    down = tuple(float(g) for g in np.broadcast_to(gravity, (3,)))
    notes = tuple(_assumed(values)) + tuple(_moving(x[:, fixed], spacing))
    return Trajectories(particles, _material(values, path), targets, fps, down, notes=notes)  # type: ignore[arg-type]


def _assumed(values: dict[str, np.ndarray]) -> Iterator[str]:
    defaults = {"rho": f"{DENSITY:g} kg/m³", "E": f"{YOUNGS_MODULUS:g} Pa", "nu": f"{POISSON_RATIO:g}"}
    missing = [f"{key} ({value})" for key, value in defaults.items() if key not in values]
    if missing:
        yield f"The file lacks {', '.join(missing)}: assumed where no option says otherwise. Forces are in proportion to the density."
    if "gravity" not in values:
        yield "The file has no gravity: unless --gravity gives it, it counts as part of the field."


def _moving(x: np.ndarray, spacing: float) -> Iterator[str]:
    """A note where held particles x (T+1, M, 3) move further than those do that are only near a clamp."""
    way = float(np.linalg.norm(x - x[0], axis=2).max()) if x.size else 0.0
    if way > HELD_WAY * spacing:
        yield f"Particles that `fixed` marks as held move by up to {1e3 * way:.2g} mm; they are simulated standing still."


def _numbers(value: np.ndarray, key: str, path: str | os.PathLike[str]) -> np.ndarray:
    if np.asarray(value).dtype.kind not in "fiu":
        raise UsageError(f"{path}: {key} holds {np.asarray(value).dtype}, not numbers.", "Write plain numbers in SI units.")
    return np.asarray(value, dtype=np.float64)


def _number(value: np.ndarray, key: str, path: str | os.PathLike[str]) -> float:
    numbers = _numbers(value, key, path)
    if numbers.size != 1 or not np.isfinite(numbers).all():
        raise UsageError(f"{path}: {key} is not one finite number but has shape {numbers.shape}.", "Give one number for the whole body.")
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


def _material(values: dict[str, np.ndarray], path: str | os.PathLike[str]) -> Material:
    """The material that the file states, foam-like numbers for what it leaves out.

    Simulators that write such files (Genesis, taichi_elements) yield at a norm |dev tau| = Y of the deviatoric stress; the uniaxial
    yield stress that `Material` and the literature speak of is sqrt(3/2) times that.
    """
    yield_stress = float(np.sqrt(1.5)) * _number(values.get("yield_stress", np.zeros(())), "yield_stress", path)
    law = "von_mises" if yield_stress > 0.0 else "corotated"
    base = Material("trajectories", law, DENSITY, YOUNGS_MODULUS, POISSON_RATIO, source="the trajectory file")
    numbers = {"density": "rho", "youngs_modulus": "E", "poisson_ratio": "nu"}
    given: dict[str, Any] = {name: _number(values[key], key, path) for name, key in numbers.items() if key in values}
    return adjusted(base, **given, yield_stress=yield_stress if yield_stress != 0.0 else None)
