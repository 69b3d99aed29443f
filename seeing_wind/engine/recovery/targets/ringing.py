"""The frames in which a held body swings without a force, found from its motion alone.

A body that nothing pushes swings in its own modes. With q (T+1, m) its displacement in the directions in which it moves most,

    q(t+1) + c q(t-1) = A q(t)      A (m, m) symmetric, c = exp(-2 zeta omega dt) a little below one

holds for a damped linear oscillator about the shape of frame 0, sampled once per frame. Where a force acts, the two sides differ by the
force's contribution to the acceleration. So A and c are fitted to each stretch of the clip, and the longest stretches with hardly any
remainder are kept: with gusts the remainder is 20 to 90 % of the acceleration, for a ringing post about 2 % (docs/notebook/held_bodies.md).

A steady swing at one frequency would fit as well, but a wind may cause it: only swings that die away count, and only over two or more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...records import PointTargets, TrackTargets

MOST_DIRECTIONS = 2
"""A post has two similar directions; further ones mostly describe how the body bends while it moves along these."""
BESIDE = 0.3
"""A direction counts if the motion along it is at least this share of the motion along the first."""
FEWEST_POINTS = 6
"""With fewer points that are seen in every frame, no frames are named."""
SHORTEST = 20
"""Shortest stretch [frames]: 18 equations per direction for at most four unknowns."""
FIRST = 2
"""Frames at the beginning in which a force is always assumed possible."""
SWINGS = 2.0
"""Fewest swings in a stretch: a shorter part looks like a slow gust."""
LEFT_OVER = 0.06
"""Largest remainder of a stretch relative to its acceleration, both root mean square; a post that swings far exceeds it without a force."""
LENGTHS = 200
"""Approximate number of lengths of stretches that are tried: the work grows with the square of a clip's length."""
IN_A_FRAME = 0.25
"""Largest remainder in any one frame, relative to the acceleration of the stretch, so that a short gust does not hide in a long stretch."""
DAMPED = (0.7, 0.997)
"""Range of c for a swing that dies away: at 30 frames and two swings per second, damping of at least 0.4 % of the critical one."""


def alone(views: Sequence[PointTargets | TrackTargets]) -> np.ndarray:
    """(T,) bool: the frames in which the body swings without a force according to all views that can show it. The first frames never
    count, as at least one frame must have a force."""
    told = [one for one in map(ringing, views) if one is not None]
    found = np.logical_and.reduce(told) if told else np.zeros(len(views[0].visible) - 1, bool)
    found[:FIRST] = False
    return found


def ringing(targets: PointTargets | TrackTargets) -> np.ndarray | None:
    """(T,) bool: the frames in which the body swings without a force, from the points seen in all T+1 frames; None if these, or the frames,
    are too few."""
    places = targets.x if isinstance(targets, PointTargets) else targets.xy
    frames = len(places) - 1
    taken = np.zeros(frames, bool)
    seen = targets.visible.all(axis=0)
    if seen.sum() < FEWEST_POINTS or frames < SHORTEST:
        return None
    q = _motion(places[:, seen])
    rows, acceleration = _equations(q)
    each = np.einsum("tmi,tmj->tij", rows, rows)
    sums, energy = (np.concatenate([np.zeros_like(one[:1]), one.cumsum(axis=0)]) for one in (each, (acceleration**2).sum(axis=1)))
    for length in range(frames - 1, SHORTEST - 2, -max(1, frames // LENGTHS)):
        begin = np.arange(frames - length)
        count = np.concatenate([[0], taken.cumsum()])
        free = count[begin + length + 1] == count[begin]
        normal, size = sums[begin + length] - sums[begin], energy[begin + length] - energy[begin]
        fitted = _fitted(normal)
        left = np.einsum("ki,kij,kj->k", fitted, normal, fitted)
        share = np.where(free & (size > 0.0), np.maximum(left, 0.0) / np.maximum(size, np.finfo(float).tiny), np.inf)
        best = int(np.argmin(share))
        stretch = slice(best, best + length)
        if share[best] < LEFT_OVER**2 and _dies_away(fitted[best], q.shape[1], length):
            missed = np.linalg.norm(rows[stretch] @ fitted[best], axis=1)
            if missed.max() < IN_A_FRAME * np.sqrt(size[best] / length):
                # The equation at frame t + 1 contains the forces of intervals t and t + 1.
                taken[best : best + length + 1] = True
    return taken


def _motion(places: np.ndarray) -> np.ndarray:
    """Displacements (T+1, m) of points (T+1, K, D) in the directions in which they move most."""
    away = (places.astype(np.float64) - places[0]).reshape(len(places), -1)
    left, size, _ = np.linalg.svd(away, full_matrices=False)
    count = max(1, int((size[:MOST_DIRECTIONS] > BESIDE * size[0]).sum()))
    motion: np.ndarray = left[:, :count] * size[:count]
    return motion


def _equations(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The equations of q (T+1, m) at each frame but the first and last.

    Returns rows (T-1, m, n), whose product with (entries of A on and above its diagonal, c, -1) is the remainder, and the second
    differences of q (T-1, m).
    """
    before, now, after = q[:-2], q[1:-1], q[2:]
    columns = []
    for i, j in zip(*np.triu_indices(q.shape[1])):
        column = np.zeros_like(now)
        column[:, i] = now[:, j]
        column[:, j] = now[:, i]
        columns.append(column)
    return np.stack([*columns, -before, after], axis=2), after - 2.0 * now + before


def _fitted(normal: np.ndarray) -> np.ndarray:
    """Least-squares solutions (k, n), each (entries of A, c, -1), of k normal equations (k, n, n)."""
    inner = normal[:, :-1, :-1]
    ridge = 1e-12 * np.einsum("kii->k", inner)[:, None, None] * np.eye(inner.shape[1]) + np.finfo(float).tiny * np.eye(inner.shape[1])
    found = np.linalg.solve(inner + ridge, normal[:, :-1, -1:])[..., 0]
    return np.concatenate([found, np.full((len(found), 1), -1.0)], axis=1)


def _dies_away(fitted: np.ndarray, directions: int, length: int) -> bool:
    """Whether `fitted`, (entries of A, c, -1), describes damped swings of which `length` frames show enough."""
    A = np.zeros((directions, directions))
    A[np.triu_indices(directions)] = fitted[:-2]
    A, c = A + np.triu(A, 1).T, float(fitted[-2])
    if not DAMPED[0] < c < DAMPED[1]:
        return False
    turn = np.linalg.eigvalsh(A) / (2.0 * np.sqrt(c))  # cosine of each swing's phase advance per frame
    return bool((np.abs(turn) < 1.0).all() and (np.arccos(turn) * length > 2.0 * np.pi * SWINGS).all())
