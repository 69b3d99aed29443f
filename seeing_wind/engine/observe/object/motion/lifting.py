"""Key points from pixels to 3D: P^0 by unprojection, then frame by frame by least reprojection error and as-rigid-as-possible motion.

Paper, section 3.4: P^0 = pi^-1(p^0, d) (Eq. (10)), then min |pi(P^{t+1}) - p^{t+1}| + lambda L_arap (Eq. (11)). The paper's L_arap compares
difference vectors of neighbours (Eq. (12)), so a rotation out of the frame plane costs as much as a deformation and turns into false
depth. Here they are compared with *rotated* difference vectors of an earlier frame (Sorkine and Alexa, As-rigid-as-possible surface
modeling, 2007), and the rotation of every neighbourhood is found along with the points.

The result serves as a starting point and for display; forces are fitted to the pixels themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ....errors import ObjectError
from ....progress import Journal, NoProgress, Progress
from ....records import Camera, Recognised

NEIGHBOURS = 8
EDGE_SIGMA = 0.07
"""Standard deviation of the change of an edge, in units of the median edge."""
HUBER = 2.0
"""Reprojection residuals beyond this many sigmas count linearly."""
PREDICTION_SIGMA = 1.0
"""Standard deviation of the straight continuation of the motion, in units of the body's radius: it decides only what nothing else does."""
ACROSS_TRUST = 1e-6
"""Precision of the continuation across the view, relative to that along it."""
MAX_ITERATIONS = 8
TOLERANCE = 1e-4
"""Iterations end when no coordinate of a point changes by more than this, in units of the median edge."""


@dataclass(frozen=True)
class Sight:
    """What one camera saw of all K points; a point that only another view tracks is not visible here."""

    camera: Camera
    xy: np.ndarray
    """(T+1, K, 2) [px]."""
    visible: np.ndarray
    """(T+1, K) bool."""
    sigma: np.ndarray
    """(T+1, K) [px]."""
    recognised: Recognised | None = None
    """Points of frame 0 that were found in later frames by what they look like."""


def lift(
    sights: Sequence[Sight],
    start: np.ndarray,
    pinned: np.ndarray | None = None,
    flows: bool = False,
    progress: Progress = NoProgress(),
    journal: Journal = Journal(),
) -> np.ndarray:
    """Lift the tracks of all cameras together: a point that one camera does not see is held by rigidity to neighbours that another sees.

    Args:
        sights: one per camera, over the same frames and points.
        start: (K, 3) P^0 [m].
        pinned: (K,) bool, points that stay where they are.
        flows: the body does not return to its shape in frame 0, so edges are compared with those of the frame before.

    Returns:
        (T+1, K, 3) [m], NaN for a point that is seen in no frame. Where a point is hidden, its neighbours carry it.

    Raises:
        ObjectError: shapes that do not match, or a start that is not finite.
    """
    frames = len(sights[0].xy)
    for one in sights:
        xy, visible, sigma = one.xy, one.visible, one.sigma
        if xy.shape[:2] != visible.shape or sigma.shape != visible.shape or start.shape != (xy.shape[1], 3) or len(xy) != frames:
            raise ObjectError(
                f"Tracks {xy.shape}, visibility {visible.shape} and start {start.shape} do not belong together.", "Check the tracks file."
            )
    visible = np.any([one.visible for one in sights], axis=0)
    lifted = np.full((*visible.shape, 3), np.nan)
    use = np.flatnonzero(visible.any(axis=0))
    if use.size == 0:
        return lifted
    if not np.isfinite(start[use]).all():
        raise ObjectError("A tracked point has no depth in the first frame.", "Check the depth map.")
    held = np.zeros(use.size, dtype=bool) if pinned is None else pinned[use]
    points = np.empty((frames, use.size, 3))
    points[0] = start[use]
    edges = neighbour_edges(points[0])
    loop = journal.loop("lift")
    done, kept = loop.resume()
    if done:
        points[: done + 1] = kept["points"]

    def state() -> dict[str, np.ndarray]:
        return {"points": points[: done + 1]}

    for t in range(done + 1, frames):
        progress.check()
        ahead = points[t - 1] if t == 1 else 2.0 * points[t - 1] - points[t - 2]
        views = []
        for one in sights:
            seen = np.flatnonzero(one.visible[t, use] & np.isfinite(one.xy[t, use]).all(axis=1))
            views.append(_View(one.camera, seen, one.xy[t, use[seen]], np.maximum(one.sigma[t, use[seen]], 1e-3)))
        points[t] = _Frame(views, t, edges, points[0], points[t - 1] if flows else points[0], held).solve(ahead)
        done = t
        loop.reached(done, state)
    lifted[:, use] = points
    return lifted


