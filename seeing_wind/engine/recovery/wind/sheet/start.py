"""A first wind for a sheet: the steady, uniform one that best explains what a simulation without air is off.

Each mode of what is off is taken for a free mass on the pull of `following`, y'' + 2 w y' + w² y = a, whose acceleration a is the drag's
along the normals of the sheet as it was seen. That leaves tension out, which is of no harm to a start.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from .following import Follower
from .problem import SheetProblem

SPEEDS = (1.0, 3.0, 8.0)
"""m/s tried in each of 26 directions."""
BEST = 3
"""Of these, how many are refined, and"""
KEPT = 2
"""how many different ones come back."""
APART = 0.2
"""Winds that differ by less than this part of their speed are the same."""


def first_winds(problem: SheetProblem, without: np.ndarray) -> list[np.ndarray]:
    """The most probable steady winds (3,) [m/s], best first; without: (T, D) [m] what is off in no air."""
    follower, frames = problem.follower, len(problem.hats)
    seen = [follower.seen.at(t + 0.5) for t in range(frames)]
    share = _memory(follower, frames)
    mass = follower.shell.mass[:, None]

    def missed(wind: np.ndarray) -> np.ndarray:
        field = np.broadcast_to(wind, mass.shape[:1] + (3,))
        pushed = [problem.seen((follower.cause.force(field, x, v) / mass)[..., None], t)[:, 0] for t, (x, v) in enumerate(seen)]
        return ((without + share @ np.stack(pushed)) / problem.sigma).ravel()

    ways = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) != (0, 0, 0)], float)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    trials = [speed * way for speed in SPEEDS for way in ways]
    costs = [float((missed(one) ** 2).sum()) for one in trials]
    fits = [least_squares(missed, trials[i], max_nfev=10) for i in np.argsort(costs)[:BEST]]
    found: list[np.ndarray] = []
    for fit in sorted(fits, key=lambda one: one.cost):
        if all(np.linalg.norm(fit.x - one) > APART * np.linalg.norm(one) for one in found):
            found.append(fit.x)
    return found[:KEPT]


def _memory(follower: Follower, frames: int) -> np.ndarray:
    """(T, T) what an acceleration of 1 m/s² during each frame puts a mass off at the end of every frame [m]."""
    w = follower.pull
    late = np.maximum(np.subtract.outer(np.arange(1, frames + 1), np.arange(frames)), 0) / follower.seen.fps

    def until(time: np.ndarray) -> np.ndarray:
        return (1.0 - (1.0 + w * time) * np.exp(-w * time)) / w**2

    return until(late) - until(np.maximum(late - 1.0 / follower.seen.fps, 0.0))
