"""What one camera saw of a sheet: the places of its tracked and recognised points, and the outline that it fills."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy import ndimage
from scipy.sparse import csr_matrix, vstack
from scipy.spatial import cKDTree

from ....masks import Masks
from ....records import Camera
from ..motion.lifting import Sight
from ..motion.views import surface_points
from .mesh import SheetMesh
from .riding import ride_flat

FINEST, TIED, RECOGNISED = 0.1, 0.5, 0.5
"""Standard deviations [px]: the least of a track, that of the place on the sheet of a track which begins after frame 0, and that of a
recognised point."""
OUTLIER = 3.0
"""Residual [standard deviations] from which a track counts less and less (Cauchy weights), as it may slide where the sheet folds. The
threshold is larger while all residuals are."""
LEAVES, OUTLINE = 1.0, 2.0
"""Distance [px] outside the outline up to which a vertex costs nothing, and the standard deviation of the distance beyond that [px]."""
BARE, RIM = 3.0, 4
"""Distance [px] up to which falling short of the outline costs nothing; and one in RIM points of the outline is used."""
OUTLINE_PIXELS = 4e5
"""Largest number of pixels of the masks from which outlines are taken; larger masks are subsampled."""


@dataclass(frozen=True)
class _Recognised:
    """Points of frame 0 that were recognised in later frames."""

    frame: np.ndarray
    """(M,), ascending."""
    xy: np.ndarray
    """(M, 2) [px]."""
    ride: csr_matrix
    """(M, V): matrix from the vertices to the points."""

    @staticmethod
    def of(mesh: SheetMesh, sight: Sight) -> _Recognised:
        """The recognised points of `sight` that lie on the sheet in frame 0."""
        found = sight.recognised
        if found is None or not len(found.frame):
            return _Recognised(np.zeros(0, int), np.zeros((0, 2)), csr_matrix((0, len(mesh.x))))
        first, which = np.unique(found.first, axis=0, return_inverse=True)
        ride, which = _ride(mesh, _places(mesh, sight.camera, first, 0, mesh.x)), which.ravel()
        on = np.flatnonzero(np.diff(ride.indptr)[which])
        on = on[np.argsort(found.frame[on], kind="stable")]
        return _Recognised(found.frame[on], found.xy[on], ride[which[on]])

    def of_frame(self, frame: int) -> slice:
        """The slice of the points that were recognised in a frame."""
        return slice(*np.searchsorted(self.frame, [frame, frame + 1]))


class View:
    """One camera's view of the sheet in T+1 frames, and the cost of missing what it saw."""

    def __init__(self, mesh: SheetMesh, sight: Sight, masks: Masks | None = None) -> None:
        self.sight, self._mesh, self._masks = sight, mesh, masks
        self.places = np.full((sight.xy.shape[1], 2), np.nan)
        """(K, 2) places of the tracked points on the sheet laid flat [m], NaN where unknown."""
        self._ride = csr_matrix((len(self.places), len(mesh.x)))
        self._recognised = _Recognised.of(mesh, sight)
        self._outside: tuple[int, np.ndarray] = (-1, np.zeros((1, 1)))
        self._points: tuple[int, tuple[csr_matrix, np.ndarray, np.ndarray]] | None = None

    def place(self, frame: int, x: np.ndarray) -> None:
        """Place the tracks that are first visible in this frame on the sheet, whose vertices are at x (V, 3) [m]."""
        one, places = self.sight, self.places.copy()
        first = one.visible[frame] & ~one.visible[:frame].any(axis=0)
        begun = np.flatnonzero(first & np.isfinite(one.xy[frame]).all(axis=1))
        if begun.size:
            places[begun] = _places(self._mesh, one.camera, one.xy[frame, begun], frame, x)
            self.put(places)

    def put(self, places: np.ndarray) -> None:
        """Set the tracks' places (K, 2) on the sheet laid flat [m]."""
        self._ride, self.places, self._points = _ride(self._mesh, places), places, None

    def points(self, frame: int) -> tuple[csr_matrix, np.ndarray, np.ndarray]:
        """The tracks and recognised points that are visible in a frame: a matrix (M, V) from the vertices to them, where they are seen
        (M, 2) [px], and the standard deviation of that (M,) [px]. The last frame's are cached."""
        if self._points is None or self._points[0] != frame:
            self._points = (frame, self._points_of(frame))
        return self._points[1]

    def _points_of(self, frame: int) -> tuple[csr_matrix, np.ndarray, np.ndarray]:
        one = self.sight
        seen = np.flatnonzero(one.visible[frame] & np.isfinite(self.places[:, 0]) & np.isfinite(one.xy[frame]).all(axis=1))
        sigma = np.hypot(np.maximum(one.sigma[frame, seen], FINEST), np.where(one.visible[0, seen], 0.0, TIED))
        again = self._recognised.of_frame(frame)
        ride = vstack([self._ride[seen], self._recognised.ride[again]]).tocsr()
        xy = np.concatenate([one.xy[frame, seen], self._recognised.xy[again]])
        return ride, xy, np.concatenate([sigma, np.full(len(xy) - len(sigma), RECOGNISED)])

    def count(self, frame: int) -> int:
        """How many points are visible in a frame."""
        return len(self.points(frame)[1])

    def rays(self, frame: int, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The camera's centre (3,) [m] and the rays (M, 3), of unit depth, through the pixels xy (M, 2) of a frame."""
        centre = self.sight.camera.pose(frame)[:3, 3]
        return centre, self.sight.camera.unproject(xy, np.ones(len(xy)), frame) - centre

    def missed(self, frame: int, x: np.ndarray) -> np.ndarray:
        """Residuals (M,) of the tracks and recognised points that are visible in the frame [standard deviations]."""
        return self._tracks(frame, x)[0]

    def cost(self, frame: int, x: np.ndarray, scale: float) -> float:
        """The cost of vertices at x (V, 3) [m]; scale: residual from which a track is an outlier [standard deviations]."""
        missed, beyond, bare = self.missed(frame, x), self._beyond(frame, x)[0], np.linalg.norm(self._bare(frame, x)[0], axis=1)
        parts = ((scale, missed), (OUTLIER, beyond), (scale, bare))
        return 0.5 * sum(size**2 * float(np.log1p((one / size) ** 2).sum()) for size, one in parts)

    def linearise(self, frame: int, x: np.ndarray, scale: float) -> tuple[csr_matrix, np.ndarray]:
        """Gauss-Newton Hessian (3V, 3V) and gradient (3V,) of the cost."""
        missed, off, rows = self._tracks(frame, x)
        weights = np.repeat(1.0 / (1.0 + (missed / scale) ** 2), 2)
        beyond, slope = self._beyond(frame, x)
        firm = 1.0 / (1.0 + (beyond / OUTLIER) ** 2)
        hessian = rows.T @ rows.multiply(weights[:, None]).tocsr() + slope.T @ slope.multiply(firm[:, None]).tocsr()
        gradient = rows.T @ (weights * off) + slope.T @ (firm * beyond)
        short, pull = self._bare(frame, x)
        firm = np.repeat(1.0 / (1.0 + (np.linalg.norm(short, axis=1) / scale) ** 2), 2)
        return hessian + pull.T @ pull.multiply(firm[:, None]).tocsr(), gradient + pull.T @ (firm * short.ravel())

    def _tracks(self, frame: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, csr_matrix]:
        """Residuals of the M points used in a frame [standard deviations]: their lengths (M,), their x and y (2M,), and the derivative of
        these by the vertices (2M, 3V)."""
        ride, xy, sigma = self.points(frame)
        points = ride @ x
        off = (self.sight.camera.project(points, frame)[0] - xy) / sigma[:, None]
        slope = self.sight.camera.projection_jacobian(points, frame) / sigma[:, None, None]
        return np.linalg.norm(off, axis=1), off.ravel(), _spread(ride, slope)

    def _beyond(self, frame: int, x: np.ndarray) -> tuple[np.ndarray, csr_matrix]:
        """How far vertices lie outside the outline (B,) [standard deviations], and the derivative by the vertices (B, 3V); B = 0 without
        masks."""
        if self._masks is None:
            return np.zeros(0), csr_matrix((0, x.size))
        stride, away = self._distances(frame)
        xy = self.sight.camera.project(x, frame)[0]
        at = xy / stride
        height, width = away.shape
        inside = ((at > 1.0) & (at < [width - 2.0, height - 2.0])).all(axis=1)
        value = np.full(len(x), -1.0)
        value[inside] = ndimage.map_coordinates(away, at[inside].T[::-1], order=1)
        off = np.flatnonzero(value * stride > LEAVES)
        here = at[off].T[::-1]
        across = [ndimage.map_coordinates(away, here + 0.5 * np.eye(2)[i][:, None], order=1) for i in (1, 0)]
        back = [ndimage.map_coordinates(away, here - 0.5 * np.eye(2)[i][:, None], order=1) for i in (1, 0)]
        steep = np.stack([ahead - behind for ahead, behind in zip(across, back, strict=True)], axis=1)
        slope = np.einsum("bi,bij->bj", steep, self.sight.camera.projection_jacobian(x[off], frame)) / OUTLINE
        columns = 3 * off[:, None] + np.arange(3)
        spread = csr_matrix((slope.ravel(), (np.repeat(np.arange(len(off)), 3), columns.ravel())), (len(off), x.size))
        return (value[off] * stride - LEAVES) / OUTLINE, spread

    def _bare(self, frame: int, x: np.ndarray) -> tuple[np.ndarray, csr_matrix]:
        """By how much the sheet falls short of B points of the outline (B, 2) [standard deviations], and the derivative (2B, 3V); B = 0
        without masks."""
        if self._masks is None:
            return np.zeros((0, 2)), csr_matrix((0, x.size))
        stride, away = self._distances(frame)
        rim = self._rim(frame, stride)
        xy = self.sight.camera.project(x, frame)[0]
        covered = np.zeros(away.shape, np.uint8)
        corners = np.round(xy / stride).astype(np.int32)[self._mesh.faces]
        for corner in corners:
            cv2.fillConvexPoly(covered, corner, 1)
        bare = rim[covered[rim[:, 1], rim[:, 0]] == 0]
        edge = _outline_of(covered)
        if not bare.size or not edge.size:
            return np.zeros((0, 2)), csr_matrix((0, x.size))
        far, nearest = cKDTree(edge).query(bare)
        bare, nearest = bare[far * stride > BARE], nearest[far * stride > BARE]
        short = stride * (edge[nearest] - bare) / OUTLINE
        vertex = cKDTree(xy).query(stride * bare)[1]
        slope = self.sight.camera.projection_jacobian(x[vertex], frame) / OUTLINE
        each = np.arange(len(vertex))
        return short, _spread(csr_matrix((np.ones(len(vertex)), (each, vertex)), (len(vertex), len(x))), slope)

    def _rim(self, frame: int, stride: int) -> np.ndarray:
        """Points (B, 2) of the outline that are not at the frame's border, in pixels of the subsampled mask."""
        assert self._masks is not None
        mask = self._masks[frame][::stride, ::stride].astype(np.uint8)
        points = _outline_of(mask)[::RIM]
        height, width = mask.shape
        return points[((points > 1) & (points < [width - 2, height - 2])).all(axis=1)]

    def _distances(self, frame: int) -> tuple[int, np.ndarray]:
        """The stride at which masks are subsampled, and the distance (H', W') of every pixel from the subsampled mask, in its pixels. The
        last frame's are cached."""
        assert self._masks is not None
        stride = max(1, math.ceil(math.sqrt(self._masks.height * self._masks.width / OUTLINE_PIXELS)))
        if self._outside[0] != frame:
            mask = self._masks[frame][::stride, ::stride]
            away = ndimage.distance_transform_edt(~mask) if mask.any() else np.zeros(mask.shape)  # hidden: no outline to leave
            self._outside = (frame, away)
        return stride, self._outside[1]


def _outline_of(mask: np.ndarray) -> np.ndarray:
    """The pixels (B, 2), column and row, of the outer borders of a mask (H, W) uint8."""
    borders = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    return np.concatenate([np.zeros((0, 2), int), *(one[:, 0] for one in borders)])


def _places(mesh: SheetMesh, camera: Camera, xy: np.ndarray, frame: int, x: np.ndarray) -> np.ndarray:
    """Places (K, 2) on the sheet laid flat [m] of points xy (K, 2) [px] in a frame with the vertices at x (V, 3) [m]; NaN off the sheet."""
    return surface_points(x, mesh.faces, camera, xy, frame, np.column_stack([mesh.flat, np.zeros(len(x))]))[0][:, :2]


def _ride(mesh: SheetMesh, places: np.ndarray) -> csr_matrix:
    """Matrix (K, V) from the vertices to the points at `places` (K, 2) of the sheet laid flat [m]; rows of NaN places are empty."""
    known = np.flatnonzero(np.isfinite(places[:, 0]))
    riding = ride_flat(places[known], mesh.flat)
    rows = np.repeat(known, riding.index.shape[1])
    return csr_matrix((riding.weight.ravel(), (rows, riding.index.ravel())), (len(places), len(mesh.x)))


def _spread(ride: csr_matrix, slope: np.ndarray) -> csr_matrix:
    """Derivative (2M, 3V) of M pixels by the vertices, from `ride` (M, V) and the projection's `slope` (M, 2, 3)."""
    twice = ride.tocsr()[np.repeat(np.arange(ride.shape[0]), 2)]
    row = np.repeat(np.arange(twice.shape[0]), np.diff(twice.indptr))
    values = twice.data[:, None] * slope.reshape(-1, 3)[row]
    columns = 3 * twice.indices[:, None] + np.arange(3)
    return csr_matrix((values.ravel(), columns.ravel(), 3 * twice.indptr), (twice.shape[0], 3 * twice.shape[1]))
