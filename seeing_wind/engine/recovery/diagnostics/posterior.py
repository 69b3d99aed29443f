"""How well the force is known: the posterior covariance of the solve, which comes free with it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

from ...records import PointTargets
from ..prior.basis import runs_of
from ..solve.forward import Forward

USUAL = 4.0
"""What is missed in a frame is not noise when it is so many times the usual."""
INDEPENDENT = 4.0
"""Parts of a body whose points' noise is their own: the noise of their mean is that of a point over the root of this."""
VARYING = 0.5
"""Size of a force's variation over a body, relative to the force, where the clip shows none of it."""
SMOOTHED = 5
"""Frames over which a sudden change is smoothed."""


def posterior_deviation(forward: Forward, covariance: np.ndarray) -> np.ndarray:
    """Standard deviation of the acceleration on the particles, (T, N, 3) [m/s²].

    Args:
        forward: basis and hats.
        covariance: (n, n) posterior covariance of the unknowns.
    """
    knots, modes, _ = forward.shape
    nothing = np.zeros((3, modes, modes))  # where the air is still
    field = covariance[: forward.size, : forward.size].reshape(knots, modes, 3, knots, modes, 3)
    of_components = np.einsum("kmilni->klimn", field)
    deviation = []
    for weights in forward.hats:
        active = np.flatnonzero(weights)
        block = sum((weights[k] * weights[j] * of_components[k, j] for k in active for j in active), nothing)
        variance = np.einsum("pm,imn,pn->pi", forward.basis.phi, block, forward.basis.phi, optimize=True)
        deviation.append(np.sqrt(np.maximum(variance, 0.0)))
    return np.stack(deviation)


def missed_acceleration(targets: PointTargets, x: np.ndarray, fps: float) -> np.ndarray:
    """Acceleration of the points' mean that the simulation x (T+1, N, 3) lacks in a frame beyond the usual, (T,) [m/s²].

    A force has knots, so one that changes suddenly is smoothed, of which the posterior, which takes knots for the truth, knows nothing.
    The usual is the median, or what is expected of noise that the points do not share: a kick in a short clip is missed in all its frames.
    """
    count = targets.visible.sum(axis=1)
    missed = np.where(targets.visible[..., None], targets.x - targets.attachment.matrix(x.shape[1]) @ x, 0.0)
    mean = missed.sum(axis=1) / np.maximum(count, 1)[:, None]
    both = targets.visible[1:] & targets.visible[:-1]
    step = np.where(both[..., None], np.diff(missed, axis=0), 0.0).sum(axis=1) / np.maximum(both.sum(axis=1), 1)[:, None]
    size = fps**2 * np.linalg.norm(np.diff(step, axis=0), axis=1)  # between frames 1 ... T-1 and their neighbours
    usual = float(np.median(size))
    many = count > INDEPENDENT
    if many[1:].any():
        apart = np.where(targets.visible[..., None], missed - mean[:, None], 0.0)
        scatter = np.median(np.sqrt((apart**2).sum(axis=(1, 2)) / np.maximum(count, 1))[1:][many[1:]])
        usual = min(usual, fps**2 * float(np.sqrt(6.0 / INDEPENDENT) * scatter))  # a second difference of noise has six times its variance
    beyond = np.where(size > USUAL * usual, size, 0.0)
    return maximum_filter1d(np.concatenate([beyond, [0.0]]), SMOOTHED)


def unseen_variation(acceleration: np.ndarray) -> np.ndarray:
    """Standard deviation (T, N, 3) [m/s²] of what a force on the particles (T, N, 3) varies by over a body that is seen as a point.

    The posterior is that of a uniform force, as more could not be told: a plain sheet of which only the outline's middle is followed.
    """
    size = np.sqrt((acceleration**2).mean(axis=(1, 2)))
    return np.broadcast_to(VARYING * size[:, None, None], acceleration.shape)


def unseen_guess(acceleration: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Standard deviation (T,) [m/s²] of one component of a force on the particles (T, N, 3) in frames of which nothing was seen.

    Where the body comes out again, its place and its velocity tell two numbers of the n + 1 forces that brought it through n such frames;
    of the others nobody knows more than their size, and two forces of that size differ by the root of two times it. The posterior, whose
    gusts have one length, believes more.

    Args:
        shown: (T+1,) bool, frames in which something is seen that a force moves; frame 0 is where the body begins.
    """
    deviation, size = np.zeros(len(acceleration)), float(np.sqrt(2.0 * (acceleration**2).mean()))
    for first, end in runs_of(~shown[1:]):  # forces of the frames first ... end - 1 lead to one that is not seen
        hidden, comes_out = end - first, end < len(acceleration)
        share = (hidden - 1) / (hidden + 1) if comes_out else 1.0
        deviation[first : end + comes_out] = np.sqrt(share) * size
    return deviation
