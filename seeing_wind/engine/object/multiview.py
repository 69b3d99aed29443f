"""The Gaussians of a body that several posed cameras saw at one moment: what only a further view shows is added, then all are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ..progress import Progress
from ..records import Attachment, Body, Gaussians, Observation
from .control import attach
from .gaussians import COUNT, FLATTENING, INITIAL_OPACITY, INITIAL_SIGMA, SH0
from .relief import clean_mask
from .splatting import Look, fit_views
from .views import surface_points

COVERED = 1.5
"""A place is shown already where a Gaussian lies within this many of the new ones' distances."""

RAYS = 400
"""Rays that meet the surface at once: memory."""


def with_views(body: Body, first: Observation, further: Sequence[Observation], progress: Progress | None = None) -> tuple[Body, float]:
    """The body with Gaussians for all that picture 0 of any view shows, fitted by splatting on all of them.

    Args:
        body: built from the first view, whose surface the other cameras' rays meet.

    Returns:
        the body, and the PSNR inside the first view's mask [dB].

    Raises:
        ObjectError: a further view whose mask is empty.
    """
    looks = [Look(one.camera, clean_mask(one.masks[0]), one.image) for one in (first, *further)]
    gaussians = body.gaussians
    for look in looks[1:]:
        gaussians = joined(gaussians, uncovered(body, gaussians, look))
    fitted, quality = fit_views(gaussians, looks, progress=progress)
    return replace(body, gaussians=fitted), quality


def uncovered(body: Body, gaussians: Gaussians, look: Look) -> Gaussians:
    """Flat Gaussians on the part of the surface at rest that `look` shows and `gaussians` do not cover, with its colours."""
    rows, columns = np.nonzero(look.mask)
    stride = max(1, round(np.sqrt(len(rows) / COUNT)))
    chosen = (rows % stride == 0) & (columns % stride == 0)
    rows, columns = rows[chosen], columns[chosen]
    xy = np.stack([columns, rows], axis=1).astype(float)
    parts = [surface_points(body.surface.vertices, body.surface.triangles, look.camera, xy[k : k + RAYS]) for k in range(0, len(xy), RAYS)]
    points, hit = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    points, rows, columns = points[hit], rows[hit], columns[hit]
    apart = stride * look.camera.project(points)[1] / np.sqrt(look.camera.fx * look.camera.fy)
    fresh = cKDTree(gaussians.x).query(points)[0] > COVERED * apart
    points, apart, colour = points[fresh], apart[fresh], look.image[rows[fresh], columns[fresh]] / 255.0
    corners = body.surface.vertices[body.surface.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
    normal = normals[cKDTree(corners.mean(axis=1)).query(points)[1]] if len(points) else np.zeros((0, 3))
    turn = Rotation.concatenate([Rotation.align_vectors(one[None], [[0.0, 0.0, 1.0]])[0] for one in normal]) if len(points) else None
    return Gaussians(
        x=points,
        scale=INITIAL_SIGMA * apart[:, None] * np.array([1.0, 1.0, FLATTENING]),
        rotation=np.zeros((0, 4)) if turn is None else turn.as_quat()[:, [3, 0, 1, 2]],
        opacity=np.full(len(points), INITIAL_OPACITY),
        sh=((colour - 0.5) / SH0)[:, None, :],
        attachment=attach(points, body.particles.x),
    )


def joined(first: Gaussians, second: Gaussians) -> Gaussians:
    """Both sets as one; harmonics that only one has are zero in the other."""
    if len(second.x) == 0:
        return first
    count = max(first.sh.shape[1], second.sh.shape[1])
    sh = [np.pad(one.sh, ((0, 0), (0, count - one.sh.shape[1]), (0, 0))) for one in (first, second)]
    plain = {name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in ("x", "scale", "rotation", "opacity")}
    ride = [np.concatenate([getattr(one.attachment, name) for one in (first, second)]) for name in ("index", "weight")]
    return Gaussians(**plain, sh=np.concatenate(sh), attachment=Attachment(*ride))
