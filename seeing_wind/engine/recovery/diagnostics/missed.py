"""Whether a simulation misses what was seen by so much that its force is of no use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...conventions import frame_named, in_units
from ...errors import ObjectError
from ...records import Particles
from ..targets.channels import noise_of
from ..targets.constants import NOISE
from ..targets.objective import Channels
from ..targets.points import PointChannels
from ..targets.tracks import TrackChannels
from .remarks import DISTRUST, EXPLAINS_NOTHING, STILL, force_remarks, radius_of

ASTRAY, ASTRAY_NOISE = 0.1, 10.0
"""A simulation explains nothing that misses the points by more than the body's size, this share of their way, and so many deviations."""
FAR = 0.05
"""Median distance of tracks from the simulation, relative to the body's size, from which nobody should trust the force."""
UNEXPLAINED = 0.1
"""Share of what no force at all would miss, from which nobody should trust the force that misses it. Filmed scenes that come back miss
0 to 0.02, drafts of one iteration up to 0.09, plants whose held place was not marked or whose stiffness is wrong 0.11 to 0.34."""


def verdict(
    particles: Particles,
    channels: Sequence[Channels],
    x: np.ndarray,
    residual: np.ndarray,
    fall: np.ndarray | None = None,
    called: str = "The simulated body",
) -> list[str]:
    """What to say of a motion x (T+1, N, 3) [m] that is so far off what was seen, by residual (T+1,), that its force is of no use.

    Args:
        fall: where the body goes without a force, see `fall_of`.
        called: what moves so.

    Raises:
        ObjectError: points in 3D that are not followed at all; with tracks the take is kept, to be looked at.
    """
    lost = astray(particles, channels, x, residual)
    if not lost:
        return far_off(particles, channels, x, residual, fall, called)
    if not isinstance(channels[0], TrackChannels):
        raise ObjectError(lost, "Check the unit of the points, their order, fps and the material; cut the file where the body jumps.")
    return [f"{lost} {DISTRUST}: check the outline, the tracks and the scale."]


def fall_of(
    particles: Particles, acceleration: np.ndarray, x: np.ndarray, v0: np.ndarray, fps: float, gravity: Sequence[float]
) -> np.ndarray | None:
    """The free fall (T+1, N, 3) [m] with which a motion x (T+1, N, 3) [m] from v0 (N, 3) [m/s] on is compared.

    None for a held body, and for one whose acceleration (T, N, 3) [m/s²] hardly acts: then free fall is what was seen, and missing as
    much as it does is no fault.
    """
    if particles.pinned.any() or force_remarks(acceleration, 1.0, x, fps, gravity):
        return None
    return free_fall(particles.x, v0.mean(axis=0), gravity, len(x) - 1, fps)


def free_fall(start: np.ndarray, velocity: np.ndarray, gravity: Sequence[float], frames: int, fps: float) -> np.ndarray:
    """(T+1, N, 3) [m]: where particles go from start (N, 3) with a common velocity (3,) [m/s] when only gravity acts on them."""
    time = np.arange(frames + 1)[:, None] / fps
    return start + (velocity * time + 0.5 * np.asarray(gravity) * time**2)[:, None]


def astray(particles: Particles, channels: Sequence[Channels], x: np.ndarray, residual: np.ndarray) -> str:
    """What to say of a simulation x (T+1, N, 3) [m] whose residual (T+1,) is at some time larger than the body; "" if at none.

    Nobody can use such a force: units, frame rate or the points' order are wrong, or the body jumps between two frames.
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
    """On a simulation x (T+1, N, 3) [m] that is off what was seen by residual (T+1,): most of the time by much of the body's size, in
    pixels, or in half of its motion by much of what would be missed without a force, at rest or in free `fall` (T+1, N, 3) [m]."""
    shown = residual[1:][residual[1:] > 0.0]
    size, noise, unit = _size(particles, channels[0], x)
    far, way = float(np.median(shown)) if len(shown) else 0.0, _way(channels[0])
    if size == 0.0:  # of a body that is a point, `astray` says what there is to say
        return []
    if isinstance(channels[0], TrackChannels) and far > max(ASTRAY_NOISE * noise, FAR * size):
        much = f"{100.0 * far / size:.0f} % of its size"
    else:
        rest = np.broadcast_to(particles.x, x.shape)
        share = _share_missed(channels, x, [rest] if fall is None else [rest, fall])
        if share <= UNEXPLAINED or max(far, way) < STILL * size:
            return []
        much = f"{100.0 * share:.0f} % of the motion that a force has to explain"
    check = "the outline, what is held, the depth" if isinstance(channels[0], TrackChannels) else "units, axes"
    return [
        f"{called} is {in_units(far, unit)} (median) from where it was seen, {much}. {DISTRUST}: check {check} and the material."
    ]


def _share_missed(channels: Sequence[Channels], x: np.ndarray, unforced: Sequence[np.ndarray]) -> float:
    """What x (T+1, N, 3) misses beyond its errors, relative to what the best of the paths `unforced` misses: the median over points and
    frames, which count by how far they moved. So neither what is held nor what was seen wrong tells of the rest."""
    missed = np.concatenate([_beyond(_distance(one, x), _errors(one, x)) for one in channels])
    paths = [np.concatenate([_distance(one, path) for one in channels]) for path in unforced]
    moved = min(paths, key=lambda path: float((path**2).sum()))
    missed, moved = missed[moved > 0.0], moved[moved > 0.0]
    order = np.argsort(missed / moved)
    weight = np.cumsum(moved[order])
    return float((missed / moved)[order][np.searchsorted(weight, 0.5 * weight[-1])]) if len(weight) else 0.0


def _distance(one: Channels, x: np.ndarray) -> np.ndarray:
    """Distances of x (T+1, N, 3) from the points that were there in the first frame, in one row, in all frames in which they are seen."""
    distance = one.distance(x)[1:, one.targets.visible[0]]
    return distance[np.isfinite(distance)]


def _beyond(distance: np.ndarray, errors: float) -> np.ndarray:
    return np.sqrt(np.maximum(distance**2 - errors**2, 0.0))


def _errors(one: Channels, x: np.ndarray) -> float:
    """Distance, root mean square, that errors of what was seen explain, those of the first frame included, in which the body was built:
    as stated; of points without such a statement, what the simulation x (T+1, N, 3) misses from frame to frame."""
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
    """Diameter of the body in the first frame of x (T+1, N, 3), noise of what was seen, and the unit of both."""
    if isinstance(first, TrackChannels):
        noise = float(np.median(first.targets.sigma[first.targets.visible]))
        return 2.0 * radius_of(first.camera.project(x[0])[0]), noise, "pixels"
    return max(2.0 * radius_of(particles.x), 3.0 * particles.spacing), 0.0, "m"


def _way(first: Channels) -> float:
    """How far a point went at most from where it was in the first frame [px or m]."""
    seen = first.targets.x if isinstance(first, PointChannels) else first.targets.xy
    visible = first.targets.visible
    return float(np.linalg.norm(np.where((visible & visible[0])[..., None], seen - seen[0], 0.0), axis=-1).max())