def neighbour_edges(points: np.ndarray) -> np.ndarray:
    """Indices (K, J) of the nearest neighbours of every point (K, 3); J = `NEIGHBOURS`, or all others if there are fewer."""
    count = min(NEIGHBOURS, len(points) - 1)
    if count < 1:
        return np.empty((len(points), 0), dtype=int)
    return cKDTree(points).query(points, k=count + 1)[1][:, 1:]


@dataclass(frozen=True)
class _View:
    """One camera's pixels in one frame: indices `seen` (M,) of the points, their places `xy` (M, 2) [px] and `sigma` (M,) [px]."""

    camera: Camera
    seen: np.ndarray
    xy: np.ndarray
    sigma: np.ndarray


class _Frame:
    """The least-squares problem of one frame, solved by Gauss-Newton with the neighbourhoods' rotations eliminated point by point."""

    def __init__(
        self, views: Sequence[_View], frame: int, edges: np.ndarray, rest: np.ndarray, before: np.ndarray, held: np.ndarray
    ) -> None:
        """`edges` (K, J): see `neighbour_edges`; `rest` (K, 3): the points in frame 0 [m]; `before` (K, 3): the points in the frame whose
        edges are the reference [m]; `held` (K,) bool."""
        self.views, self.frame = views, frame
        self.edges, self.rest, self.before, self.held = edges, rest, before, held
        lengths = np.linalg.norm(rest[edges] - rest[:, None], axis=-1)
        self.radius = max(float(np.sqrt(((rest - rest.mean(axis=0)) ** 2).sum(axis=1).mean())), 1e-9)
        self.edge = float(np.median(lengths)) if lengths.size and np.median(lengths) > 0.0 else self.radius
        if len(rest) == 1:
            self.radius = self.edge = 0.01 * float(np.linalg.norm(rest[0] - views[0].camera.pose(0)[:3, 3]))

    def solve(self, ahead: np.ndarray) -> np.ndarray:
        """Points (K, 3) [m] of this frame, starting from their prediction `ahead` (K, 3) [m]."""
        points = np.where(self.held[:, None], self.rest, ahead)
        for _ in range(MAX_ITERATIONS):
            step = self._step(points, ahead)
            points = points + step
            if np.abs(step).max() < TOLERANCE * self.edge:
                break
        return points

    def _step(self, points: np.ndarray, ahead: np.ndarray) -> np.ndarray:
        """One Gauss-Newton step (K, 3)."""
        count = len(points)
        hessian = np.zeros((count, 3, count, 3))
        gradient = np.zeros((count, 3))
        everyone = np.arange(count)
        self._reprojection(points, hessian, gradient)
        if self.edges.shape[1]:
            rotation = best_rotations(self.before, points, self.edges)
            turned = np.matmul(self.before[self.edges] - self.before[:, None], rotation.transpose(0, 2, 1))  # (K, J, 3)
            rigidity(points, self.edges, turned, EDGE_SIGMA * self.edge, hessian, gradient)
        # Across the view, pixels and neighbours are better than the prediction; there it only keeps the system regular.
        axes = self.views[0].camera.pose(self.frame)[:3, :3]
        along = 1.0 if len(self.views) == 1 else ACROSS_TRUST  # further cameras see motion along the first one's view
        trust = axes @ np.diag([ACROSS_TRUST, ACROSS_TRUST, along]) @ axes.T / (PREDICTION_SIGMA * self.radius) ** 2
        hessian[everyone, :, everyone, :] += trust
        gradient += (points - ahead) @ trust
        free = np.repeat(~self.held, 3)
        step = np.zeros(3 * count)
        matrix = hessian.reshape(3 * count, 3 * count)[np.ix_(free, free)]
        if free.any():
            step[free] = -np.linalg.solve(matrix, gradient.ravel()[free])
        return step.reshape(count, 3)

    def _reprojection(self, points: np.ndarray, hessian: np.ndarray, gradient: np.ndarray) -> None:
        """Add the pixel residuals, with Huber's loss by reweighting."""
        for view in self.views:
            seen = view.seen
            projected, _ = view.camera.project(points[seen], self.frame)
            jacobian = view.camera.projection_jacobian(points[seen], self.frame) / view.sigma[:, None, None]
            residual = (projected - view.xy) / view.sigma[:, None]
            size = np.linalg.norm(residual, axis=1)
            weight = np.minimum(1.0, HUBER / np.maximum(size, 1e-12))
            weighted = jacobian * weight[:, None, None]
            hessian[seen, :, seen, :] += np.matmul(weighted.transpose(0, 2, 1), jacobian)
            gradient[seen] += np.matmul(weighted.transpose(0, 2, 1), residual[..., None])[..., 0]


