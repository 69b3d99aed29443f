"""How well the force is known: the posterior deviation, from the covariance that the solve yields, and what that covariance leaves out."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

from ...records import PointTargets
from ..prior.basis import runs_of
from ..solve.forward import Forward

USUAL = 4.0
"""A frame's missing acceleration is not noise if it is more than this many times the usual one."""
INDEPENDENT = 4.0
"""Number of parts of a body whose points have independent noise: the noise of the points' mean is that of one point over its root."""
VARYING = 0.5
"""Standard deviation of a force's variation over a body, relative to the force, where the clip shows nothing of that variation."""
SMOOTHED = 5
"""Number of frames over which the solve smooths a sudden change of the force."""


def posterior_deviation(forward: Forward, covariance: np.ndarray) -> np.ndarray:
    """Standard deviation (T, N, 3) [m/s²] of the acceleration on the particles.

    Args:
        forward: basis over the body and hat functions over time.
        covariance: (n, n) posterior covariance of the unknowns.
    """
    knots, modes, _ = forward.shape
    nothing = np.zeros((3, modes, modes))  # for frames without an active knot, where the air is still
    field = covariance[: forward.size, : forward.size].reshape(knots, modes, 3, knots, modes, 3)
    of_components = np.einsum("kmilni->klimn", field)
    deviation = []
    for weights in forward.hats:
        active = np.flatnonzero(weights)
        block = sum((weights[k] * weights[j] * of_components[k, j] for k in active for j in active), nothing)
        variance = np.einsum("pm,imn,pn->pi", forward.phi, block, forward.phi, optimize=True)
        deviation.append(np.sqrt(np.maximum(variance, 0.0)))
    return np.stack(deviation)


def missed_acceleration(targets: PointTargets, x: np.ndarray, fps: float) -> np.ndarray:
    """Acceleration (T,) [m/s²] of the points' mean that the simulation x (T+1, N, 3) [m] lacks; 0 where that is not far more than usual.

    A recovered force is linear between knots, so a sudden change is smoothed. The posterior takes the knots as exact and does not include
    this error. The usual size is the median over frames or, if smaller, what the points' independent noise lets expect: in a short clip
    with a kick, the acceleration may be missing in all frames.
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
    """Standard deviation (T, N, 3) [m/s²] of the variation of a force, `acceleration` (T, N, 3), over a body that is seen only as a point.

    An example is a plain sheet of which only the middle of the outline is followed. The posterior is then that of a uniform force, as more
    could not be determined.
    """
    size = np.sqrt((acceleration**2).mean(axis=(1, 2)))
    return np.broadcast_to(VARYING * size[:, None, None], acceleration.shape)


def unseen_guess(acceleration: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Standard deviation (T,) [m/s²] of one component of a force, `acceleration` (T, N, 3), in frames in which nothing was seen.

    When the body reappears after n such frames, its position and velocity determine two combinations of the n + 1 forces that acted
    meanwhile. Of the others only the size is known, and two independent forces of that size differ by sqrt(2) times it. The posterior,
    whose prior has a single correlation time, is too certain here.

    Args:
        shown: (T+1,) bool, frames in which something is seen that a force moves; frame 0 is where the body begins.
    """
    deviation, size = np.zeros(len(acceleration)), float(np.sqrt(2.0 * (acceleration**2).mean()))
    for first, end in runs_of(~shown[1:]):  # forces of the frames first ... end - 1 lead to one that is not seen
        hidden, comes_out = end - first, end < len(acceleration)
        share = (hidden - 1) / (hidden + 1) if comes_out else 1.0
        deviation[first : end + comes_out] = np.sqrt(share) * size
    return deviation
