"""Flat shapes given by their outlines: which points are inside, and a triangle mesh."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, cKDTree


def inside(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which points (N, 2) lie inside the closed polygon (P, 2): (N,) bool, by the crossing rule."""
    a, b = outline, np.roll(outline, -1, axis=0)
    u, v = points[:, :1], points[:, 1:]
    crosses = (a[:, 1] > v) != (b[:, 1] > v)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    at = a[:, 0] + (v - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
    return (crosses & (u < at)).sum(1) % 2 == 1


def inside_any(outlines: list[np.ndarray], points: np.ndarray) -> np.ndarray:
    """Which points (N, 2) lie inside at least one of the polygons: (N,) bool."""
    return np.any([inside(outline, points) for outline in outlines], axis=0)


def flat_mesh(outlines: list[np.ndarray], edge: float) -> tuple[np.ndarray, np.ndarray]:
    """Triangles with edges of about `edge` over the union of polygons (P, 2): vertices (V, 2), triangles (M, 3) int32."""
    every = np.concatenate(outlines)
    low, high = every.min(0), every.max(0)
    rows = []
    for k, v in enumerate(np.arange(low[1], high[1], edge * np.sqrt(0.75))):
        u = np.arange(low[0] + (k % 2) * edge / 2, high[0], edge)
        rows.append(np.stack([u, np.full(len(u), v)], 1))
    grid = np.concatenate(rows)
    border = np.concatenate([_resample(outline, edge) for outline in outlines])
    grid = grid[inside_any(outlines, grid) & (cKDTree(border).query(grid)[0] > 0.55 * edge)]
    vertices = np.concatenate([border, grid])
    triangles = Delaunay(vertices).simplices
    triangles = triangles[inside_any(outlines, vertices[triangles].mean(1))]
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    triangles = np.where((area > 0)[:, None], triangles, triangles[:, ::-1])[np.abs(area) > 1e-10]
    used = np.unique(triangles)
    renumbered = np.full(len(vertices), -1)
    renumbered[used] = np.arange(len(used))
    return vertices[used], renumbered[triangles].astype(np.int32)


def _resample(outline: np.ndarray, edge: float) -> np.ndarray:
    """Points about `edge` apart along the polygon, corners of the teeth kept as far as that allows."""
    closed = np.concatenate([outline, outline[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], max(int(length[-1] / (0.6 * edge)), 12), endpoint=False)
    return np.stack([np.interp(at, length, closed[:, c]) for c in range(2)], 1)
