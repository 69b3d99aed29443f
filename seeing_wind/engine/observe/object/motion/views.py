"""Further synchronised views: the points tracked in them, placed on the body that was built from the first view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ....errors import ObjectError
from ....materials import PLASTIC_LAWS
from ....progress import Journal, NoProgress, Progress
from ....records import Body, Camera, Observation, TrackTargets
from .control import attach
from .keypoints import held
from .lifting import Sight, lift


def view_targets(body: Body, observation: Observation) -> TrackTargets:
    """Targets of a further view: every track that is visible in frame 0 is attached where its ray meets the body's surface.

    Raises:
        ObjectError: no track of the view meets the body, so camera or scale contradict the first view.
    """
    seen = observation.visible[0] & ~observation.on_centroid
    points, hit = surface_points(body.surface.vertices, body.surface.triangles, observation.camera, observation.xy[0])
    use = np.flatnonzero(seen & hit)
    if use.size == 0:
        raise ObjectError(
            f"None of the {int(seen.sum())} points tracked in {observation.clip} lies on the object of the first view.",
            "Check that both cameras are in the same world and that both clips begin at the same moment.",
        )
    return TrackTargets(
        xy=observation.xy[:, use],
        visible=observation.visible[:, use],
        sigma=observation.sigma[:, use],
        camera=observation.camera,
        attachment=attach(points[use], body.particles.x),
    )


def lifted_together(
    observation: Observation, body: Body, targets: Sequence[TrackTargets], progress: Progress = NoProgress(), journal: Journal = Journal()
) -> Body:
    """The body with its key points P^t lifted from all views together: what is depth for one camera, another sees in its image plane.

    Args:
        observation: the first view, which has the body's key points; targets: of the first view, then of further ones (`view_targets`).
        journal: keeps the frames that were lifted so far.

    Returns:
        The body with `lifted` (T+1, K, 3) [m] for the first view's key points only, as the others are no part of the observation.
    """
    counts = [one.xy.shape[1] for one in targets]
    begin = np.cumsum([0, *counts])
    sights = []
    for number, one in enumerate(targets):
        xy = np.zeros((len(one.xy), begin[-1], 2))
        visible, sigma = np.zeros(xy.shape[:2], bool), np.ones(xy.shape[:2])
        own = slice(begin[number], begin[number + 1])
        xy[:, own], visible[:, own], sigma[:, own] = one.xy, one.visible, one.sigma
        sights.append(Sight(one.camera, xy, visible, sigma))
    further = [one.attachment.follow(body.particles.x) for one in targets[1:]]
    # Key points without a place are visible in no frame of `targets`; they stay NaN, and need some finite start.
    own_start = np.where(targets[0].visible.any(axis=0)[:, None], body.lifted[0], body.particles.x.mean(axis=0))
    pinned = np.concatenate([held(observation, own_start), *(np.zeros(len(points), bool) for points in further)])
    flows = body.material.law in PLASTIC_LAWS
    lifted = lift(sights, np.concatenate([own_start, *further]), pinned, flows, progress, journal)
    return replace(body, lifted=lifted[:, : counts[0]])


def surface_points(
    vertices: np.ndarray, triangles: np.ndarray, camera: Camera, xy: np.ndarray, frame: int = 0, rest: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The first intersections of pixels' rays in frame `frame` with a triangle mesh (Moeller and Trumbore 1997, all pairs at once).

    Args:
        vertices: (V, 3) in that frame [m]; triangles: (M, 3); xy: (K, 2) [px].
        rest: (V, 3) the vertices in another frame [m], for which the points are returned; None takes `vertices`.

    Returns:
        points (K, 3) [m], NaN where the ray misses, and hit (K,) bool.
    """
    origin = camera.pose(frame)[:3, 3]
    direction = camera.unproject(xy, np.ones(len(xy)), frame) - origin
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    edge1, edge2 = b - a, c - a
    p = np.cross(direction[:, None], edge2[None])
    determinant = (p * edge1).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origin - a
        u = (p * s).sum(-1) / determinant
        q = np.cross(s, edge1)
        v = direction @ q.T / determinant
        t = (q * edge2).sum(-1) / determinant
    t = np.where((np.abs(determinant) > 1e-15) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)
    hit = np.isfinite(t).any(axis=1)
    points = np.full((len(xy), 3), np.nan)
    if hit.any():
        ray, triangle = np.flatnonzero(hit), t[hit].argmin(axis=1)
        share = np.stack([1.0 - u[ray, triangle] - v[ray, triangle], u[ray, triangle], v[ray, triangle]], axis=1)
        points[ray] = (share[:, :, None] * (vertices if rest is None else rest)[triangles[triangle]]).sum(axis=1)
    return points, hit
