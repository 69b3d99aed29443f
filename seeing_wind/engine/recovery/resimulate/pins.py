"""Pinned vertices: the particles that hold them, and vertices that ride on particles but stay with their pins."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ...conventions import FARTHEST, frame_named
from ...errors import UsageError
from ...observe.object.motion.control import attach, carry
from ...reading import read_array
from ...records import Attachment, Particles

GRIP = 2.0
"""Particles within this distance of a pinned vertex are pinned [spacings]: one grid cell, the least that the grid can hold still."""

SOFT = 24.0
"""Angular frequency of a pin of weight one half [rad/s]: about four swings per second, as with a loosely holding hand."""


@dataclass(frozen=True)
class Rider:
    """Vertices that ride on particles: each moves by the displacement of the particles that carry it."""

    rest: np.ndarray
    """(V, 3) vertices at rest [m]."""
    attachment: Attachment
    particles_rest: np.ndarray
    """(N, 3) particles at rest [m]."""

    def follow(self, x: np.ndarray) -> np.ndarray:
        """Vertices (..., V, 3) [m] for particles at x (..., N, 3) [m]; for particles at rest they are exactly those of the mesh."""
        return carry(self.attachment, self.rest, self.particles_rest, x)


def read_pins(path: str | os.PathLike[str], count: int, what: str) -> np.ndarray:
    """Indices (P,) from an NPY file, each in 0..count-1; `what` (vertices, particles) names them in messages.

    Raises:
        UsageError: for a missing file, or one that is not a list of whole numbers, is empty, or has an index out of range.
    """
    pins = _array(path, "pins", f"Write the indices of the pinned {what} with numpy.save.")
    if pins.ndim != 1 or len(pins) == 0 or not np.issubdtype(pins.dtype, np.integer):
        raise UsageError(f"The pins {path} are {pins.dtype} of shape {pins.shape}.", f"A list of at least one index of {what} is needed.")
    if pins.min() < 0 or pins.max() >= count:
        bad = int(pins.max() if pins.max() >= count else pins.min())
        raise UsageError(f"The pins {path} name {bad}, but there are {count} {what}.", "Choose them again on this mesh.")
    return np.unique(pins)


def read_weights(path: str | os.PathLike[str], pins: str | os.PathLike[str]) -> np.ndarray:
    """Weights (P,) in 0..1 from an NPY file, in the order of the sorted indices that `read_pins` returns for `pins`.

    Raises:
        UsageError: for a missing file, a number of weights other than that of indices, or a weight outside 0..1.
    """
    advice = "Write one number from 0 to 1 per index with numpy.save."
    weights, index = _array(path, "weights", advice), read_array(pins)  # `read_pins` has already checked the latter
    if weights.shape != index.shape or not np.issubdtype(weights.dtype, np.floating):
        raise UsageError(f"The weights {path} are {weights.dtype} of shape {weights.shape} for {index.size} indices.", advice)
    if not ((weights >= 0.0) & (weights <= 1.0)).all():
        raise UsageError(f"The weights {path} are not all from 0 to 1.", advice)
    strongest = np.zeros(int(index.max()) + 1)
    np.maximum.at(strongest, index, weights)
    return strongest[np.unique(index)]


def _array(path: str | os.PathLike[str], what: str, advice: str) -> np.ndarray:
    if not Path(path).is_file():
        raise UsageError(f"There is no file of {what} {path}.", advice)
    try:
        return read_array(path)
    except (OSError, ValueError) as error:
        raise UsageError(f"The {what} {path} cannot be read: {error}.", advice) from error


def read_pin_path(path: str | os.PathLike[str], pins: str | os.PathLike[str], frames: int) -> np.ndarray:
    """Positions of pinned vertices in every frame, (T+1, P, 3) [m], from an NPY file, in the order of `read_pins`.

    Raises:
        UsageError: see `read_way`.
    """
    index = read_array(pins)  # `read_pins` has already checked it
    way = read_way(path, (frames + 1, index.size, 3), "the pins' way")
    return way[:, np.unique(index, return_index=True)[1]]


def read_way(path: str | os.PathLike[str], shape: tuple[int, ...], what: str) -> np.ndarray:
    """Positions of the given `shape`, such as (T+1, P, 3) [m], from an NPY file; `what` names them in messages.

    Raises:
        UsageError: for a missing file, another number of frames or vertices, or positions that are not finite or too far away.
    """
    if not Path(path).is_file():
        raise UsageError(f"There is no file {path} of {what}.", "Write their positions with numpy.save.")
    try:
        way = read_array(path)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}, {what}, cannot be read: {error}.", "Write their positions with numpy.save.") from error
    if way.shape != shape or not np.issubdtype(way.dtype, np.floating):
        raise UsageError(f"{path}, {what}, is {way.dtype} of shape {way.shape}.", f"It must be {shape}, in metres.")
    nowhere = ~(np.abs(way) <= FARTHEST)
    if nowhere.any():
        at = tuple(np.argwhere(nowhere)[0].tolist())
        raise UsageError(
            f"{path}, {what}: [{', '.join(map(str, at))}], in {frame_named(at[0])}, is {way[at]:g}.",
            f"Check the animation, and the unit: finite metres, at most {FARTHEST:g} from the origin.",
        )
    return way.astype(np.float64)


def particle_paths(rest: np.ndarray, way: np.ndarray, particles: Particles) -> np.ndarray:
    """Positions (T+1, N, 3) [m] of particles: pinned ones move with the firm pins near them, from `rest` (P, 3) along `way` (T+1, P, 3);
    others stay."""
    x = np.broadcast_to(particles.x, (len(way), *particles.x.shape)).copy()
    held = particles.pinned
    x[:, held] = carry(attach(particles.x[held], rest), particles.x[held], rest, way)
    return x


def hold_of(rest: np.ndarray, pins: np.ndarray, weights: np.ndarray, particles: Particles) -> np.ndarray:
    """(N,) weights in 0..1 with which particles are held by the vertices `pins` of rest (V, 3).

    The particle nearest to a firm vertex, and all within a grid cell of it, are held firmly; any other particle takes the weight of its
    nearest vertex.
    """
    hold = np.zeros(len(particles.x))
    of_vertex = np.zeros(len(rest))
    of_vertex[pins] = weights
    distance, nearest = cKDTree(rest).query(particles.x)
    if (weights < 1.0).any():
        hold = np.where(of_vertex[nearest] < 1.0, of_vertex[nearest], 0.0)
    firm = pins[weights >= 1.0]
    if len(firm):
        hold[particles_at(rest[firm], particles)] = 1.0
    return hold


def pull_back(offset: np.ndarray, v: np.ndarray, acceleration: np.ndarray, weight: np.ndarray, frame_dt: float) -> np.ndarray:
    """Acceleration (N, 3) [m/s²], constant over a frame, that pulls particles back to their places like a spring.

    The spring is that of `squared_frequency`, and its pull is that at the end of the frame (implicit Euler): it does
    not overshoot at any frame rate, and for w towards 1 the particle is at its place when the frame ends.

    Args:
        offset: (N, 3) displacement from the places [m].
        v: (N, 3) velocity [m/s].
        acceleration: (N, 3) acceleration by everything else that is known [m/s²].
        weight: (N,) w, in 0..1.
        frame_dt: duration of the frame [s].
    """
    squared = squared_frequency(weight)
    return -(squared / (1.0 + squared * frame_dt**2))[:, None] * (offset + frame_dt * v + frame_dt**2 * acceleration)


def squared_frequency(weight: np.ndarray) -> np.ndarray:
    """omega² [1/s²] of the springs of soft pins with weights w (N,) in 0..1: omega = SOFT sqrt(w / (1 - w))."""
    return SOFT**2 * weight / np.maximum(1.0 - weight, 1e-6)


def particles_at(vertices: np.ndarray, particles: Particles) -> np.ndarray:
    """(N,) bool: the particles that hold vertices (P, 3) [m]: the nearest to each vertex, and all within a grid cell of it."""
    tree = cKDTree(particles.x)
    held = np.zeros(len(particles.x), dtype=bool)
    held[tree.query(vertices)[1]] = True
    distance = cKDTree(vertices).query(particles.x)[0]
    return held | (distance <= GRIP * particles.spacing)


def ride(vertices: np.ndarray, particles: Particles, pins: np.ndarray) -> Rider:
    """Attach vertices (V, 3) [m] to particles, and the vertices `pins` to pinned particles only.

    Any other vertex rides on its neighbours by affine moving least squares. At a pin some of the neighbours may be free, and would pull the
    vertex away.
    """
    attachment = attach(vertices, particles.x)
    if len(pins):
        index, weight = attachment.index.copy(), attachment.weight.copy()
        held = np.flatnonzero(particles.pinned)
        index[pins] = held[cKDTree(particles.x[held]).query(vertices[pins])[1]][:, None]
        weight[pins] = 0.0
        weight[pins, 0] = 1.0
        attachment = Attachment(index, weight)
    return Rider(vertices, attachment, particles.x)
