"""The part of a moving triangle mesh that every pixel shows: a depth buffer that gives that part's place in frame 0.

Homogeneous rasterisation (M. Olano and T. Greer, Triangle scan conversion using 2D homogeneous coordinates, 1997): with a triangle's
corners in the camera's axes as the columns of M, a ray d crosses the triangle if the solution of M w = d has no negative component. Divided
by their sum, the components are the barycentric coordinates; one over the sum is the depth. Since w is linear in the pixel, its values
between pixels cost nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....records import Camera

NEAR = 1e-3
"""Triangles with a corner nearer to the camera's plane than this are not drawn [m]."""

EDGE_ON = 1e-9
"""Least determinant of a triangle's corners in the camera's axes, over its depth cubed; a triangle with less is edge-on and not drawn."""

SHIFT = 0.1
"""Step [px] over which a place is differentiated: a whole pixel can lie beyond the horizon of a plane seen at a grazing angle."""


@dataclass(frozen=True)
class Seen:
    """The points of a mesh that S pixels show, by their places in frame 0."""

    pixel: np.ndarray
    """(S, 2) int, x y."""
    place: np.ndarray
    """(S, 3) [m]."""
    right: np.ndarray
    """(S, 3) change of `place` per pixel to the right, on the same triangle [m]."""
    down: np.ndarray
    """(S, 3) change of `place` per pixel downwards, on the same triangle [m]."""
    normal: np.ndarray
    """(S, 3) outward unit normal in frame 0."""


def seen_surface(vertices: np.ndarray, triangles: np.ndarray, camera: Camera, frame: int, rest: np.ndarray, mask: np.ndarray) -> Seen:
    """The points that the pixels of `mask` show: in each, on the nearest triangle that faces the camera; pixels without one are left out.

    Args:
        vertices: (V, 3) in frame `frame` [m]; triangles: (M, 3), counter-clockwise from outside; rest: (V, 3) the vertices in frame 0
        [m]; mask: (H, W) bool.
    """
    pose = camera.pose(frame)
    corners = ((vertices - pose[:3, 3]) @ pose[:3, :3])[triangles]  # (M, corner, axis)
    spanned = -np.linalg.det(corners)
    drawn = (corners[..., 2].min(axis=1) > NEAR) & (spanned > EDGE_ON * np.abs(corners[..., 2]).max(axis=1) ** 3)
    corners, at_rest = corners[drawn], rest[triangles[drawn]]
    owner, pixel = _candidates(corners, camera, mask)
    inverse = np.linalg.inv(corners.transpose(0, 2, 1))
    ray = np.column_stack([(pixel - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(len(pixel))])
    w = np.einsum("sab,sb->sa", inverse[owner], ray)
    hit = np.flatnonzero((w >= 0.0).all(axis=1))
    order = hit[np.lexsort((-w[hit].sum(axis=1), pixel[hit, 0], pixel[hit, 1]))]
    nearest = order[np.r_[True, (np.diff(pixel[order], axis=0) != 0).any(axis=1)][: len(order)]]
    owner, pixel, w = owner[nearest], pixel[nearest], w[nearest]

    def place(w: np.ndarray) -> np.ndarray:
        return np.einsum("sa,sab->sb", w / w.sum(axis=1, keepdims=True), at_rest[owner])

    here, columns = place(w), inverse[owner]
    return Seen(
        pixel=pixel,
        place=here,
        right=(place(w + SHIFT / camera.fx * columns[:, :, 0]) - here) / SHIFT,
        down=(place(w + SHIFT / camera.fy * columns[:, :, 1]) - here) / SHIFT,
        normal=normals_of(at_rest)[owner],
    )


def normals_of(corners: np.ndarray) -> np.ndarray:
    """(M, 3) unit normals of triangles with the corners (M, 3, 3); zero for those without area."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-15)


def counted(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For lists of `counts` (L,) entries each, one after another: the list of each entry, and its place in it, both (sum,)."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def _candidates(corners: np.ndarray, camera: Camera, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of a triangle of `corners` (M, 3, 3), in the camera's axes [m], and a pixel of `mask` in its bounding box: the triangles'
    indices (P,) and the pixels x, y (P, 2)."""
    height, width = mask.shape
    xy = corners[..., :2] / corners[..., 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    first = np.clip(np.ceil(xy.min(axis=1)), 0, [width, height]).astype(int)
    last = np.clip(np.floor(xy.max(axis=1)), -1, [width - 1, height - 1]).astype(int)
    spans = np.maximum(last - first + 1, 0)
    counts = spans.prod(axis=1)
    owner, within = counted(counts)
    pixel = first[owner] + np.stack([within % spans[owner, 0], within // spans[owner, 0]], axis=1)
    inside = mask[pixel[:, 1], pixel[:, 0]]
    return owner[inside], pixel[inside]
