"""When a held body swings by itself, told by its motion alone.

What nothing pushes swings in its own modes. With q (T+1, m) how far the body is along the directions in which it moves most,

    q(t+1) + c q(t-1) = A q(t)      A (m, m) symmetric, c = exp(-2 zeta omega dt) a little below one

holds for a damped linear oscillator about the shape of frame 0, sampled once a frame. Where a force acts, the two sides differ by the
force's share of the acceleration. So A and c are fitted to every stretch of the clip, and the longest stretches are kept in which hardly
anything is left over: gusts leave 20 to 90 % of the acceleration, a post that rings about 2 % (docs/notebook/held_bodies.md).

A steady swing at one frequency would fit as well, and may be a wind's: only what dies away counts, and only over two swings or more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...records import PointTargets, TrackTargets

MOST_DIRECTIONS = 2
"""A post has two that are alike; further ones are mostly how the body bends on its way along these."""
BESIDE = 0.3
"""A direction counts from this share of the motion along the first one."""
FEWEST_POINTS = 6
"""Seen in every frame, or nothing is said."""
SHORTEST = 20
"""Frames of a stretch at least: 18 equations a direction for at most four unknowns."""
FIRST = 2
"""Frames at the beginning in which a force is always looked for."""
SWINGS = 2.0
"""That a stretch must last: less of a swing looks like a slow gust."""
LEFT_OVER = 0.06
"""Most that may be left over, as a share of the acceleration, both root mean square; of a post that swings far it is more than that."""
LENGTHS = 200
"""Different lengths of stretches that are tried, about: the work grows with the square of a clip's length."""
IN_A_FRAME = 0.25
"""Most that may be left over in any frame, as a share of the acceleration in all: a short gust shall not hide in a long stretch."""
DAMPED = (0.7, 0.997)
"""Values of c of a swing that dies away: at 30 frames and two swings a second, damping of 0.4 % of the critical one and more."""


def alone(views: Sequence[PointTargets | TrackTargets]) -> np.ndarray:
    """(T,) bool: the frames in which the body swings by itself in all views that say anything of it. The first frames never count, as one
    at least must have a force."""
    told = [one for one in map(ringing, views) if one is not None]
    found = np.logical_and.reduce(told) if told else np.zeros(len(views[0].visible) - 1, bool)
    found[:FIRST] = False
    return found


def ringing(targets: PointTargets | TrackTargets) -> np.ndarray | None:
    """(T,) bool: the frames in which the body swings by itself, by the points that are seen in all T+1 frames; None for too few."""
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
                # The equation about frame t + 1 has the forces of frames t and t + 1.
                taken[best : best + length + 1] = True
    return taken


def _motion(places: np.ndarray) -> np.ndarray:
    """How far the points (T+1, K, D) are along the directions in which they move most, (T+1, m)."""
    away = (places.astype(np.float64) - places[0]).reshape(len(places), -1)
    left, size, _ = np.linalg.svd(away, full_matrices=False)
    count = max(1, int((size[:MOST_DIRECTIONS] > BESIDE * size[0]).sum()))
    motion: np.ndarray = left[:, :count] * size[:count]
    return motion


def _equations(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of q (T+1, m): (T-1, m, n) whose product with (entries of A, c, -1) is left over about each frame but the ends, and (T-1, m)
    second differences. A's entries are those on and above its diagonal."""
    before, now, after = q[:-2], q[1:-1], q[2:]
    columns = []
    for i, j in zip(*np.triu_indices(q.shape[1])):
        column = np.zeros_like(now)
        column[:, i] = now[:, j]
        column[:, j] = now[:, i]
        columns.append(column)
    return np.stack([*columns, -before, after], axis=2), after - 2.0 * now + before


def _fitted(normal: np.ndarray) -> np.ndarray:
    """(k, n) least squares solutions (entries of A, c, -1) of the normal equations (k, n, n)."""
    inner = normal[:, :-1, :-1]
    ridge = 1e-12 * np.einsum("kii->k", inner)[:, None, None] * np.eye(inner.shape[1]) + np.finfo(float).tiny * np.eye(inner.shape[1])
    found = np.linalg.solve(inner + ridge, normal[:, :-1, -1:])[..., 0]
    return np.concatenate([found, np.full((len(found), 1), -1.0)], axis=1)


def _dies_away(fitted: np.ndarray, directions: int, length: int) -> bool:
    """Whether (entries of A, c, -1) are those of swings that lose energy, and that `length` frames show enough of."""
    A = np.zeros((directions, directions))
    A[np.triu_indices(directions)] = fitted[:-2]
    A, c = A + np.triu(A, 1).T, float(fitted[-2])
    if not DAMPED[0] < c < DAMPED[1]:
        return False
    turn = np.linalg.eigvalsh(A) / (2.0 * np.sqrt(c))  # the cosine of each swing's phase in a frame
    return bool((np.abs(turn) < 1.0).all() and (np.arccos(turn) * length > 2.0 * np.pi * SWINGS).all())
