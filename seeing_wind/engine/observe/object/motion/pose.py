"""The pose of the whole body in every frame, from its silhouette and the tracks tied to it so far, in order to place later tracks on it.

A few nodes on the body's surface move as rigidly as possible (as in `lifting`). They are pulled by tracked points that ride on them, by
the outline of the mask, and, where both give little information, towards the rigid continuation of the body's motion: while a sheet is
seen edge-on, nothing else is known about it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ....masks import at_pixels
from ....records import Camera
from .control import attach
from .lifting import EDGE_SIGMA, best_rotations, neighbour_edges, rigidity

NODES = 80
NEIGHBOURS = 12
"""Nodes that carry a surface point."""
ITERATIONS = 8
FEW, CERTAIN = 40, 2.0
"""With at least FEW tracks whose sigma is below CERTAIN [px], the outline is not used: the body's far side is guessed, so its outline may
differ from the true one."""
OUTLINE_POINTS = 120
OUTLINE_SIGMA = 1.5
"""Standard deviation of a point of the mask's outline [px]: masks are off by a pixel, and lack a corner now and then."""
OUTLINE_REACH = 20.0
"""Distance [px] up to which points of the outline and the body are matched."""
HUBER = 2.0
STEADINESS = 0.05
"""Standard deviation of the body from the rigid continuation of its motion in a frame, in units of its radius."""
HELD_STILL = 0.05
"""Standard deviation of a held point from its place, in units of the distance between nodes."""
LEAST_SIGMA = 0.5
"""Least standard deviation of a track [px]: ties are not more accurate."""


HIDDEN, EDGE_ON = 0.1, 0.35
"""Where a smaller fraction of frame 0's points than HIDDEN is seen, and the cosine between front and view is less than EDGE_ON, the front
may face away."""


@dataclass
class _Pull:
    """M points that ride on the N nodes, and where they should be in the frame."""

    weight: np.ndarray
    """(M, N), of the nodes in each point."""
    target: np.ndarray
    """(M, 2) [px]."""
    direction: np.ndarray
    """(M, 2) unit vectors along which alone the residual counts, or zero where all of it does."""
    sigma: np.ndarray
    """(M,) [px]."""


