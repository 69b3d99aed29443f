"""Placing tracks that begin after frame 0 on the body.

Such a track is usually on a side of the body that frame 0 did not show, so no depth map gives its place. Instead the body's surface is
moved along with the clip (`pose`) and intersected with the track's rays. In the first pass a track is tied in the frame where it begins,
to the body as estimated by then. After each pass through the clip, every track is tied anew, to the mean of where its rays met the surface
in all its frames, and the body is moved again. Frames that see the surface head-on count most: a grazing ray says little about the place.
"""

from __future__ import annotations

from copy import copy

import numpy as np
from scipy.spatial import Delaunay, cKDTree

from ....progress import Progress
from ....records import Camera, Observation, Surface
from ..shape.visibility import normals_of
from .keypoints import held
from .pose import BodyPose
from .views import surface_points

PASSES = 4
"""Number of times that the body is moved through the clip."""

LATE_SIGMA = 5.0
"""Standard deviation [px] of a later track's tie while the body is moved: so large that the outline can correct it."""

SQUARELY = 4
"""A frame's weight in a tie is the cosine between ray and normal to this power."""

NEAR = 8
"""Triangles over which a normal is averaged."""

GUIDES = 12
"""Least number of tracks from frame 0 that place a later track in their midst."""

LEAST_COSINE = 0.1
"""Least cosine between ray and normal for a frame to count in a tie."""


def tie(
    observation: Observation, surface: Surface, points: np.ndarray, first: np.ndarray, progress: Progress
) -> tuple[np.ndarray, np.ndarray]:
    """The places in frame 0 of the tracks that begin later.

    Args:
        points: (K, 3) [m], the key points of the tracks that begin in frame 0; other rows are not used.
        first: (K,) the frame in which each track begins; negative for those that are not to be tied.

    Returns:
        (K, 3) [m], NaN for a track whose rays miss the surface in all frames (and for those that do not begin later); and (K,) its standard
        deviation [px], from the scatter of the frames' ties.
    """
    early, later = first == 0, first > 0
    ties = np.where(early[:, None], points, np.nan)
    spread = np.zeros(len(first))
    # Before the first of them begins, later tracks make no difference: that part of the clip is done once only.
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
    """The surface's vertices (V, 3) [m] in each of the frames from span[0] to span[1] - 1; a track without a tie is tied as it begins."""
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
    """Ties (K, 3) [m] of the `later` tracks (K,) bool at the mean of where their rays meet the moved surface, given in frame 0, and their
    scatter (K,) [px]. `states`: the surface's vertices (V, 3) in every frame; `before`: (K, 3), the ties so far."""
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
    """(K,) cosine between the view and the normal, in frame `frame`, at points of the surface given by their places (K, 3) in frame 0.

    It is the mean over triangles near the point, because the normals of a rough surface scatter.
    """
    corners = moved[surface.triangles]
    normal = normals_of(corners)
    ray = corners.mean(axis=1) - camera.pose(frame)[:3, 3]
    cosine = -(normal * ray).sum(axis=1) / np.linalg.norm(ray, axis=1)
    facing = np.flatnonzero(cosine > 0.0)
    if not len(facing) or not len(rest):
        return np.zeros(len(rest))
    near = cKDTree(surface.vertices[surface.triangles[facing]].mean(axis=1)).query(rest, k=min(NEAR, len(facing)))[1]
    return cosine[facing][near.reshape(len(rest), -1)].mean(axis=1)


def amid_guides(observation: Observation, first: np.ndarray) -> np.ndarray:
    """(K,) bool: later tracks that begin amid enough tracks from frame 0, so that these place them (`keypoints.place`)."""
    inside = np.zeros(len(first), bool)
    for t in np.unique(first[first > 0]):
        late = np.flatnonzero(first == t)
        guides = observation.xy[t, observation.visible[t] & (first == 0)]
        if len(guides) >= GUIDES and np.linalg.matrix_rank(guides - guides.mean(axis=0), 1.0) == 2:
            inside[late] = Delaunay(guides).find_simplex(observation.xy[t, late]) >= 0
    return inside
