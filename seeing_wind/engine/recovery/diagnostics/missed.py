"""Whether a simulation is so far from the observations that its force is of no use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...conventions import DISTRUST, frame_named, in_units
from ...errors import ObjectError
from ...records import Particles
from ..targets.channels import noise_of
from ..targets.constants import NOISE
from ..targets.objective import Channels
from ..targets.points import PointChannels
from ..targets.tracks import TrackChannels
from .remarks import EXPLAINS_NOTHING, ROUGHLY, STILL, force_remarks, radius_of

ASTRAY, ASTRAY_NOISE = 0.1, 10.0
"""A simulation explains nothing if its residual exceeds all of these: the body's size, the first number times the points' largest
displacement, and the second number times the deviation of the noise."""
FAR = 0.05
"""Median distance of the tracks from the simulation, relative to the body's size, above which the force should not be trusted."""
UNEXPLAINED = 0.1
"""Residual, relative to that of a motion without any force, above which the force should not be trusted. It is 0 to 0.02 for filmed scenes
that are recovered, up to 0.09 for drafts of one iteration, and 0.11 to 0.34 for plants with an unmarked clamp or a wrong stiffness."""
ROUGH = 0.05
"""The same residual, for tracks, above which a note says that the motion is followed only roughly: between the first two of these."""


def verdict(
    particles: Particles,
    channels: Sequence[Channels],
    x: np.ndarray,
    residual: np.ndarray,
    fall: np.ndarray | None = None,
    called: str = "The simulated body",
) -> list[str]:
    """Notes on a motion x (T+1, N, 3) [m] whose `residual` (T+1,) [m or px] is so large that its force is of no use, or that it follows
    tracks only roughly; none otherwise.

    Args:
        fall: the body's motion without a force, see `fall_of`.
        called: the subject of the note's sentence, such as "The simulated body".

    Raises:
        ObjectError: points in 3D are not followed at all. With tracks there is a note instead, so that the take is kept for inspection.
    """
    lost = astray(particles, channels, x, residual)
    if not lost:
        return far_off(particles, channels, x, residual, fall, called) or roughly(particles, channels, x, residual, fall, called)
    if not isinstance(channels[0], TrackChannels):
        raise ObjectError(lost, "Check the unit of the points, their order, fps and the material; cut the file where the body jumps.")
    return [f"{lost} {DISTRUST}: check the outline, the tracks and the scale."]


def fall_of(
    particles: Particles, acceleration: np.ndarray, x: np.ndarray, v0: np.ndarray, fps: float, gravity: Sequence[float]
) -> np.ndarray | None:
    """The free fall (T+1, N, 3) [m] with initial velocity v0 (N, 3) [m/s], with which the motion x (T+1, N, 3) [m] is compared.

    None for a held body, and for one whose acceleration (T, N, 3) [m/s²] hardly matters: what was seen then is a free fall, and a residual
    as large as that of the free fall is no fault.
    """
    if particles.pinned.any() or force_remarks(acceleration, 1.0, x, fps, gravity):
        return None
    return free_fall(particles.x, v0.mean(axis=0), gravity, len(x) - 1, fps)


def free_fall(start: np.ndarray, velocity: np.ndarray, gravity: Sequence[float], frames: int, fps: float) -> np.ndarray:
    """Positions (T+1, N, 3) [m] of particles that start at `start` (N, 3) [m] with a common `velocity` (3,) [m/s], under gravity alone."""
    time = np.arange(frames + 1)[:, None] / fps
    return start + (velocity * time + 0.5 * np.asarray(gravity) * time**2)[:, None]


def astray(particles: Particles, channels: Sequence[Channels], x: np.ndarray, residual: np.ndarray) -> str:
    """The note on a simulation x (T+1, N, 3) [m] whose `residual` (T+1,) [m or px] exceeds the body's size in some frame; "" otherwise.

    Such a force is of no use: units, frame rate or the points' order are wrong, or the body jumps between two frames.
    """
    first, worst = channels[0], int(residual.argmax())
    size, noise, unit = _size(particles, first, x)
    if residual[worst] <= max(size, ASTRAY * _way(first), ASTRAY_NOISE * noise):
        return ""
    return (
        f"In {frame_named(worst)} the simulated body is {in_units(residual[worst], unit)} from where it was seen, more than its size "
        f"({in_units(size, unit)}): {EXPLAINS_NOTHING}."
    )


def far_off(
    particles: Particles,
    channels: Sequence[Channels],
    x: np.ndarray,
    residual: np.ndarray,
    fall: np.ndarray | None = None,
    called: str = "The simulated body",
) -> list[str]:
    """Notes on a simulation x (T+1, N, 3) [m] that is far from the observations, by `residual` (T+1,) [m or px].

    It is far if the median residual is a large part of the body's size (tracks only), or if, for half of the observed motion, the residual
    is a large part of that of a motion without a force: at rest or in free `fall` (T+1, N, 3) [m].
    """
    size, noise, unit = _size(particles, channels[0], x)
    far, way = _median_of_shown(residual), _way(channels[0])
    if size == 0.0:  # a body that is a point has no size to compare with; `astray` covers it
        return []
    if isinstance(channels[0], TrackChannels) and far > max(ASTRAY_NOISE * noise, FAR * size):
        much = f"{100.0 * far / size:.0f} % of its size"
    else:
        share = _share_missed(channels, x, _unforced(particles, x, fall))
        if share <= UNEXPLAINED or max(far, way) < STILL * size:
            return []
        much = f"{100.0 * share:.0f} % of the motion that a force has to explain"
    check = "the outline, what is held, the depth" if isinstance(channels[0], TrackChannels) else "units, axes"
    return [
        f"{called} is {in_units(far, unit)} (median) from where it was seen, {much}. {DISTRUST}: check {check} and the material."
    ]


