"""The model of a simulation: grid, substeps and clamp, chosen from its bodies and their materials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..conventions import GRAVITY, in_figures, in_units, lame
from ..errors import SimulationError
from ..materials import LIMITS, LOSS_FREQUENCY, Material
from ..records import Mixture, Particles
from .checks import check_choices, checked_bodies
from .courant import Part, carried_modulus, enough_substeps, most_substeps, wave_substeps
from .damping import longest_retardation, substeps_for, with_retardation
from .kernels.packed import MOST_NODES_ACROSS
from .lattice.boundary import border_axes, clamped_nodes, lattice_offset, particle_roles
from .lattice.colliders import Collider, ColliderGrid, collider_grid, collider_notes, moves
from .lattice.kinematics import checked_pin_path
from .laws.constitutive import LAWS
from .laws.plasticity import PLASTIC_LAWS
from .model import MOST_NODES, Model


def model_for(
    particles: Particles | Sequence[Particles],
    material: Material | Sequence[Material],
    fps: float,
    *,
    gravity: Sequence[float] | np.ndarray = GRAVITY,
    mass_scale: float | Sequence[float] = 1.0,
    speed: float = LIMITS.default_speed,
    dx: float | None = None,
    max_substeps: int | None = None,
    least_substeps: int = LIMITS.min_substeps,
    colliders: Sequence[Collider] = (),
    pin_path: np.ndarray | None = None,
    clamp_depth: float = 0.0,
) -> tuple[Model, list[str]]:
    """Choose grid and substeps for one body, or for several that share a grid and push each other.

    Args:
        particles: one body, or several; their particles follow each other in the model in this order.
        material: one for all, or one per body.
        gravity: (3,) [m/s²].
        mass_scale: factor on the density, one for all or one per body.
        speed: fastest motion expected [m/s], apart from that of `pin_path`; above about one cell per substep it needs more substeps.
        dx: grid spacing [m]; None takes `LIMITS.cell_spacings` spacings of the finest body.
        max_substeps: per frame. A material that needs more is softened until it needs no more; None is `LIMITS.max_substeps`, or
            `LIMITS.max_substeps_held` if a body is pinned that keeps at least `LIMITS.worth` of its stiffness with it. Damping is limited
            to what the substeps allow, too.
        least_substeps: per frame, whatever the material.
        colliders: planes, rooms and closed meshes, still or moving, see `colliders`.
        pin_path: (T+1, M, 3) positions [m] of the M pinned particles at every frame; None leaves them where they are.
        clamp_depth: how far below the border of the pinned material the clamp begins [cells]; 0.5 for pins that were only observed to
            hardly move.

    Returns:
        The model, and notes that the user should read.

    Raises:
        MaterialError: for a law that the solver does not have, or a number that is not physical.
        SimulationError: for no particles, one that is not finite, bodies too far apart for one grid, or a speed that needs more than
            `max_substeps`.
        UsageError: for a path of the pins that does not fit the particles, and any other argument out of its range.
    """
    bodies, materials, scales = checked_bodies(particles, material, mass_scale)
    gravity = np.asarray(gravity, dtype=np.float64)
    check_choices(fps, gravity, speed, dx, max_substeps, clamp_depth)
    spacing = min(body.spacing for body in bodies)
    dx = LIMITS.cell_spacings * spacing if dx is None else dx
    frame_dt = 1.0 / fps
    parts = list(zip(bodies, materials, scales))
    max_substeps = most_substeps(parts, dx, frame_dt) if max_substeps is None else max_substeps
    x = np.concatenate([np.asarray(body.x, dtype=np.float64) for body in bodies])
    pinned = np.concatenate([np.asarray(body.pinned, dtype=bool) for body in bodies])
    _check_reach(x, dx)
    path = None if pin_path is None else checked_pin_path(pin_path, x, pinned, dx)
    notes: list[str] = []
    (mass, volume, mu, lam, yield_stress, viscosity, law), needed = _columns(parts, dx, frame_dt, max_substeps, notes)
    fastest = _checked_speed(speed, x, path, dx, frame_dt, max_substeps)
    substeps = max(least_substeps, enough_substeps(fastest, dx, frame_dt, needed))
    # The lattice can follow one border only: with colliders it stays upright, for their sake.
    axes = None if colliders else border_axes(x, pinned, spacing)
    if axes is not None:
        x, path = x @ axes, None if path is None else path @ axes
    offset = lattice_offset(x, pinned, spacing, dx, colliders, depth=clamp_depth)
    clamp_lo, clamp = clamped_nodes(x, mass, pinned, offset, dx, depth=clamp_depth)
    role = particle_roles(x, pinned, offset, dx, clamp_lo, clamp, kinematic=pin_path is not None)
    obstacles, movers, said = _obstacles(x, colliders, offset, dx)
    notes += said
    model = Model(
        mass, volume, mu, lam, yield_stress, viscosity, law, role, clamp_lo, clamp, offset, float(dx), frame_dt, substeps,
        gravity, obstacles, movers, pin_path=path, pin_rest=None if path is None else x, clamp_depth=clamp_depth, axes=axes,
    )  # fmt: skip
    if not pinned.any():  # a free body hardly shows its damping
        return model, notes
    return _with_damping(model, bodies, materials, notes), notes


def _obstacles(
    x: np.ndarray, colliders: Sequence[Collider], offset: np.ndarray, dx: float
) -> tuple[ColliderGrid, tuple[Collider, ...], list[str]]:
    """The colliders that stand still, as nodes of the lattice; all colliders if any moves, else none; notes for particles at x (N, 3)."""
    grid = collider_grid(colliders, offset, dx)
    notes = collider_notes(x, colliders, grid, offset, dx)
    standing = [one for one in colliders if not moves(one)]
    if len(standing) == len(colliders):
        return grid, (), notes
    return collider_grid(standing, offset, dx), tuple(colliders), notes


def _columns(
    parts: Sequence[Part], dx: float, frame_dt: float, max_substeps: int, notes: list[str]
) -> tuple[tuple[np.ndarray, ...], int]:
    """`_body_columns` of all bodies, as stiff as `max_substeps` allow, and the substeps that they need."""
    columns, most = [], 0
    for part in parts:
        body, stuff, scale = part
        youngs_modulus, needed = carried_modulus(part, dx, frame_dt, max_substeps)
        if youngs_modulus < stuff.youngs_modulus:
            notes.append(_softer(part, youngs_modulus, wave_substeps(part, dx, frame_dt), max_substeps))
        most = max(most, needed)
        columns.append(_body_columns(body, stuff, scale, youngs_modulus))
    return tuple(np.concatenate(column) for column in zip(*columns)), most


def _softer(part: Part, youngs_modulus: float, needed: int, allowed: int) -> str:
    """The note that a body is simulated with a lower Young's modulus [Pa] than its own, which would need more substeps than are allowed."""
    body, stuff, _ = part
    softer = stuff.youngs_modulus / youngs_modulus
    note = (
        f"{stuff.name}: too stiff for the solver, so it is simulated {in_figures(softer, 2)} times softer, with a Young's modulus of "
        f"{in_units(youngs_modulus, 'Pa')} in place of {in_units(stuff.youngs_modulus, 'Pa')} (which would need {needed} substeps a "
        f"frame; {allowed} are allowed). "
    )
    if not np.any(body.pinned):
        return note + "Nothing holds it, so it moves nearly as the real one does: nothing need be done, unless it visibly bends."
    return note + (
        f"It is held, so the forces that bend it are in proportion: about {in_figures(1.0 / softer, 2)} of the real ones if they are "
        f"recovered, while in an edit it bends {in_figures(softer, 2)} times as far. Fewer particles allow more stiffness; what need not "
        "bend can be a collider."
    )


