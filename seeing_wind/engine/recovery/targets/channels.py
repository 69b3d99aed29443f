"""Helpers for both kinds of target; either becomes channels, time series that the simulation must follow:

    points in 3D   a few smooth modes of the displacement (`point_channels`);
    tracks in 2D   projection(W x(t)) - p(t), two channels per track (`track_channels`).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np

from ...errors import ObjectError, UsageError
from ...records import Attachment, PointTargets, TrackTargets
from .constants import NOISE


def noise_of(series: np.ndarray) -> float:
    """Standard deviation of the noise in smooth series (frames, ...), from differences of order 3 to 7 in time.

    Each order gives an upper bound of the noise (the rest of the motion adds to it), so the smallest would be best. But the minimum of
    several uncertain bounds is biased (7 % too small with 16 frames), so the lowest order with about the smallest bound is used. Zero for
    fewer than eight frames, in which motion and noise cannot be separated.
    """
    if len(series) < 8:
        return 0.0
    orders = range(3, min(7, len(series) - 3) + 1)
    bounds = [float(np.sqrt(np.mean(np.diff(series, order, axis=0) ** 2) / comb(2 * order, order))) for order in orders]
    return next(bound for bound in bounds if bound <= NOISE.same_noise * min(bounds))


def second_derivative(series: np.ndarray, fps: float) -> np.ndarray:
    """Accelerations (frames - 6, n) of series (frames, n), from parabolas fitted to seven consecutive frames (or to all, if fewer)."""
    if len(series) < 3:
        return np.zeros((1, series.shape[1]))
    width = min(7, len(series))
    time = (np.arange(width) - (width - 1) / 2.0) / fps
    row = 2.0 * np.linalg.pinv(np.stack([np.ones(width), time, time**2], axis=1))[2]
    return np.stack([row @ series[i : i + width] for i in range(len(series) - width + 1)])


def first_speed(series: np.ndarray, fps: float) -> float:
    """Root mean square speed [m/s] at the first frame of series (frames, points, coordinates) [m], from a parabola fitted to six frames."""
    first = series[: min(6, len(series))]
    flat = first.reshape(len(first), -1)
    slope = np.polyfit(np.arange(len(first)) / fps, flat, min(2, len(first) - 1))[-2]
    return float(np.sqrt(np.mean(np.sum(slope.reshape(first.shape[1:]) ** 2, axis=-1))))


def views_of(targets: PointTargets | Sequence[TrackTargets]) -> list[PointTargets | TrackTargets]:
    """The targets as a list with one entry per view.

    Raises:
        UsageError: if they do not have the same number of frames. ObjectError: if nothing is seen after the first frame.
    """
    views: list[PointTargets | TrackTargets] = [targets] if isinstance(targets, PointTargets) else list(targets)
    if len({len(one.visible) for one in views}) != 1:
        raise UsageError("The views do not have the same number of frames.", "Cut the clips to the same frames, or give one clip.")
    if not any(one.visible[1:].any() for one in views):
        raise ObjectError("Nothing of the object is seen after the first frame.", "Check the mask, or give more frames of it.")
    return views


def check_free(pinned: np.ndarray, views: Sequence[PointTargets | TrackTargets]) -> None:
    """Raise ObjectError if, after the first frame, only targets on pinned particles are seen; pinned: (N,) bool."""
    for one in views:
        if one.visible[1:, one.attachment.matrix(len(pinned)) @ pinned <= NOISE.clamp_rides].any():
            return
    raise ObjectError(
        "Only what is held is seen after the first frame: nothing shows how the rest moves.",
        "Mark less as held, or show more of the object.",
    )


def check(values: np.ndarray, visible: np.ndarray, width: int, attachment: Attachment, particles: int) -> None:
    """Raise UsageError or ObjectError, with the reason, for targets that cannot be right.

    Args:
        values: (T+1, K, width) positions [m or px]; visible: (T+1, K) bool.
        particles: number of particles to which targets may be attached.
    """
    if visible.ndim != 2 or values.shape != (*visible.shape, width) or len(attachment.index) != visible.shape[1]:
        raise UsageError(
            f"Targets {values.shape}, visible {visible.shape} and attachment {attachment.index.shape} do not belong together.",
            f"Expected (T+1,K,{width}), (T+1,K) and (K,J).",
        )
    if visible.dtype != bool:
        raise UsageError(f"What is visible is of dtype {visible.dtype}.", "Give bool: True where a target is seen.")
    shown = np.count_nonzero(visible.any(axis=1))
    if shown < 3:
        what = f"{shown} frames" if shown == len(visible) else f"{shown} frames in which something is visible"
        raise ObjectError(f"{what} show no acceleration.", "Give a clip that shows the object in at least three frames.")
    if not np.isfinite(values[visible]).all():
        raise UsageError("A target that is marked visible is not a number.", "Mark it not visible, or give its position.")
    if attachment.index.min(initial=0) < 0 or attachment.index.max(initial=0) >= particles:
        raise UsageError("A target is attached to a particle that is not there.", "Build the body again.")
