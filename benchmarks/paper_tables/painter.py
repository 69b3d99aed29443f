"""Frames of a triangle mesh: the painter's algorithm with OpenCV, supersampled, lit by a sun and a sky. No Blender is needed.

There are no cast shadows. Depth comes from the same triangles.
"""

from __future__ import annotations

import cv2
import numpy as np

from seeing_wind.engine.records import Camera

SUPERSAMPLE = 3
SUN = np.array([-0.45, -0.7, 0.55]) / np.linalg.norm([-0.45, -0.7, 0.55])
AMBIENT, DIFFUSE = 0.55, 0.5
_FINE = 16
"""Scale of the fixed-point corners that OpenCV takes, with four fractional bits."""


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """camera_to_world (4, 4) with OpenCV's axes, Z up."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = eye
    return pose


def paint(vertices: np.ndarray, triangles: np.ndarray, colours: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) [m], triangles (M, 3), colours (V, 3) -> premultiplied RGB (H, W, 3) and alpha (H, W), float32 in 0..1."""
    order, corners = _visible(vertices, triangles, camera, SUPERSAMPLE)
    face, shade = _normals(vertices, triangles), np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(shade, triangles[:, corner], face)
    shade /= np.maximum(np.linalg.norm(shade, axis=1, keepdims=True), 1e-12)
    light = AMBIENT * (0.8 + 0.2 * shade[:, 2]) + DIFFUSE * np.maximum(shade @ SUN, 0.0)
    lit = np.clip(colours * light[:, None], 0.0, 1.0)[triangles].mean(axis=1)
    canvas = np.zeros((camera.height * SUPERSAMPLE, camera.width * SUPERSAMPLE, 4), np.float32)
    for row, polygon in zip(order, corners, strict=True):
        r, g, b = (float(value) for value in lit[row])
        cv2.fillConvexPoly(canvas, polygon, (r, g, b, 1.0), shift=4)
    small = cv2.resize(canvas, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return small[..., :3], small[..., 3]


def depth_of(vertices: np.ndarray, triangles: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W) float32 metres along the view axis, infinite beside the mesh."""
    order, corners = _visible(vertices, triangles, camera, 1)
    local = camera.project(vertices, 0)[1][triangles].mean(axis=1)
    canvas = np.full((camera.height, camera.width), np.inf, np.float32)
    for row, polygon in zip(order, corners, strict=True):
        cv2.fillConvexPoly(canvas, polygon, float(local[row]), shift=4)
    return canvas


def backdrop(camera: Camera) -> np.ndarray:
    """(H, W, 3) float32: a pale wall, lighter at the top, with soft mottling."""
    random = np.random.default_rng(camera.width)
    noise = cv2.GaussianBlur(random.normal(size=(camera.height, camera.width)).astype(np.float32), (0, 0), 14.0)
    ramp = np.linspace(0.86, 0.74, camera.height, dtype=np.float32)[:, None] + 0.35 * noise
    return np.clip(ramp[..., None] * np.array([0.98, 1.0, 1.02], np.float32), 0.0, 1.0)


def over(colour: np.ndarray, alpha: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """Premultiplied colour over a background -> (H, W, 3) uint8."""
    return np.round(255.0 * np.clip(colour + (1.0 - alpha[..., None]) * behind, 0.0, 1.0)).astype(np.uint8)


def _normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def _visible(vertices: np.ndarray, triangles: np.ndarray, camera: Camera, scale: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles that face the camera, farthest first (M,), and their corners in fixed point (M, 3, 2) int32 `scale` times finer."""
    towards = camera.pose(0)[:3, 3] - vertices[triangles].mean(axis=1)
    front = np.flatnonzero((_normals(vertices, triangles) * towards).sum(axis=1) > 0.0)
    pixels, depth = camera.project(vertices, 0)
    order = front[np.argsort(-depth[triangles[front]].mean(axis=1))]
    # Pixel centres are at integers on both canvases.
    fine = (pixels[triangles[order]] + 0.5) * scale - 0.5
    return order, np.round(fine * _FINE).astype(np.int32)