def _with_damping(model: Model, bodies: Sequence[Particles], materials: Sequence[Material], notes: list[str]) -> Model:
    """The model with its materials' damping, as far as its substeps allow; more substeps would increase the solver's numerical damping."""
    own = [_retardation(body, stuff) for body, stuff in zip(bodies, materials)]
    wanted = max(float(one.max()) for one in own)
    if wanted == 0.0:
        return model
    needed = substeps_for(model, wanted)
    carried = longest_retardation(model)
    for body, stuff, longest in zip(bodies, materials, (float(one.max()) for one in own)):
        if longest > carried and np.any(body.pinned):
            loss_factor = stuff.loss_factor if body.mixture is None else 2.0 * math.pi * LOSS_FREQUENCY * longest
            damped = loss_factor * carried / longest
            notes.append(
                f"{stuff.name} swings on for longer than it should: it has a loss factor of {loss_factor:.2g}, and with "
                f"{model.substeps} substeps a frame the solver damps no more than {damped:.2g}. All of it would need {needed} substeps; "
                "fewer particles allow more damping."
            )
    return with_retardation(model, np.concatenate(own))


def _retardation(body: Particles, material: Material) -> np.ndarray:
    """(N,) retardation times [s] of a body's particles; 0 for one that flows."""
    if body.mixture is None or material.law in PLASTIC_LAWS:
        return np.full(len(body.x), material.retardation)
    return body.mixture.retardation


