"""3D trajectories from outside (another simulator, motion capture) as particles and targets."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...conventions import DISTRUST, in_units
from ...errors import UsageError
from ...materials import Material
from ...records import Attachment, Particles, PointTargets
from ...recovery.targets.clamp_motion import clamp_motion
from .file import gravity_of, motion_of, number_in, numbers_in, size_note, values_of
from .material import material_of
from .spacing import nearest, particle_spacing

FIXED_DEPTH = 0.5
"""Default of `RecoverSettings.clamp_depth` [grid cells]: `fixed` in a file is usually what hardly moved, which extends beyond the clamp."""
HELD_WAY = 0.2
"""Displacement of held particles, in particle spacings, from which there is a note."""
HELD_ERRORS = 7.0
"""Distance between two observed positions of a point, in deviations, that errors may cause in one of many points and frames."""
HELD_WILD = 3.0
"""Displacement, in particle spacings, from which the particles cannot be held at all."""
FINEST = 1e-9
"""Smallest standard deviation [m] of a position that is accepted."""
FEW = 8
"""A body of fewer points than this has no shape to speak of."""
LAYERS, ROUND = 1.5, 12
"""A body has a single layer if fewer layers of particles than the first number are found. They are counted among this second number of a
particle's neighbours, so that the layer may be curved."""
STRAYS = 0.1
"""Particles that leave the body are taken to be errors if they are at most this share of all; with more, the body is falling apart."""


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
    """What was assumed because neither the file nor the options give it, what was not used of the file, and contradictions in it."""


def read_trajectories(
    path: str | os.PathLike[str],
    material: Material | None = None,
    gravity: tuple[float, float, float] | None = None,
    **properties: Any,
) -> Trajectories:
    """Read an NPZ with `x` (T+1,N,3) m and `fps`.

    The file must also have `E` Pa, or `material`, a name from the library, unless an option gives it. Optional are `rho` kg/m³, `nu`,
    `yield_stress` Pa, `fixed` (N,) bool, `gravity` (3,) m/s², `visible` (T+1,N) bool, which must be true in frame 0, and the errors of x:
    `sigma` m, the standard deviation of a coordinate, or `covariance` (3,3) or (N,3,3) m². Where a point is not visible, its x is not
    used. Velocities and forces in the file, if any, are not read, as they are to be recovered.

    Args:
        material: replaces all that the file states about the material.
        gravity: [m/s²], replaces the file's.
        properties: arguments of `materials.adjust`, which replace those of the file and of the material; None replaces nothing.

    Raises:
        UsageError: the file does not exist or is not an NPZ; a key is missing or has the wrong type or shape; a number is out of bounds.
        ObjectError: too few frames or particles, points that are not visible in frame 0, visible positions that are not finite, or a
            body that jumps.
        MaterialError: as `materials.adjust`; a material that the library does not have; no stiffness.
    """
    values, notes = values_of(path)
    x, visible, fixed, fps = motion_of(values, path)
    sigma, covariance = _errors(values, x.shape[1], float(np.ptp(x[visible], axis=0).max()), path)
    spacing = particle_spacing(x[0])
    particles = Particles(x=x[0], volume=np.full(x.shape[1], spacing**3), pinned=fixed, spacing=spacing)
    everyone = Attachment(index=np.arange(x.shape[1], dtype=np.int32)[:, None], weight=np.ones((x.shape[1], 1)))
    targets = PointTargets(np.where(visible[..., None], x, np.nan), visible, everyone, sigma, covariance)
    found, assumed = material_of(values, material, properties, path)
    down, missing = gravity_of(values, gravity, path)
    told = [*size_note(x[0]), *_few(x.shape[1]), *assumed, *missing, *notes]
    told += [*_layer(particles), *_moving(particles, targets, fps), *_strays(targets.x, spacing)]
    return Trajectories(particles, found, targets, fps, down, notes=tuple(told))


def _few(count: int) -> Iterator[str]:
    """A note on a body of too few points."""
    if 1 < count < FEW:
        yield f"The body is {count} points: each is simulated as a lump of its own, and only their mean motion tells of a force."


def _layer(particles: Particles) -> Iterator[str]:
    """A note on a held body whose particles lie in one layer or in a row, so that they do not show its thickness."""
    from scipy.spatial import cKDTree

    x = particles.x
    if len(x) < FEW or not particles.pinned.any():
        return
    apart = nearest(x)
    near = x[cKDTree(x).query(x, k=min(ROUND + 1, len(x)))[1]]
    across = near - near.mean(axis=1, keepdims=True)
    variance = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", across, across) / near.shape[1])[:, 0]
    # Across n layers a distance d apart, the variance of positions is d² (n² - 1) / 12.
    if np.sqrt(12.0 * float(np.median(variance)) / apart**2 + 1.0) < LAYERS:
        yield (
            "The held body's points lie in one layer, which does not show how thick it is: it is simulated "
            f"{in_units(particles.spacing, 'm', 2)} thick, as far as they are apart. A Young's modulus that fits the motion is one of such "
            "a body, with an error that knows nothing of this: to bend alike, one half as thick has four times as much. Give several "
            "layers or, of a thin sheet, faces and thickness."
        )


