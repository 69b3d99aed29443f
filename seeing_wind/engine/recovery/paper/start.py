"""What gradient descent starts from: the box of all motion, the initial velocity, and the size of force to expect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...records import Particles, PointTargets
from ..prior.basis import rigid_motions
from ..targets.channels import second_derivative
from .losses import Targets

FIRST = 8
"""Number of frames from which the initial velocity is estimated."""
DOUBT = 0.25
"""Squared difference of two estimates of the initial velocity, relative to its square, above which the velocity is taken to be zero."""
MARGIN = 0.25
"""Margin around the box of all motion, relative to the body's radius."""


@dataclass(frozen=True)
class Start:
    """What a first look at the targets gives."""

    box: np.ndarray
    """(2, 3) [m], lower and upper corner, contains all motion."""
    acceleration: float
    """Expected root mean square of force over density [m/s²]."""
    velocity: np.ndarray
    """(N, 3) [m/s], the particles' velocity in frame 0."""
    spin: np.ndarray
    """(N, 3, 3) [1/s], the gradient of that velocity: the affine velocity C."""


def first_look(particles: Particles, targets: Targets, fps: float, gravity: np.ndarray) -> Start:
    """Estimate the box, the size of the force and the initial velocity from the targets; gravity (3,) [m/s²].

    The paper starts every body at rest. For a clip that begins in motion, the force would then alternate from frame to frame (each frame
    undoes the velocity error of the one before), so a free body's uniform motion and spin are estimated; a held body starts at rest.
    """
    x = particles.x
    radius = float(np.linalg.norm(x - x.mean(axis=0), axis=1).max()) or particles.spacing
    places, curvature, rows, slopes = [x], [0.0], [], []
    motions, gradients = rigid_motions(x, x.mean(axis=0), radius)
    for one in [targets] if isinstance(targets, PointTargets) else targets:
        at_rest = one.attachment.follow(x)
        carried = np.stack([one.attachment.follow(motion) for motion in motions], axis=-1)  # (K, 3, 6)
        if isinstance(one, PointTargets):
            series, unit = one.x, np.ones(len(at_rest))
            places.append(one.x[one.visible])
            motion_rows = carried
        else:
            depth = one.camera.project(at_rest, 0)[1]
            series, unit = one.xy, depth / one.camera.fx
            places += [one.camera.unproject(one.xy[t, seen], depth[seen], t) for t, seen in enumerate(one.visible)]
            motion_rows = one.camera.projection_jacobian(at_rest, 0) @ carried
        whole = one.visible.all(axis=0)
        if whole.any():
            metres = series[:, whole] * unit[whole][None, :, None]
            curve = second_derivative(metres.reshape(len(metres), -1), fps)
            curvature.append(float(np.sqrt((curve**2).sum(axis=1).mean() / whole.sum())))
        begun = one.visible[:FIRST].all(axis=0)
        rows.append((motion_rows[begun] * unit[begun][:, None, None]).reshape(-1, 6))
        slopes.append((series[:FIRST, begun] * unit[begun][None, :, None]).reshape(min(FIRST, len(series)), -1))
    everywhere = np.concatenate(places)
    low, high = everywhere.min(axis=0) - MARGIN * radius, everywhere.max(axis=0) + MARGIN * radius
    size = float(np.hypot(max(curvature), np.linalg.norm(gravity))) or 1e-3
    moving = np.zeros(6) if particles.pinned.any() else _velocity(np.concatenate(rows), np.concatenate(slopes, axis=1), fps)
    return Start(np.stack([low, high]), size, np.tensordot(moving, motions, 1), np.tensordot(moving, gradients, 1))


def _velocity(rows: np.ndarray, series: np.ndarray, fps: float) -> np.ndarray:
    """(6,) amplitudes of the rigid motions, `rows` (M, 6), that best explain the initial slopes of `series` (frames, M).

    The slopes are those of a fitted parabola, which a changing force biases, and of a cubic, which amplifies noise. Where the two disagree,
    or there are too few frames or no series, the result is zero: the body starts at rest.
    """
    if len(series) < 5 or not series.shape[1]:
        return np.zeros(6)
    time = np.arange(len(series)) / fps
    found = []
    for degree in (2, 3):
        slope = np.polyfit(time, series, degree)[-2]
        found.append(np.linalg.lstsq(rows, slope, rcond=1e-2)[0])
    parabola, cubic = found
    doubt = float(((parabola - cubic) ** 2).sum()) / max(float((cubic**2).sum()), 1e-30)
    return cubic if doubt < DOUBT else np.zeros(6)