def with_clamp_depth(model: Model, body: Particles, depth: float) -> Model:
    """The model of one body that touches nothing, with its clamp beginning `depth` cells below the border of the pinned material."""
    if depth == model.clamp_depth:
        return model
    if model.pin_path is not None or model.collider_grid.planes.any() or model.collider_grid.solid.any():
        raise ValueError("the clamp depth can only be changed for a body whose pins stand still and that touches nothing")
    x = np.asarray(body.x, dtype=np.float64) if model.axes is None else body.x @ model.axes
    offset = lattice_offset(x, body.pinned, body.spacing, model.dx, depth=depth)
    clamp_lo, clamp = clamped_nodes(x, model.mass, body.pinned, offset, model.dx, depth=depth)
    role = particle_roles(x, body.pinned, offset, model.dx, clamp_lo, clamp)
    return replace(model, offset=offset, clamp_lo=clamp_lo, clamp=clamp, role=role, clamp_depth=depth)


def _check_reach(x: np.ndarray, dx: float) -> None:
    """SimulationError when a grid of spacing dx [m] around particles x (N, 3) [m] would have too many nodes."""
    cells = np.floor(np.ptp(x, axis=0) / dx) + 4.0
    if np.prod(cells) > MOST_NODES or cells.max() > MOST_NODES_ACROSS:
        reach = " x ".join(in_figures(size) for size in np.ptp(x, axis=0))
        raise SimulationError(
            f"The bodies reach over {reach} m, {in_figures(np.prod(cells), 2)} nodes of a grid {in_units(dx, 'm', 2)} wide, more than "
            f"{in_figures(MOST_NODES)} in all or {MOST_NODES_ACROSS} in a row.",
            "Bring them closer together, simulate those that cannot touch apart from each other, or use fewer particles.",
        )


def _checked_speed(speed: float, x: np.ndarray, path: np.ndarray | None, dx: float, frame_dt: float, max_substeps: int) -> float:
    """The speed [m/s] of a body, or of the pins on their path (T+1, M, 3) [m] if they are faster.

    `x` (N, 3) [m] are the particles, for the size in the error message.

    Raises:
        SimulationError: at a speed that crosses more than a cell in each of `max_substeps`.
    """
    who = f"A body {in_units(np.ptp(x, axis=0).max(), 'm', 2)} large"
    if path is not None:
        pins = float(np.linalg.norm(np.diff(path, axis=0), axis=2).max()) / frame_dt
        speed, who = (pins, "A pinned particle") if pins > speed else (speed, who)
    needed = math.ceil(speed * frame_dt / dx)
    if needed > max_substeps:
        raise SimulationError(
            f"{who} at {in_figures(speed)} m/s is too fast: in a frame it goes through {needed} cells of the solver's grid, "
            f"{in_units(dx, 'm', 2)} each, and {max_substeps} are allowed (one for each substep).",
            "If it is not that small or not that fast, correct the distance or scale, the unit of a mesh (metres), or the frame rate; "
            "otherwise use fewer particles.",
            quantity="velocity",
        )
    return speed


def _body_columns(body: Particles, material: Material, mass_scale: float, youngs_modulus: float) -> tuple[np.ndarray, ...]:
    """mass, volume, mu, lam, yield_stress, viscosity, law of one body's particles."""
    count = len(body.x)
    mixture = body.mixture
    if mixture is None:
        mixture = Mixture(np.ones(count), np.ones(count), np.full(count, material.poisson_ratio), np.full(count, material.retardation))
    mu, lam = lame(youngs_modulus * mixture.youngs_modulus, mixture.poisson_ratio)
    factor = np.ones(count) if body.stiffness is None else np.asarray(body.stiffness, dtype=np.float64)
    volume = np.array(np.broadcast_to(body.volume, (count,)), dtype=np.float64)
    return (
        volume * material.density * mass_scale * mixture.density,
        volume,
        mu * factor,
        lam * factor,
        np.full(count, float(material.yield_stress)),
        np.full(count, float(material.viscosity) if material.law in PLASTIC_LAWS else 0.0),
        np.full(count, LAWS[material.law], np.int32),
    )
