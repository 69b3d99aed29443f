"""What a simulation refuses before it starts: meaningless numbers, arrays that do not fit each other, values that are not finite.

The kernels read arrays without checking their length, so every array that gets there must have been checked here.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from ..conventions import frame_named, in_units
from ..errors import MaterialError, SimulationError, UsageError
from ..materials import Material, adjust
from ..records import Mixture, Particles
from .lattice.boundary import HELD
from .laws.constitutive import LAWS
from .model import Model
from .state import State

_FARTHEST = 2.0**30
"""Farthest cell from the lattice's origin: a 32-bit index can count to it with room to spare."""


def checked_bodies(
    particles: Particles | Sequence[Particles], material: Material | Sequence[Material], mass_scale: float | Sequence[float]
) -> tuple[list[Particles], list[Material], list[float]]:
    """The bodies, and for each its material and factor on the density, checked for `model_for`.

    Raises:
        SimulationError: no particles, or one whose position is not finite.
        MaterialError: a law that the solver does not have, or a number that is not physical.
        UsageError: not as many materials or factors as bodies; arrays of different lengths; a volume, spacing or factor not above zero.
    """
    bodies = [particles] if isinstance(particles, Particles) else list(particles)
    if not bodies or min(len(body.x) for body in bodies) == 0:
        raise SimulationError("There are no particles to simulate.", "Choose a larger object or more particles.")
    materials = [material] * len(bodies) if isinstance(material, Material) else list(material)
    scale = np.asarray(mass_scale, dtype=np.float64)
    scales = [float(one) for one in (np.repeat(scale, len(bodies)) if scale.ndim == 0 else scale)]
    for what, count in (("Materials", len(materials)), ("Mass scales", len(scales))):
        if count != len(bodies):
            raise UsageError(f"{what} are given for {count} bodies of {len(bodies)}.", "Give one for all, or one for each body.")
    for number, body in enumerate(bodies):
        _check_body(body, f" of body {number}" if len(bodies) > 1 else "")
    for one in scales:
        positive("The mass scale", one)
    for stuff in materials:
        if stuff.law not in LAWS:
            raise MaterialError(f"The solver has no law {stuff.law!r} (material {stuff.name}).", f"Choose one of {', '.join(LAWS)}.")
    return bodies, [adjust(stuff) for stuff in materials], scales


def _check_body(body: Particles, whose: str) -> None:
    x, volume, pinned = np.asarray(body.x), np.asarray(body.volume), np.asarray(body.pinned)
    if x.ndim != 2 or x.shape[1] != 3 or volume.shape not in ((), (len(x),)) or pinned.shape != (len(x),):
        raise UsageError(
            f"The particles{whose} have positions {x.shape}, volumes {volume.shape} and pins {pinned.shape}.",
            "Give (N, 3) positions, and as many volumes and pins.",
        )
    if not np.isfinite(x).all():
        particle = int(np.argwhere(~np.isfinite(x))[0, 0])
        raise SimulationError(
            f"The position of particle {particle}{whose} is not finite.", "Build the body again.", particle=particle, quantity="position"
        )
    empty = ~(np.isfinite(volume) & (volume > 0.0))
    if empty.any():
        particle = int(np.flatnonzero(empty)[0])
        size = in_units(volume.flat[particle], "m³")
        raise UsageError(f"The volume of particle {particle}{whose} is {size}.", "Give volumes above zero.")
    positive(f"The spacing of the particles{whose}", body.spacing)
    if body.mixture is not None:
        _check_mixture(body.mixture, len(x), whose)


def _check_mixture(mixture: Mixture, count: int, whose: str) -> None:
    for field in dataclasses.fields(mixture):
        values, what = np.asarray(getattr(mixture, field.name)), field.name.replace("_", " ")
        if values.shape != (count,):
            raise UsageError(f"The {count} particles{whose} have a {what} of {values.size}.", "Give one for each particle.")
        if not np.isfinite(values).all():
            raise UsageError(f"The {what} of a particle{whose} is not finite.", "Build the body again.")
    nu = mixture.poisson_ratio
    for what, wrong in (
        ("density", mixture.density <= 0.0), ("youngs modulus", mixture.youngs_modulus <= 0.0),
        ("poisson ratio", (nu <= -1.0) | (nu >= 0.5)), ("retardation", mixture.retardation < 0.0),
    ):  # fmt: skip
        if wrong.any():
            raise UsageError(f"The {what} of a particle{whose} is out of range.", "Build the body again.")


def positive(what: str, number: float) -> None:
    """UsageError unless the number is finite and above zero."""
    if not (math.isfinite(number) and number > 0.0):
        raise UsageError(f"{what} is {number:g}.", "Give a finite number above zero.")


def check_choices(fps: float, gravity: np.ndarray, speed: float, dx: float | None, max_substeps: int | None, clamp_depth: float) -> None:
    """UsageError for an argument that `model_for` cannot work with; see there."""
    positive("The number of frames per second", fps)
    if dx is not None:
        positive("The grid spacing", dx)
    if max_substeps is not None and max_substeps < 1:
        raise UsageError(f"{max_substeps} substeps a frame are allowed.", "Allow at least one.")
    if gravity.shape != (3,) or not np.isfinite(gravity).all():
        raise UsageError(f"Gravity is {gravity.tolist()}.", "Give three finite numbers in m/s².")
    if not (math.isfinite(speed) and speed >= 0.0):
        raise UsageError(f"The expected speed is {speed:g} m/s.", "Give a finite number that is not negative.")
    if not math.isfinite(clamp_depth):
        raise UsageError(f"The clamp's depth is {clamp_depth:g} cells.", "Give a finite number; 0 is the border of what is pinned.")


