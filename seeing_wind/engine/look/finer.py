"""Finer Gaussians where the clip shows more detail than those of frame 0: their number was limited, and some sides were slanted or far."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from ..observe.object.motion.control import attach
from ..records import Attachment, Camera, Gaussians
from .covering import joined
from .gaussians import axes_of, blended_gradients

LIMIT = 1.0
"""Standard deviation [px] up to which a Gaussian is not split: finer ones take time and show no more."""

APART, SHRUNK = 0.5, 0.5
"""Distance of the two halves from the centre of the Gaussian, and their width, in its standard deviations. They are narrower than would
preserve its shape, because it was too wide for the texture. The colours are fitted afterwards."""


def finer(gaussians: Gaussians, particles_x: np.ndarray, camera: Camera, motion: Iterable[tuple[int, np.ndarray, np.ndarray]]) -> Gaussians:
    """The Gaussians, each split in two along those of its two longer axes that some frame shows wider than `LIMIT`.

    Args:
        particles_x: (N, 3) [m] at rest; motion: for some frames, the number, particles (N, 3) [m] and deformation gradients (N, 3, 3).

    Returns:
        Gaussians at rest, attached to the particles: those that are not split, in their order, then the parts of the others.
    """
    axes = axes_of(gaussians) * gaussians.scale[:, None, :]
    long = np.argsort(gaussians.scale, axis=1)[:, 1:]
    arms = np.take_along_axis(axes, long[:, None, :], axis=2)
    wide = np.zeros(long.shape, bool)
    for t, x, F in motion:
        shown = camera.projection_jacobian(gaussians.attachment.follow(x), t) @ (blended_gradients(gaussians, F) @ arms)
        wide |= np.linalg.norm(shown, axis=1) > LIMIT
    result = _subset(gaussians, ~wide.any(axis=1))
    for halved in ((True, False), (False, True), (True, True)):
        these = (wide == halved).all(axis=1)
        whole = _subset(gaussians, these)
        scale, offsets = whole.scale.copy(), np.zeros((1, *whole.x.shape))
        for arm in np.flatnonzero(halved):
            scale[np.arange(len(scale)), long[these, arm]] *= SHRUNK
            offsets = np.concatenate([offsets + side * APART * arms[these, :, arm] for side in (-1.0, 1.0)])
        for x in whole.x + offsets:
            result = joined(result, dataclasses.replace(whole, x=x, scale=scale, attachment=attach(x, particles_x)))
    return result


def _subset(gaussians: Gaussians, rows: np.ndarray) -> Gaussians:
    """The Gaussians of a set that are marked in `rows` (G,) bool."""
    ride = Attachment(gaussians.attachment.index[rows], gaussians.attachment.weight[rows])
    plain = {name: getattr(gaussians, name)[rows] for name in ("x", "scale", "rotation", "opacity", "sh")}
    return Gaussians(**plain, attachment=ride)
