"""The tracked points in frame 0: their places on the body, and their attachment to its particles."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from ....records import Attachment, Observation, Particles
from ..shape.relief import Relief
from .control import attach

NEIGHBOURS = 16
"""Number of particles that carry a key point, and of tracks that place a track which begins later."""


def place(observation: Observation, relief: Relief, particles: Particles) -> np.ndarray:
    """Key points P^0 = pi^-1(p^0, d), Eq. (10), on the visible surface in frame 0.

    A centroid track is the point behind the silhouette's centroid at the depth of the body's centre of mass. A track that begins later
    is placed among the tracks of the frame in which it begins (affine moving least squares there) and carried back to frame 0.

    Returns:
        (K, 3) [m], NaN for a track that is seen in no frame.
    """
    count = observation.xy.shape[1]
    points = np.full((count, 3), np.nan)
    seen = observation.visible & np.isfinite(observation.xy).all(axis=-1)
    first = np.where(seen.any(axis=0), seen.argmax(axis=0), -1)
    on_surface = first == 0
    points[on_surface] = _unproject(relief, observation.xy[0, on_surface])
    centre = np.average(particles.x, axis=0, weights=particles.volume)
    for k in np.flatnonzero(observation.on_centroid & (first >= 0)):
        # The centroid of frame 0 if it is seen there; a centroid that is only seen later stands for the body's centre.
        depth = observation.camera.project(centre)[1]
        points[k] = observation.camera.unproject(observation.xy[0, k], depth) if first[k] == 0 else centre
    for t in np.unique(first[first > 0]):
        late = np.flatnonzero((first == t) & ~observation.on_centroid)
        guides = np.flatnonzero(seen[t] & (first < t) & (first >= 0) & ~observation.on_centroid)
        if len(guides) == 0 or len(late) == 0:
            points[late] = centre
            continue
        flat = _in_plane(observation.xy[t, late]), _in_plane(observation.xy[t, guides])
        carried = attach(*flat, neighbours=NEIGHBOURS)
        guess = observation.camera.project(carried.follow(points[guides]))[0]
        # A track beyond the guides' reach keeps its offset from them: on a stem, for example, below a head that has all of them.
        guess += observation.xy[t, late] - carried.follow(flat[1])[:, :2]
        # Put back on the surface: the affine guess may float above a curved body.
        points[late] = _unproject(relief, guess)
    return points


def ride(points: np.ndarray, on_centroid: np.ndarray, particles: Particles) -> Attachment:
    """Attach key points (K, 3) [m] to the particles; those never seen (NaN) at the centre of mass, so that every row is valid.

    `on_centroid`: (K,) bool, centroid tracks, which weigh the particles nearest them alike.
    """
    centre = np.average(particles.x, axis=0, weights=particles.volume)
    known = np.where(np.isfinite(points).all(axis=1)[:, None], points, centre)
    result = attach(known, particles.x, NEIGHBOURS)
    if not on_centroid.any():
        return result
    index, weight = result.index.copy(), result.weight.copy()
    middle = attach(known[on_centroid], particles.x, NEIGHBOURS, uniform=True)
    index[on_centroid], weight[on_centroid] = middle.index, middle.weight
    return Attachment(index=index, weight=weight)


def held(observation: Observation, points: np.ndarray) -> np.ndarray:
    """(K,) bool: which key points (K, 3) [m] lie in the pinned region of frame 0."""
    height, width = observation.pin.shape
    known = np.isfinite(points).all(axis=1)
    xy = observation.camera.project(np.where(known[:, None], points, points[known].mean(axis=0) if known.any() else 0.0))[0]
    with np.errstate(invalid="ignore"):
        column = np.clip(np.nan_to_num(np.round(xy[:, 0])), 0, width - 1).astype(int)
        row = np.clip(np.nan_to_num(np.round(xy[:, 1])), 0, height - 1).astype(int)
    return known & observation.pin[row, column]


def _unproject(relief: Relief, xy: np.ndarray) -> np.ndarray:
    """Points on the front (K, 3) [m] at pixels `xy` (K, 2). A track just outside the mask takes the depth of the object's nearest pixel."""
    rows, columns = np.round(np.clip(xy.T[::-1], 0, np.array(relief.mask.shape)[:, None] - 1)).astype(int)
    off = ~relief.mask[rows, columns]
    points = relief.points(xy, 0.0)
    if off.any():
        near = ndimage.distance_transform_edt(~relief.mask, return_distances=False, return_indices=True)[:, rows[off], columns[off]]
        points[off] = relief.camera.unproject(xy[off], relief.front[near[0], near[1]])
    return points


def _in_plane(xy: np.ndarray) -> np.ndarray:
    return np.column_stack([xy, np.zeros(len(xy))])