def rigidity(
    points: np.ndarray,
    edges: np.ndarray,
    turned: np.ndarray,
    sigma: float,
    hessian: np.ndarray,
    gradient: np.ndarray,
) -> None:
    """Add the residuals (P_j - P_i) - R_i (Q_j - Q_i) to a least-squares problem, without the part that a small rotation of neighbourhood i
    removes.

    Args:
        points: (K, 3) P [m]; edges: (K, J) indices of neighbours j of i; turned: (K, J, 3) R_i (Q_j - Q_i) [m].
        sigma: standard deviation of the change of an edge [m].
        hessian: (K, 3, K, 3), and gradient: (K, 3); both are added to.
    """
    count, fan = edges.shape
    residual = points[edges] - points[:, None] - turned
    inverse = 1.0 / sigma**2
    turn = _cross_matrices(turned).reshape(count, 3 * fan, 3)
    inner = np.matmul(turn.transpose(0, 2, 1), turn)
    inner = inner + 1e-9 * np.trace(inner, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-300 * np.eye(3)
    project = np.broadcast_to(np.eye(3 * fan), (count, 3 * fan, 3 * fan)) * inverse
    project = project - inverse * np.matmul(turn, np.linalg.solve(inner, turn.transpose(0, 2, 1)))
    # d residual_j = dP_j - dP_i: the (3J x 3J) block acts on all points of the fan, the centre last with the negative sum.
    to_points = np.zeros((3 * fan, 3 * (fan + 1)))
    to_points[:, : 3 * fan] = np.eye(3 * fan)
    to_points[:, 3 * fan :] = -np.tile(np.eye(3), (fan, 1))
    block = np.matmul(to_points.T, np.matmul(project, to_points))
    slope = np.matmul(to_points.T, np.matmul(project, residual.reshape(count, -1, 1)))[..., 0]
    node = np.concatenate([edges, np.arange(count)[:, None]], axis=1)
    row = (3 * node[:, :, None] + np.arange(3)).reshape(count, -1)
    flat = (row[:, :, None] * (3 * count) + row[:, None, :]).ravel()
    hessian += np.bincount(flat, block.ravel(), minlength=(3 * count) ** 2).reshape(hessian.shape)
    gradient += np.bincount(row.ravel(), slope.ravel(), minlength=3 * count).reshape(gradient.shape)


def best_rotations(rest: np.ndarray, points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """The best rotation (K, 3, 3) of every neighbourhood from `rest` to `points`, both (K, 3): Kabsch's on its edges."""
    if edges.shape[1] == 0:
        return np.broadcast_to(np.eye(3), (len(points), 3, 3)).copy()
    before, after = rest[edges] - rest[:, None], points[edges] - points[:, None]
    u, _, vt = np.linalg.svd(np.matmul(after.transpose(0, 2, 1), before))
    u[:, :, 2] *= np.sign(np.linalg.det(np.matmul(u, vt)))[:, None]
    return np.matmul(u, vt)


def _cross_matrices(vectors: np.ndarray) -> np.ndarray:
    """Matrices (..., 3, 3) with matrix @ w = vector x w, for `vectors` (..., 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2)
