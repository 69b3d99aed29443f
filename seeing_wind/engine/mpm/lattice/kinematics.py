"""The boundary conditions at the nodes during a frame: pins and colliders that stand still or follow a path.

A pinned particle moves in a straight line between its places at two consecutive frames. The clamped nodes get the velocity of the nearest
pinned particles, continued to the node: their rigid motion, and an affine fit to what remains. Two things keep the clamp as good as one
that stands still (see `boundary`): the lattice, which stores no state between substeps, moves along with the pins, and the clamped nodes
are determined again whenever pins have moved a quarter of a cell relative to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ...conventions import frame_named, in_units
from ...errors import SimulationError, UsageError
from ..model import Model
from ..state import State
from .beside import carried, velocity_at
from .boundary import clamped_nodes
from .colliders import collider_grid, moves, within_reach
from .mesh_collider import MeshCollider

_LATTICE_LAG = 0.1
"""Cells that pins may move before the lattice follows."""
_CLAMP_LAG = 0.25
"""Cells that pins may move relative to the lattice before the clamped nodes are determined again."""
_LIFT_LAG = 0.02
"""Cells that a collider may move before the lattice follows. It is small because contact only removes velocity into the collider and never
pushes out: what rests on a collider that moves across the lattice sinks to the level at which the held nodes lie deepest."""
_WALL_LAG = 0.5
"""Cells that a collider may move before it is sampled again, but see `_MOST_WALLS`."""
_MOST_WALLS = 16
"""Samples of the colliders in a frame, at most."""
_AROUND, _FASTER = 4.0, 2.0
"""Margin around the particles within which they may meet a collider: in cells, plus this many times what particles and colliders move in a
frame."""
_REACH = 6.0
"""Distance from the pins [cells] within which free particles are taken into account for the clamp."""
_AWAY = 0.05
"""How far from the particles their path may start [cells]."""


@dataclass(frozen=True)
class Conditions:
    """Arguments of `conditions.boundary_velocity` for a part of a frame."""

    offset: np.ndarray
    """(3,) a node of the lattice [m]."""
    clamp_lo: np.ndarray
    """(3,) int32, first node of `clamp`."""
    clamp: np.ndarray
    """(a, b, c) int32, 1 where the velocity is prescribed."""
    clamp_velocity: np.ndarray
    """(a, b, c, 3) the prescribed velocity [m/s]."""
    pin_velocity: np.ndarray
    """(N, 3) velocity of pinned particles [m/s], or one row (1, 3) for all of them."""
    planes: np.ndarray
    """(K, 8), see `colliders.ColliderGrid`."""
    solid_lo: np.ndarray
    """(3,) int32, first node of `solid`."""
    solid: np.ndarray
    """(a, b, c, 8), see `colliders.ColliderGrid`."""


def checked_pin_path(pin_path: np.ndarray, x: np.ndarray, pinned: np.ndarray, dx: float) -> np.ndarray:
    """The path (T+1, M, 3) [m] as float64, for particles x (N, 3) of which M are pinned (N,) bool; dx: the grid's cell size [m].

    Raises:
        UsageError: nothing is pinned, the shape is wrong, a position is not finite, or the path does not start at the particles.
    """
    path, count = np.asarray(pin_path), int(pinned.sum())
    if not count:
        raise UsageError("There is a path for pinned particles, but none is pinned.", "Pin the particles that are to follow it.")
    if path.ndim != 3 or path.shape[1:] != (count, 3) or len(path) < 2:
        raise UsageError(
            f"The path of the pinned particles has shape {path.shape}.", f"It must be (T+1, {count}, 3), two frames or more."
        )
    path = path.astype(np.float64)
    if not np.isfinite(path).all():
        t, n, _ = np.argwhere(~np.isfinite(path))[0]
        raise UsageError(f"The path of pinned particle {n} is not finite in {frame_named(t)}.", "Check the motion of what holds it.")
    away = np.linalg.norm(path[0] - x[pinned], axis=1)
    if away.max() > _AWAY * dx:
        n = int(away.argmax())
        raise UsageError(
            f"The path of pinned particle {n} starts {in_units(away[n], 'm')} away from it.", "Frame 0 must be where the particles are."
        )
    return path


def conditions_for(model: Model, frame: int, state: State) -> list[Conditions]:
    """The conditions during `frame`, in P consecutive pieces: of the frame's S substeps, piece i begins with number i S // P.

    Moving colliders are sampled only where the particles of `state`, the state at the frame's start, may get to.

    Raises:
        SimulationError: when the path of the pins has no such frame.
    """
    obstacles = model.collider_grid
    still = Conditions(
        model.offset, model.clamp_lo, model.clamp, np.zeros((*model.clamp.shape, 3)), np.zeros((1, 3)),
        obstacles.planes, obstacles.solid_lo, obstacles.solid,
    )  # fmt: skip
    movers = bool(model.movers)
    begun, span = frame + model.part[0] / model.part[1], 1.0 / model.part[1]
    moved = span * max((one.farthest(frame) for one in model.movers if isinstance(one, MeshCollider)), default=0.0)
    region = _region(model, state, moved) if movers else None
    model = model if region is None else replace(model, movers=within_reach(model.movers, region, frame))
    walls = min(_count(moved, _WALL_LAG * model.dx, model.substeps), _MOST_WALLS)
    if model.pin_path is None or model.pin_rest is None:
        shifts = _count(moved, _LIFT_LAG * model.dx * walls, model.substeps // walls)
        times = [begun + (k + 0.5) / walls * span for k in range(walls)]
        return [piece for time in times for piece in _conditions_during(model, still, time, region, span / walls, shifts)]
    if not 0 <= frame < len(model.pin_path) - 1:
        raise SimulationError(
            f"The path of the pinned particles ends at {frame_named(len(model.pin_path) - 1)}, before {frame_named(frame)} is over.",
            "Give the path for every frame of the simulation.", frame=frame, quantity="pin_path",
        )  # fmt: skip
    step = span * (model.pin_path[frame + 1] - model.pin_path[frame])
    start = model.pin_path[frame] + model.part[0] * step
    at_rest = model.pin_rest[model.pinned]
    # A mesh's depth is sampled on the lattice in its present place: if there is a mesh, the lattice does not follow the pins.
    follow = 0.0 if movers or obstacles.solid[..., 0].any() else 1.0
    mean_step = follow * step.mean(axis=0)
    patterns = _count(float(np.linalg.norm(step - mean_step, axis=1).max()), _CLAMP_LAG * model.dx, model.substeps)
    patterns = max(patterns, walls)
    shifts = _count(float(np.linalg.norm(mean_step)), _LATTICE_LAG * model.dx * patterns, model.substeps // patterns)
    pin_velocity = np.zeros((model.particles, 3))
    pin_velocity[model.pinned] = step / model.frame_dt
    still = replace(still, pin_velocity=pin_velocity)
    pieces = []
    for k in range(patterns):
        pins = start + (k + 0.5) / patterns * step
        shift = follow * (pins - at_rest).mean(axis=0)
        pattern = _clamp_at(model, pins, step / model.frame_dt, still, model.offset + shift)
        pattern = _conditions_at(model, pattern, begun + (k + 0.5) / patterns * span, region)
        for j in range(shifts):
            behind = (j + 0.5) / shifts - 0.5
            pieces.append(replace(pattern, offset=pattern.offset + behind / patterns * mean_step))
    return pieces


def _region(model: Model, state: State, moved: float) -> np.ndarray:
    """Corners (2, 3) [m] of the box in which particles may meet colliders in a frame, if these move by `moved` [m]."""
    reach = _AROUND * model.dx + _FASTER * (moved + float(np.linalg.norm(state.v, axis=1).max()) * model.frame_dt)
    return np.stack([state.x.min(axis=0) - reach, state.x.max(axis=0) + reach])


def _conditions_during(
    model: Model, conditions: Conditions, time: float, region: np.ndarray | None, lasts: float, shifts: int
) -> list[Conditions]:
    """`_conditions_at` for an interval of `lasts` [frames] around `time`, in `shifts` pieces.

    The lattice moves with the first collider that moves, so that contact with it is as smooth as with one that stands still.
    """
    if not model.movers:
        return [conditions]
    lead = next(one for one in model.movers if isinstance(one, MeshCollider) and moves(one))
    before, middle, after = (lead.posed(time + behind * lasts, model.frame_dt).vertices.mean(axis=0) for behind in (-0.5, 0.0, 0.5))
    offset = model.offset + middle - lead.vertices.mean(axis=0)
    walled = _conditions_at(model, replace(conditions, offset=offset), time, region)
    return [replace(walled, offset=offset + ((j + 0.5) / shifts - 0.5) * (after - before)) for j in range(shifts)]


def _conditions_at(model: Model, conditions: Conditions, time: float, region: np.ndarray | None) -> Conditions:
    """The conditions with the colliders as they are at a time [frames], within a region (2, 3) [m]; unchanged if no collider moves."""
    if not model.movers:
        return conditions
    posed = [one.posed(time, model.frame_dt * model.part[1]) if isinstance(one, MeshCollider) else one for one in model.movers]
    grid = collider_grid(posed, conditions.offset, model.dx, region)
    return replace(conditions, planes=grid.planes, solid_lo=grid.solid_lo, solid=grid.solid)


def _count(distance: float, at_most: float, limit: int) -> int:
    return max(1, min(math.ceil(distance / at_most), limit))


def _clamp_at(model: Model, pins: np.ndarray, velocity: np.ndarray, still: Conditions, offset: np.ndarray) -> Conditions:
    """The conditions `still`, with the clamped nodes and their velocities while the M pinned particles are at `pins` (M, 3) [m] and move
    with `velocity` (M, 3) [m/s]; offset (3,): that of the lattice [m]."""
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
