"""Gaussians for parts of the surface that have none yet, because only a further view or a later frame shows them."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ..observe.object.motion.control import attach
from ..observe.object.shape.relief import MAX_SLANT
from ..observe.object.shape.visibility import seen_surface
from ..records import Attachment, Body, Camera, Gaussians
from .gaussians import COUNT, FLATTENING, INITIAL_OPACITY, INITIAL_SIGMA, SH0, axes_of

COVERED = 1.2
"""A place is covered if a Gaussian on the same side of the surface lies within this many times the spacing of the new Gaussians."""

APART = 2.0
"""To tell the two sides of a thin leaf apart, places are moved out along their normals by this many times that spacing."""


def cover_bare_surface(
    body: Body, gaussians: Gaussians, camera: Camera, mask: np.ndarray, image: np.ndarray, frame: int = 0, x: np.ndarray | None = None
) -> Gaussians:
    """Flat Gaussians, with the frame's colours, on the part of the surface that a frame shows and `gaussians` do not cover.

    Args:
        mask: (H, W) bool, the object in frame `frame` of `camera`; image: (H, W, 3) uint8 RGB, that frame; x: (N, 3) particle positions
            in that frame [m], None for rest.

    Returns:
        Gaussians at rest, attached to the body's particles; possibly none.
    """
    surface = body.surface
    vertices = surface.vertices if x is None else surface.attachment.follow(x)
    stride = max(1, round(np.sqrt(mask.sum() / COUNT)))
    lattice = np.zeros_like(mask)
    lattice[::stride, ::stride] = mask[::stride, ::stride]
    seen = seen_surface(vertices, surface.triangles, camera, frame, surface.vertices, lattice)
    frames, size = _frames(seen.right, seen.down, seen.normal)
    size = stride * np.minimum(size, MAX_SLANT * size[:, :1])
    fresh = np.zeros(len(size), bool)
    if len(size):
        out = APART * float(np.median(size[:, 0]))
        normals = axes_of(gaussians)[:, :, 2]
        fresh = cKDTree(gaussians.x + out * normals).query(seen.place + out * seen.normal)[0] > COVERED * size[:, 0]
    place, size, pixel = seen.place[fresh], size[fresh], seen.pixel[fresh]
    rotation = Rotation.from_matrix(frames[fresh]).as_quat()[:, [3, 0, 1, 2]] if len(place) else np.zeros((0, 4))
    return Gaussians(
        x=place,
        scale=INITIAL_SIGMA * np.column_stack([size, FLATTENING * size[:, 0]]),
        rotation=rotation,
        opacity=np.full(len(place), INITIAL_OPACITY),
        sh=((image[pixel[:, 1], pixel[:, 0]] / 255.0 - 0.5) / SH0)[:, None, :],
        attachment=attach(place, body.particles.x),
    )


def _frames(right: np.ndarray, down: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes of the ellipses that pixels cover on a surface, from two conjugate half-axes `right` and `down` (S, 3) [m].

    Returns:
        (S, 3, 3) with columns short axis, long axis, normal, right-handed; and (S, 2) the lengths of the two axes [m].
    """
    e1 = right / np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-15)
    e2 = np.cross(normal, e1)
    flat = np.stack([np.stack([(v * e).sum(axis=1) for v in (right, down)], axis=1) for e in (e1, e2)], axis=1)
    values, vectors = np.linalg.eigh(flat @ flat.transpose(0, 2, 1))
    short = e1 * vectors[:, :1, 0] + e2 * vectors[:, 1:, 0]
    long = np.cross(normal, short)
    return np.stack([short, long, normal], axis=2), np.sqrt(np.maximum(values, 0.0))


def joined(first: Gaussians, second: Gaussians) -> Gaussians:
    """Both sets as one, padded with zeros where one has fewer harmonics, or fewer particles per Gaussian, than the other."""
    if len(second.x) == 0:
        return first
    count = max(first.sh.shape[1], second.sh.shape[1])
    sh = [np.pad(one.sh, ((0, 0), (0, count - one.sh.shape[1]), (0, 0))) for one in (first, second)]
    plain = {name: np.concatenate([getattr(first, name), getattr(second, name)]) for name in ("x", "scale", "rotation", "opacity")}
    carriers = max(first.attachment.index.shape[1], second.attachment.index.shape[1])
    ride = [
        np.concatenate([np.pad(values, ((0, 0), (0, carriers - values.shape[1]))) for values in both])
        for both in ((first.attachment.index, second.attachment.index), (first.attachment.weight, second.attachment.weight))
    ]
    return Gaussians(**plain, sh=np.concatenate(sh), attachment=Attachment(*ride))