class BodyPose:
    """The body's surface from frame to frame.

    Attributes:
        vertices: (V, 3) [m] in the newest frame.
        nodes: N, the number of nodes that move it.
    """

    def __init__(self, rest: np.ndarray, camera: Camera, early: np.ndarray, held: np.ndarray) -> None:
        """`rest` (V, 3): the surface's vertices in frame 0 [m]; `early` (M, 3): the points on it that are tracked in frame 0 [m]; `held`
        (V,) bool: vertices that stay where they are."""
        self.rest, self.camera = rest, camera
        self._early = len(early)
        self._front = _normal(early, early.mean(axis=0) - camera.pose(0)[:3, 3]) if len(early) > 2 else np.zeros(3)
        self.vertices = rest
        chosen = spread(rest, min(NODES, len(rest)))
        self._nodes = rest[chosen]
        self.nodes = len(chosen)
        self._edges = neighbour_edges(self._nodes)
        lengths = np.linalg.norm(self._nodes[self._edges] - self._nodes[:, None], axis=-1)
        self._edge = float(np.median(lengths))
        self._radius = float(np.sqrt(((rest - rest.mean(axis=0)) ** 2).sum(axis=1).mean()))
        self._weight = self.weights(rest)
        self._held, self._place = self._weight[held], rest[held]
        self._now, self._before = self._nodes, self._nodes

    def weights(self, points: np.ndarray) -> np.ndarray:
        """Weights (K, N) with which points (K, 3) in frame 0 [m] ride on the nodes."""
        return attach(points, self._nodes, NEIGHBOURS).matrix(len(self._nodes))

    def advance(self, frame: int, weight: np.ndarray, xy: np.ndarray, sigma: np.ndarray, mask: np.ndarray) -> None:
        """Move the body to frame `frame`.

        Args:
            weight: (M, N) `weights` of the tracked points that are seen there; xy: (M, 2) [px]; sigma: (M,) [px].
            mask: (H, W) bool, the object.
        """
        tracks = _Pull(weight, xy, np.zeros_like(xy), np.maximum(sigma, LEAST_SIGMA))
        points = self._fit(moved_on(self._before, self._now, self._now), frame, tracks, mask)
        before = self._now
        if (sigma < CERTAIN).sum() < HIDDEN * self._early:
            through = self._through_the_edge(points, frame)
            if through is not None:
                points = self._fit(through, frame, tracks, mask)
                before = moved_on(self._now, self._before, points)
        self._before, self._now = before, points
        self.vertices = self._weight @ points

    def _through_the_edge(self, points: np.ndarray, frame: int) -> np.ndarray | None:
        """The nodes (N, 3) of the body turned so that its back faces the camera with nearly the same outline, if it is seen nearly edge-on
        with its front to the camera; else None.

        A sheet's outline cannot tell the two poses apart. But if no points of its front are seen any more, the back faces the camera.
        """
        u, _, vt = np.linalg.svd((points - points.mean(axis=0)).T @ (self._nodes - self._nodes.mean(axis=0)))
        front = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt @ self._front
        view = points.mean(axis=0) - self.camera.pose(frame)[:3, 3]
        cosine = -float(front @ view) / float(np.linalg.norm(view))
        if not 0.0 < cosine < EDGE_ON:
            return None
        axis = np.cross(front, view)
        turn = Rotation.from_rotvec(-2.0 * np.arcsin(cosine) * axis / np.linalg.norm(axis)).as_matrix()
        if (turn @ front) @ view < 0.0:
            turn = turn.T
        return (points - points.mean(axis=0)) @ turn.T + points.mean(axis=0)

    def _fit(self, ahead: np.ndarray, frame: int, tracks: _Pull, mask: np.ndarray) -> np.ndarray:
        """The nodes (N, 3) in frame `frame` [m], starting from the expected ones `ahead` (N, 3)."""
        points = ahead
        for _ in range(ITERATIONS):
            pulls = [tracks]
            if (tracks.sigma < CERTAIN).sum() < FEW and mask.any():
                pulls += self._outline(points, frame, mask)
            step = self._step(points, ahead, pulls, frame)
            points = points + step
            if np.abs(step).max() < 1e-3 * self._edge:
                break
        return points

    def _step(self, points: np.ndarray, ahead: np.ndarray, pulls: list[_Pull], frame: int) -> np.ndarray:
        count = len(points)
        hessian, gradient = np.zeros((count, 3, count, 3)), np.zeros((count, 3))
        rotation = best_rotations(self._nodes, points, self._edges)
        turned = np.matmul(self._nodes[self._edges] - self._nodes[:, None], rotation.transpose(0, 2, 1))
        rigidity(points, self._edges, turned, EDGE_SIGMA * self._edge, hessian, gradient)
        flat, slope = hessian.reshape(3 * count, 3 * count), gradient.reshape(-1)
        if len(self._held):
            still = 1.0 / (HELD_STILL * self._edge) ** 2
            flat += np.kron(still * self._held.T @ self._held, np.eye(3))
            slope += still * (self._held.T @ (self._held @ points - self._place)).reshape(-1)
        for pull in pulls:
            if not len(pull.target):
                continue
            place = pull.weight @ points
            projected, depth = self.camera.project(place, frame)
            jacobian = self.camera.projection_jacobian(place, frame)
            residual = projected - pull.target
            along = (pull.direction != 0.0).any(axis=1)
            across = pull.direction[:, :, None] * pull.direction[:, None, :]
            pick = np.where(along[:, None, None], across, np.eye(2))
            residual = np.matmul(pick, residual[..., None])[..., 0] / pull.sigma[:, None]
            jacobian = np.matmul(pick, jacobian) / pull.sigma[:, None, None]
            root = np.sqrt(np.minimum(1.0, HUBER / np.maximum(np.linalg.norm(residual, axis=1), 1e-12)) * (depth > 0.0))
            rows = np.einsum("m,mpc,mn->mpnc", root, jacobian, pull.weight).reshape(-1, 3 * count)
            flat += rows.T @ rows
            slope += rows.T @ (root[:, None] * residual).reshape(-1)
        trust = 1.0 / (STEADINESS * self._radius) ** 2 / count
        flat[np.diag_indices(3 * count)] += trust
        slope += trust * (points - ahead).reshape(-1)
        return -np.linalg.solve(flat, slope).reshape(count, 3)

    def _outline(self, points: np.ndarray, frame: int, mask: np.ndarray) -> list[_Pull]:
        """The pulls of the mask's outline: on the surface points nearest to it, and on surface points outside the mask."""
        seen = self.camera.project(self._weight @ points, frame)[0]
        contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        outline = np.concatenate([contour[:, 0] for contour in contours]).astype(np.float64)
        height, width = mask.shape
        inner = (outline > 1).all(axis=1) & (outline[:, 0] < width - 2) & (outline[:, 1] < height - 2)
        outline = outline[inner]
        if not len(outline):
            return []
        few = outline[:: max(1, len(outline) // OUTLINE_POINTS)]
        inside = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 2.0)
        gradient = np.stack([cv2.Sobel(inside, cv2.CV_32F, 1, 0), cv2.Sobel(inside, cv2.CV_32F, 0, 1)], axis=-1)

        def normal(at: np.ndarray) -> np.ndarray:
            column, row = np.round(at).astype(int).T
            direction = gradient[row, column].astype(np.float64)
            return direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-6)

        distance, near = cKDTree(seen).query(few)
        use = distance < OUTLINE_REACH
        pulls = [_Pull(self._weight[near[use]], few[use], normal(few[use]), np.full(int(use.sum()), OUTLINE_SIGMA))]
        out = at_pixels(~mask, seen)
        if out.any():
            target = outline[cKDTree(outline).query(seen[out])[1]]
            pulls.append(_Pull(self._weight[out], target, normal(target), np.full(int(out.sum()), OUTLINE_SIGMA)))
        return pulls


def _normal(points: np.ndarray, view: np.ndarray) -> np.ndarray:
    """The unit normal (3,) of the plane through points (M, 3), pointing against the direction `view` (3,)."""
    normal = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2]
    return -np.sign(normal @ view) * normal


def spread(points: np.ndarray, count: int) -> np.ndarray:
    """Indices of `count` of the points (V, 3), each as far as possible from those chosen before it."""
    chosen = [int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def moved_on(before: np.ndarray, now: np.ndarray, points: np.ndarray) -> np.ndarray:
    """`points` (N, 3) after the best rigid motion from `before` to `now`, both (M, 3); they are rotated about their own centroid."""
    u, _, vt = np.linalg.svd((now - now.mean(axis=0)).T @ (before - before.mean(axis=0)))
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    middle = points.mean(axis=0)
    return (points - middle) @ turn.T + middle + now.mean(axis=0) - before.mean(axis=0)