def _errors(
    values: dict[str, np.ndarray], count: int, extent: float, path: str | os.PathLike[str]
) -> tuple[float | None, np.ndarray | None]:
    """The errors of x that the file states: a standard deviation [m] and covariances (N, 3, 3) [m²], at most one of which is not None.

    `extent` [m] is the size of the region that x covers over all frames. Raises UsageError for impossible errors.
    """
    if "sigma" in values and "covariance" in values:
        raise UsageError(f"{path} has both sigma and covariance.", "Leave one of them out.")
    if "sigma" in values:
        sigma = number_in(values["sigma"], "sigma", path)
        if not FINEST <= sigma <= extent:
            hint = f"It must lie between {in_units(FINEST, 'm')} and what x reaches, {in_units(extent, 'm')}; without it, it is estimated."
            raise UsageError(f"{path}: sigma is {sigma:g}.", hint)
        return sigma, None
    if "covariance" not in values:
        return None, None
    covariance = numbers_in(values["covariance"], "covariance", path)
    if covariance.shape not in ((3, 3), (count, 3, 3)):
        raise UsageError(f"{path}: covariance has shape {covariance.shape}.", f"It must be (3,3) or ({count},3,3), in m².")
    matrices = np.broadcast_to(covariance, (count, 3, 3))
    wrong = _no_covariance(matrices, extent)
    if wrong is not None:
        point, why = wrong
        which = "covariance" if covariance.ndim == 2 else f"covariance of point {point}"
        raise UsageError(
            f"{path}: the {which} is {matrices[point].tolist()} m², which {why}.",
            "Give variances and covariances of a position's errors, in m²; without them, they are estimated.",
        )
    return None, matrices.copy()


def _no_covariance(matrices: np.ndarray, extent: float) -> tuple[int, str] | None:
    """The first of the `matrices` (N, 3, 3) [m²] that is not a covariance, and why; None if all are.

    Rounding errors are allowed for; variances must not exceed `extent` [m] squared.
    """
    size = np.abs(matrices).max(axis=(1, 2))
    rounding = 1e-6 * size
    bounded = size <= extent**2  # False for NaN
    least = np.linalg.eigvalsh(np.where(bounded[:, None, None], matrices, 0.0))[:, 0]
    uneven = np.abs(matrices - np.swapaxes(matrices, 1, 2)).max(axis=(1, 2)) > rounding
    for point in np.flatnonzero(~bounded | uneven | (least < -rounding)):
        if not np.isfinite(size[point]):
            return int(point), "is not finite"
        if not bounded[point]:
            return int(point), f"is more than what x reaches, {in_units(extent, 'm')}, squared"
        return int(point), "is not symmetric" if uneven[point] else f"has the negative eigenvalue {least[point]:.3g}"
    return None


def _moving(particles: Particles, targets: PointTargets, fps: float) -> Iterator[str]:
    """A note on held particles that move further than particles next to a clamp would.

    Displacements that their errors explain do not count, nor does a motion that all share, which is taken to be the clamp's own.
    """
    if not particles.pinned.any():
        return
    clamp, spacing = clamp_motion(particles, targets, fps), particles.spacing
    x = (targets if clamp is None else clamp.in_clamp_frame(targets)).x[:, particles.pinned]
    way = float(np.nan_to_num(np.linalg.norm(x - x[0], axis=2)).max())
    beyond = way - HELD_ERRORS * _stated(targets, particles.pinned)
    if beyond > HELD_WAY * spacing:
        wild = f" {DISTRUST}: mark only what is held." if beyond > HELD_WILD * spacing else ""
        how = "; they are simulated standing still." if clamp is None else " against each other; they are simulated as rigid."
        yield f"Particles that `fixed` marks as held move by up to {in_units(way, 'm', 2)}{how}{wild}"


def _stated(targets: PointTargets, some: np.ndarray) -> float:
    """Stated standard deviation [m] of the positions of the points `some` (N,) bool; 0 if none was stated.

    It is not estimated from the points: the motion of a shaking clamp would then be mistaken for noise.
    """
    if targets.covariance is not None:
        return float(np.sqrt(np.trace(targets.covariance[some], axis1=1, axis2=2).max()))
    return targets.sigma or 0.0


def _strays(x: np.ndarray, spacing: float) -> Iterator[str]:
    """A note on single particles of x (T+1, N, 3) [m], NaN where not visible, that move away from their neighbours by more than the body's
    size."""
    from scipy.spatial import cKDTree

    count = len(x[0])
    if count < FEW:
        return
    size = float(np.linalg.norm(np.ptp(x[0], axis=0))) + spacing
    beside = cKDTree(x[0]).query(x[0], k=FEW)[1][:, 1:]
    apart = np.zeros(beside.shape)
    for seen in x:
        apart = np.fmax(apart, np.linalg.norm(seen[:, None] - seen[beside], axis=-1))
    way = apart.min(axis=1)  # from all of its neighbours
    astray = np.flatnonzero(way > size)
    if 0 < len(astray) <= STRAYS * count:
        which = ", ".join(str(each) for each in astray[:3]) + (", ..." if len(astray) > 3 else "")
        yield (
            f"{len(astray)} of {count} particles ({which}) go up to {in_units(way[astray].max(), 'm')} away from their neighbours, more "
            f"than the body's size ({in_units(size, 'm')}). {DISTRUST}: take them out of the file, or make them "
            "invisible there."
        )
