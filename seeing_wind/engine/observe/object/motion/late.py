"""Where on the body the tracks are that begin after frame 0.

Such a track is followed from a side of the body that frame 0 did not show, so no depth map tells where it is. The body's surface is
moved along with the clip (`pose`), and the ray of the track meets it. At first that is done where the track begins, with the body as it
was believed then; once the whole clip has been gone through, each track is tied anew to where its rays met the surface in all its
frames, those that look squarely at the surface counting most (a body seen at a glance tells little of the place on it), and the body
is moved again.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from ....progress import Progress
from ....records import Camera, Observation, Surface
from .keypoints import held
from .pose import BodyPose
from .views import surface_points

PASSES = 4
"""Times that the body is moved through the clip."""

LATE_SIGMA = 5.0
"""Trust in a later track's tie while the body is moved [px]: the outline can pull it right."""

SQUARELY = 4
"""Power of the cosine between view and normal by which a frame counts for a tie."""

NEAR = 8
"""Triangles over which a normal is averaged."""

GUIDES = 12
"""Tracks of frame 0 from which on a later one in their midst is placed by them."""

LEAST_COSINE = 0.1
"""A surface seen at a sharper angle ties nothing."""


def tie(
    observation: Observation, surface: Surface, points: np.ndarray, first: np.ndarray, progress: Progress
) -> tuple[np.ndarray, np.ndarray]:
    """Places in frame 0 of the tracks that begin later.

    Args:
        points: (K, 3) the key points of the tracks that begin in frame 0 [m]; other rows are not used.
        first: (K,) the frame in which each track begins; negative for those that are not to be tied.

    Returns:
        (K, 3) [m], NaN for a track whose rays miss the surface throughout (and for those that are not later ones); and (K,) the
        standard deviation [px] of where the body was thought to be: how far the frames' ties disagree.
    """
    early, later = first == 0, first > 0
    ties = np.where(early[:, None], points, np.nan)
    spread = np.zeros(len(first))
    # Until the first of them begins, later tracks tell nothing: that part of the clip is gone through once.
    still = held(observation, surface.vertices)
    begin, begun = BodyPose(surface.vertices, observation.camera, points[early], still), int(first[later].min())
    before = _moved(begin, observation, surface, ties, first, (1, begun), progress)
    for _ in range(PASSES):
        states = _moved(copy(begin), observation, surface, ties, first, (begun, len(observation.masks)), progress)
        ties, spread = _tied(observation, surface, [surface.vertices, *before, *states], ties, later)
    return np.where(later[:, None], ties, np.nan), spread


def _moved(
    body: BodyPose,
    observation: Observation,
    surface: Surface,
    ties: np.ndarray,
    first: np.ndarray,
    span: tuple[int, int],
    progress: Progress,
) -> list[np.ndarray]:
    """The surface's vertices (V, 3) in the frames from span[0] up to span[1]; tracks without a tie get one as they begin."""
    sigma = np.where(first[None] == 0, observation.sigma, LATE_SIGMA)
    known = np.isfinite(ties).all(axis=1)
    weight = np.zeros((len(first), body.nodes))
    weight[known] = body.weights(ties[known])
    states = []
    for t in range(*span):
        progress.check()
        seen = known & observation.visible[t]
        body.advance(t, weight[seen], observation.xy[t, seen], sigma[t, seen], observation.masks[t])
        states.append(body.vertices)
        new = np.flatnonzero((first == t) & ~known)
        found, hit = surface_points(body.vertices, surface.triangles, observation.camera, observation.xy[t, new], t, surface.vertices)
        known[new[hit]] = True
        weight[new[hit]] = body.weights(found[hit])
    return states


def _tied(
    observation: Observation, surface: Surface, states: list[np.ndarray], before: np.ndarray, later: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The later tracks (K,) tied to the mean of where their rays meet the moved surface, and how far they disagree [px]."""
    count = len(later)
    total, share = np.zeros((count, 3)), np.zeros(count)
    hits = []
    for t in range(1, len(states)):
        seen = np.flatnonzero(later & observation.visible[t])
        if not len(seen):
            continue
        pixels = observation.xy[t, seen]
        found, hit = surface_points(states[t], surface.triangles, observation.camera, pixels, t, surface.vertices)
        squarely = np.zeros(len(seen))
        squarely[hit] = _squarely(found[hit], surface, states[t], observation.camera, t)
        use = hit & (squarely > LEAST_COSINE)
        weight = squarely[use] ** SQUARELY
        total[seen[use]] += weight[:, None] * found[use]
        share[seen[use]] += weight
        hits.append((seen[use], found[use], weight))
    ties = before.copy()
    ties[later] = np.nan
    known = share > 0.0
    ties[known] = total[known] / share[known, None]
    off = np.zeros(count)
    for seen, found, weight in hits:
        off[seen] += weight * ((found - ties[seen]) ** 2).sum(axis=1) / 2.0
    distance = observation.camera.project(surface.vertices.mean(axis=0))[1]
    pixel = float(distance) / np.sqrt(observation.camera.fx * observation.camera.fy)
    return ties, np.sqrt(off / np.maximum(share, 1e-12)) / pixel


def _squarely(rest: np.ndarray, surface: Surface, moved: np.ndarray, camera: Camera, frame: int) -> np.ndarray:
    """(K,) cosine between the view and the normal where points (K, 3) of the surface in frame 0 are in frame `frame`.

    The normal is the mean over the triangles near the point: those of a rough surface scatter.
    """
    corners = moved[surface.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-15)
    ray = corners.mean(axis=1) - camera.pose(frame)[:3, 3]
    cosine = -(normal * ray).sum(axis=1) / np.linalg.norm(ray, axis=1)
    facing = np.flatnonzero(cosine > 0.0)
    if not len(facing) or not len(rest):
        return np.zeros(len(rest))
    near = cKDTree(surface.vertices[surface.triangles[facing]].mean(axis=1)).query(rest, k=min(NEAR, len(facing)))[1]
    return cosine[facing][near.reshape(len(rest), -1)].mean(axis=1)


def among(observation: Observation, first: np.ndarray) -> np.ndarray:
    """(K,) bool: later tracks that begin amid enough tracks of frame 0, whose motion says where they are (`keypoints.place`)."""
    inside = np.zeros(len(first), bool)
    for t in np.unique(first[first > 0]):
        late = np.flatnonzero(first == t)
        guides = observation.xy[t, observation.visible[t] & (first == 0)]
        if len(guides) >= GUIDES and np.linalg.matrix_rank(guides - guides.mean(axis=0), 1.0) == 2:
            inside[late] = Delaunay(guides).find_simplex(observation.xy[t, late]) >= 0
    return inside
