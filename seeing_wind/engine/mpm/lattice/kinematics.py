"""What holds at the nodes during a frame: pins that stand still or follow a path, and the colliders.

A pinned particle goes straight from where the path has it at one picture to where it has it at the next. The nodes that it clamps get
the velocity that the nearest pinned particles have there: their rigid motion, and what of an affine motion is left. Two things keep the
clamp as good as one that stands still (see `boundary`): the lattice, which remembers nothing, moves along with the pins, and which nodes
are clamped is found again whenever pins have moved a quarter of a cell against each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...errors import SimulationError, UsageError
from ..model import Model
from .boundary import clamped_nodes

_LATTICE_LAG = 0.1
"""Cells that pins may move before the lattice follows."""
_CLAMP_LAG = 0.25
"""Cells that pins may move against the lattice before the clamped nodes are found again."""
_NEAREST = 12
"""Pinned particles that tell what a place beside them does."""
_REACH = 6.0
"""Cells beyond the pins within which free particles count for the clamp."""
_AWAY = 0.05
"""Cells by which the path may start beside the particles."""


@dataclass(frozen=True)
class Conditions:
    """Arguments of `conditions.boundary_velocity` for a share of a frame."""

    offset: np.ndarray
    """(3,) a node of the lattice [m]."""
    clamp_lo: np.ndarray
    """(3,) int32, first node of `clamp`."""
    clamp: np.ndarray
    """(a, b, c) int32, 1 where the velocity is prescribed."""
    clamp_velocity: np.ndarray
    """(a, b, c, 3) that velocity [m/s]."""
    pin_velocity: np.ndarray
    """(N, 3) with which pinned particles move [m/s], or one row (1, 3) for all of them."""
    planes: np.ndarray
    """(K, 8), see `colliders.ColliderGrid`."""
    solid_lo: np.ndarray
    """(3,) int32."""
    solid: np.ndarray
    """(a, b, c, 8), see `colliders.ColliderGrid`."""
    push_lo: np.ndarray
    """(3,) int32, first node of `push`."""
    push: np.ndarray
    """(a, b, c, 3) acceleration prescribed at the nodes [m/s²]."""


def checked_pin_path(pin_path: np.ndarray, x: np.ndarray, pinned: np.ndarray, dx: float) -> np.ndarray:
    """The path (T+1, M, 3) [m] as float64, for particles x (N, 3) of which pinned (N,) bool are M.

    Raises:
        UsageError: nothing is pinned, the shape is wrong, a position is not finite, or it starts elsewhere than the particles.
    """
    path, count = np.asarray(pin_path), int(pinned.sum())
    if not count:
        raise UsageError("There is a path for pinned particles, but none is pinned.", "Pin the particles that are to follow it.")
    if path.ndim != 3 or path.shape[1:] != (count, 3) or len(path) < 2:
        raise UsageError(
            f"The path of the pinned particles has shape {path.shape}.", f"It must be (T+1, {count}, 3), two pictures or more."
        )
    path = path.astype(np.float64)
    if not np.isfinite(path).all():
        t, n, _ = np.argwhere(~np.isfinite(path))[0]
        raise UsageError(f"The path of pinned particle {n} is not finite in picture {t}.", "Check the motion of what holds it.")
    away = np.linalg.norm(path[0] - x[pinned], axis=1)
    if away.max() > _AWAY * dx:
        n = int(away.argmax())
        raise UsageError(
            f"The path of pinned particle {n} starts {1000.0 * away[n]:.3g} mm away from it.", "Picture 0 must be where the particles are."
        )
    return path


def conditions_for(model: Model, frame: int) -> list[Conditions]:
    """What holds during `frame`: piece i of P from substep i S // P of the frame's S to the next piece's.

    Raises:
        SimulationError: when the path of the pins has no such frame.
    """
    obstacles, force = model.collider_grid, model.grid_force
    still = Conditions(
        model.offset, model.clamp_lo, model.clamp, np.zeros((*model.clamp.shape, 3)), np.zeros((1, 3)),
        obstacles.planes, obstacles.solid_lo, obstacles.solid, force.lo, force.at(frame),
    )  # fmt: skip
    if model.pin_path is None or model.pin_rest is None:
        return [still]
    if not 0 <= frame < len(model.pin_path) - 1:
        raise SimulationError(
            f"The path of the pinned particles ends at picture {len(model.pin_path) - 1}, before frame {frame} is over.",
            "Give the path for every picture of the simulation.", frame=frame, quantity="pin_path",
        )  # fmt: skip
    start, step = model.pin_path[frame], model.pin_path[frame + 1] - model.pin_path[frame]
    at_rest = model.pin_rest[model.pinned]
    # A mesh's signed distance and a force are given on the lattice where it lies: with either, the lattice stays.
    follow = 0.0 if obstacles.solid[..., 0].any() or force.active else 1.0
    mean_step = follow * step.mean(axis=0)
    patterns = _count(float(np.linalg.norm(step - mean_step, axis=1).max()), _CLAMP_LAG * model.dx, model.substeps)
    shifts = _count(float(np.linalg.norm(mean_step)), _LATTICE_LAG * model.dx * patterns, model.substeps // patterns)
    pin_velocity = np.zeros((model.particles, 3))
    pin_velocity[model.pinned] = step / model.frame_dt
    still = replace(still, pin_velocity=pin_velocity)
    pieces = []
    for k in range(patterns):
        pins = start + (k + 0.5) / patterns * step
        shift = follow * (pins - at_rest).mean(axis=0)
        pattern = _clamp_at(model, pins, step / model.frame_dt, still, model.offset + shift)
        for j in range(shifts):
            behind = (j + 0.5) / shifts - 0.5
            pieces.append(replace(pattern, offset=pattern.offset + behind / patterns * mean_step))
    return pieces


def _count(distance: float, at_most: float, limit: int) -> int:
    return max(1, min(math.ceil(distance / at_most), limit))


def _clamp_at(model: Model, pins: np.ndarray, velocity: np.ndarray, still: Conditions, offset: np.ndarray) -> Conditions:
    """Clamped nodes and their velocities while the M pinned particles are at `pins` (M, 3) [m] and move with `velocity` (M, 3) [m/s]."""
    assert model.pin_rest is not None
    rest, pinned = model.pin_rest, model.pinned
    tree = cKDTree(rest[pinned])
    near = np.flatnonzero(~pinned)
    near = near[tree.query(rest[near])[0] < _REACH * model.dx] if len(near) else near
    some = np.concatenate([np.flatnonzero(pinned), near])
    x = np.concatenate([pins, carried(rest[near], rest[pinned], pins)])
    lo, clamp = clamped_nodes(x, model.mass[some], pinned[some], offset, model.dx, depth=model.clamp_depth)
    nodes = np.argwhere(clamp)
    clamp_velocity = np.zeros((*clamp.shape, 3))
    clamp_velocity[tuple(nodes.T)] = velocity_at(offset + model.dx * (nodes + lo), pins, velocity)
    return replace(still, offset=offset, clamp_lo=lo, clamp=clamp, clamp_velocity=clamp_velocity)


def carried(x: np.ndarray, pins_then: np.ndarray, pins_now: np.ndarray) -> np.ndarray:
    """Where x (P, 3) would be now if each place moved rigidly with the pins nearest to it, (M, 3) then and now [m]."""
    if not len(x):
        return x
    near = cKDTree(pins_then).query(x, k=min(_NEAREST, len(pins_then)))[1].reshape(len(x), -1)
    then, now = pins_then[near], pins_now[near]
    centre, centre_now = then.mean(axis=1, keepdims=True), now.mean(axis=1, keepdims=True)
    covariance = np.einsum("pki,pkj->pij", now - centre_now, then - centre)
    # A little of the identity: what the pins leave open (all on one line, or one alone) does not turn.
    size = np.einsum("pki,pki->p", then - centre, then - centre)
    U, _, Vt = np.linalg.svd(covariance + (1e-6 * size + 1e-30)[:, None, None] * np.eye(3))
    U[:, :, 2] *= np.sign(np.linalg.det(U @ Vt))[:, None]
    return centre_now[:, 0] + np.einsum("pij,pj->pi", U @ Vt, x - centre[:, 0])


def velocity_at(places: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Velocity (P, 3) at places (P, 3) beside particles x (M, 3) [m] with velocities v (M, 3) [m/s]: rigid, then affine, least squares."""
    if not len(places):
        return np.zeros((0, 3))
    near = cKDTree(x).query(places, k=min(_NEAREST, len(x)))[1].reshape(len(places), -1)
    centre, mean = x[near].mean(axis=1), v[near].mean(axis=1)
    r, u = x[near] - centre[:, None], v[near] - mean[:, None]
    size = np.einsum("pki,pki->p", r, r)[:, None, None] + 1e-30
    square = np.einsum("pki,pkj->pij", r, r)
    one = np.eye(3)
    inertia = np.trace(square, axis1=1, axis2=2)[:, None, None] * one - square + 1e-6 * size * one
    spin = np.linalg.solve(inertia, np.cross(r, u).sum(axis=1)[..., None])[..., 0]
    u = u - np.cross(spin[:, None], r)
    slope = np.einsum("pki,pkj->pij", u, r) @ np.linalg.inv(square + 1e-2 * size * one)
    away = places - centre
    return mean + np.cross(spin, away) + np.einsum("pij,pj->pi", slope, away)
