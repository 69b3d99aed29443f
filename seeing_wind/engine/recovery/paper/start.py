"""What gradient descent starts from: where the body goes, how fast it starts, how strong a force to expect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...records import Particles, PointTargets
from ..prior.basis import rigid_motions
from ..targets.channels import second_derivative
from .losses import Targets

FIRST = 8
"""Frames from which the initial velocity is read."""
DOUBT = 0.25
"""Squared disagreement of two fits to the initial velocity, relative to its square, above which it is taken for zero."""
MARGIN = 0.25
"""Of the body's radius, round the swept volume."""


@dataclass(frozen=True)
class Start:
    """A first look at the targets."""

    box: np.ndarray
    """(2, 3) round everything that moved [m]."""
    acceleration: float
    """Root mean square size of the force over density to expect [m/s²]."""
    velocity: np.ndarray
    """(N, 3) [m/s] in frame 0."""
    spin: np.ndarray
    """(N, 3, 3) its gradient, the affine velocity [1/s]."""


def first_look(particles: Particles, targets: Targets, fps: float, gravity: np.ndarray) -> Start:
    """Read box, size and initial velocity off the targets.

    The paper starts every body at rest. A clip that begins in motion would then alternate in force from frame to frame (the error of one
    frame's velocity is undone in the next), so a free body's uniform motion and spin are estimated; a held one starts at rest.
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
    """(6,) speeds of the rigid motions whose rows (M, 6) explain the first slopes of series (frames, M); none where fits disagree.

    A parabola is biased by forces that change, a cubic amplifies noise: a body whose speed they do not agree on starts at rest.
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