def check_state(count: int, offset: np.ndarray, dx: float, x: np.ndarray, v: np.ndarray, C: np.ndarray, F: np.ndarray) -> None:
    """Check the state in which a simulation starts: x, v (..., N, 3), C, F (..., N, 3, 3) of `count` particles; lattice as in `Model`.

    Raises:
        UsageError: a shape that does not fit.
        SimulationError: a value that is not finite, a particle turned inside out, or one beyond the grid's reach; it names the particle.
    """
    for name, array, shape in (("x", x, (count, 3)), ("v", v, (count, 3)), ("C", C, (count, 3, 3)), ("F", F, (count, 3, 3))):
        if array.shape[-len(shape) :] != shape or array.ndim - len(shape) != x.ndim - 2:
            raise UsageError(f"The state's {name} has shape {array.shape}.", f"The model has {count} particles: give {shape}.")
    for name, array in (("position", x), ("velocity", v), ("affine velocity", C), ("deformation", F)):
        if not _finite(array):
            axes = tuple(range(x.ndim - 1, array.ndim))
            _stop_at_first((~np.isfinite(array)).any(axis=axes), f"The {name} of particle {{}} at the start is not finite.", name)
    _stop_at_first(_determinant(F) <= 0.0, "Particle {} is turned inside out at the start.", "det F")
    far = (np.abs(x - offset) > _FARTHEST * dx).any(axis=-1)
    _stop_at_first(far, "Particle {} starts too far from the place that the grid was laid for.", "position")


def checked_state(model: Model, state: State) -> State:
    """The state in float64, with HELD particles at rest. Raises as `check_state`."""
    x, v, C, F = (np.ascontiguousarray(array, dtype=np.float64) for array in (state.x, state.v, state.C, state.F))
    check_state(model.particles, model.offset, model.dx, x, v, C, F)
    held = model.role == HELD
    if held.any():
        v, C = v.copy(), C.copy()
        v[held], C[held] = 0.0, 0.0
    return State(x, v, C, F)


def check_force(count: int, acceleration: np.ndarray, gradient: np.ndarray | None, first_frame: int) -> None:
    """Check the force of T frames on `count` particles: acceleration (T, N, 3), gradient (T, N, 3, 3) or None.

    Raises:
        UsageError: a shape that does not fit.
        SimulationError: a value that is not finite; it names frame and particle.
    """
    for name, array, shape in (("acceleration", acceleration, (count, 3)), ("gradient", gradient, (count, 3, 3))):
        if array is None:
            continue
        if array.ndim != len(shape) + 1 or array.shape[1:] != shape or len(array) != len(acceleration):
            wanted = ", ".join(str(size) for size in ("T", *shape))
            raise UsageError(f"The {name} has shape {array.shape}.", f"It must be ({wanted}) for T frames, as many in both.")
        if not _finite(array):
            t, particle = (int(i) for i in np.argwhere(~np.isfinite(array))[0, :2])
            raise SimulationError(
                f"The {name} of particle {particle} in {frame_named(first_frame + t)} is not finite.", "Check the force field.",
                frame=first_frame + t, particle=particle, quantity=name,
            )  # fmt: skip


def check_numbers(mass: np.ndarray, mu: np.ndarray, lam: np.ndarray, yield_stress: np.ndarray, viscosity: np.ndarray) -> None:
    """MaterialError for particles (N,) without mass or stiffness (shear modulus mu and bulk modulus lam + 2/3 mu must be above zero), with
    a negative yield stress or viscosity, or with a number that is not finite."""
    finite = np.isfinite(mass) & np.isfinite(mu) & np.isfinite(lam) & np.isfinite(yield_stress) & np.isfinite(viscosity)
    for bad, what, hint in (
        (~finite, "a material number that is not finite", "Poisson's ratio must stay below 0.5, the others finite."),
        (mass <= 0.0, "no mass", "Keep the density above zero."),
        ((mu <= 0.0) | (lam + 2.0 / 3.0 * mu <= 0.0), "no stiffness", "Keep Young's modulus above zero, Poisson's ratio in -1..0.5."),
        ((yield_stress < 0.0) | (viscosity < 0.0), "a negative yield stress or viscosity", "Keep both at zero or above."),
    ):
        if bad.any():
            raise MaterialError(f"Particle {int(np.flatnonzero(bad)[0])} has {what}.", hint)


def _stop_at_first(bad: np.ndarray, message: str, quantity: str) -> None:
    """SimulationError for the first particle marked in bad (..., N)."""
    if bad.any():
        particle = int(np.argwhere(bad)[0, -1])
        raise SimulationError(message.format(particle), "Check the body and its start.", particle=particle, quantity=quantity)


def _finite(array: np.ndarray) -> bool:
    """Whether all numbers are finite. The sum is quick to compute, but it may overflow for finite numbers."""
    return bool(np.isfinite(array.sum())) or bool(np.isfinite(array).all())


def _determinant(F: np.ndarray) -> np.ndarray:
    """Determinants (...,) of F (..., 3, 3); LAPACK takes many times as long for so many small matrices."""
    (a, b, c), (d, e, f), (g, h, i) = ([F[..., row, column] for column in range(3)] for row in range(3))
    return a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