def roughly(
    particles: Particles,
    channels: Sequence[Channels],
    x: np.ndarray,
    residual: np.ndarray,
    fall: np.ndarray | None = None,
    called: str = "The simulated body",
) -> list[str]:
    """The note on a simulation x (T+1, N, 3) [m] that `far_off` lets pass, but that follows tracks only roughly; arguments as there."""
    size, noise, unit = _size(particles, channels[0], x)
    far = _median_of_shown(residual)
    if not isinstance(channels[0], TrackChannels) or far <= ASTRAY_NOISE * noise or _way(channels[0]) < STILL * size:
        return []
    share = _share_missed(channels, x, _unforced(particles, x, fall))
    if share <= ROUGH:
        return []
    return [
        f"{called} is {in_units(far, unit)} (median) from where it was seen, {100.0 * share:.0f} % of the motion that a force has to "
        f"explain: {ROUGHLY}. Check the outline, what is held, the depth and the material."
    ]


def _median_of_shown(residual: np.ndarray) -> float:
    """Median of a residual (T+1,) over the frames after the first in which something was observed; 0 if there are none."""
    shown = residual[1:][residual[1:] > 0.0]
    return float(np.median(shown)) if len(shown) else 0.0


def _unforced(particles: Particles, x: np.ndarray, fall: np.ndarray | None) -> list[np.ndarray]:
    """Motions (T+1, N, 3) [m] without a force: at rest, and in free fall if that is known."""
    rest = np.broadcast_to(particles.x, x.shape)
    return [rest] if fall is None else [rest, fall]


def _share_missed(channels: Sequence[Channels], x: np.ndarray, unforced: Sequence[np.ndarray]) -> float:
    """Residual of x (T+1, N, 3) beyond the errors of the observations, relative to the residual of the best of the paths `unforced`.

    It is the median over points and frames, weighted by the latter residual, so neither held points nor outliers dominate.
    """
    missed = np.concatenate([_beyond(_distance(one, x), _errors(one, x)) for one in channels])
    paths = [np.concatenate([_distance(one, path) for one in channels]) for path in unforced]
    moved = min(paths, key=lambda path: float((path**2).sum()))
    missed, moved = missed[moved > 0.0], moved[moved > 0.0]
    order = np.argsort(missed / moved)
    weight = np.cumsum(moved[order])
    return float((missed / moved)[order][np.searchsorted(weight, 0.5 * weight[-1])]) if len(weight) else 0.0


def _distance(one: Channels, x: np.ndarray) -> np.ndarray:
    """Flat array of the distances [m or px] of x (T+1, N, 3) from the observed points: those visible in frame 0, in all later frames in
    which they are visible."""
    distance = one.distance(x)[1:, one.targets.visible[0]]
    return distance[np.isfinite(distance)]


def _beyond(distance: np.ndarray, errors: float) -> np.ndarray:
    return np.sqrt(np.maximum(distance**2 - errors**2, 0.0))


def _errors(one: Channels, x: np.ndarray) -> float:
    """Root mean square distance [m or px] that the observations' errors explain, including those of frame 0, from which the body was built.

    The errors are the stated ones; for points without stated errors they are estimated from how the residual of x (T+1, N, 3) changes from
    frame to frame.
    """
    if isinstance(one, TrackChannels):
        noise = float(np.median(one.targets.sigma[one.targets.visible]))
        return float(np.sqrt(2.0 * (2.0 * noise**2 + NOISE.track_white**2 + NOISE.track_slow**2)))
    if one.targets.sigma is not None or one.targets.covariance is not None:
        return float(np.sqrt(2.0 * one.targets.stated.mean()))
    always = one.targets.visible.all(axis=0)
    if not always.any():
        return 0.0
    missed = np.einsum("kn,tnc->tkc", one.points[always], x) - one.targets.x[:, always]
    return float(np.sqrt(2.0 * 3.0)) * noise_of(missed[1:])


def _size(particles: Particles, first: Channels, x: np.ndarray) -> tuple[float, float, str]:
    """The body's diameter in the first frame of x (T+1, N, 3), the noise of the observations (0 for points in 3D), and the unit of both."""
    if isinstance(first, TrackChannels):
        noise = float(np.median(first.targets.sigma[first.targets.visible]))
        return 2.0 * radius_of(first.camera.project(x[0])[0]), noise, "pixels"
    return max(2.0 * radius_of(particles.x), 3.0 * particles.spacing), 0.0, "m"


def _way(first: Channels) -> float:
    """Largest displacement of any point from where it was in the first frame [px or m]."""
    seen = first.targets.x if isinstance(first, PointChannels) else first.targets.xy
    visible = first.targets.visible
    return float(np.linalg.norm(np.where((visible & visible[0])[..., None], seen - seen[0], 0.0), axis=-1).max())
