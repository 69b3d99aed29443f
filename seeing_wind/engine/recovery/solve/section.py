"""How a held body's stiffness is spread over its section: two shapes, of which a clip finds the sizes.

A post bends by the second moments of its section, a tensor of three numbers. Young's modulus scales all of them alike, but a section that
was guessed from frames, or that few particles stand for, is stiffer one way than the other, and not along its own axes: then what
pushes it one way makes it swing across, too. A post of another simulator answered to a force so, as if 5 % of its stiffness were off the
diagonal; without it the same force missed its tip by 2.1 mm, with it by 0.2 mm, of a way of 83 mm.

With u and v the places across the body's axis, along the principal axes and in standard deviations of the section, E becomes

    E exp(a (u² - v²) / 2 + b u v)

of which a makes the section stiffer along one axis than along the other, and b makes a push along one bend it along the other.
"""

from __future__ import annotations

import numpy as np

from ...records import Particles
from ..prior.basis import held_axis
from ..prior.constants import PRIOR


def section_shapes(particles: Particles) -> np.ndarray:
    """(u² - v²) / 2 and u v on the particles of a body that is held somewhere, (2, N)."""
    across, values, axes = _section(particles)
    # What is spread within a particle's own cell counts, too: of one layer it is all there is.
    u, v = (across @ axis / np.sqrt(value + particles.spacing**2 / 12.0) for axis, value in zip(axes, values))
    return np.clip(np.stack([(u**2 - v**2) / 2.0, u * v]), -PRIOR.section_farthest, PRIOR.section_farthest)


def section_axes(particles: Particles) -> np.ndarray:
    """(2, 3) the unit vectors along which u and v are measured."""
    return _section(particles)[2]


def turned(axes: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """(2, 2) what makes a and b, told along some `axes` (2, 3), those along other ones that span nearly the same plane.

    a and b are the entries of the symmetric matrix [[a, b], [b, -a]] / 2 of a section's stiffness.
    """
    turn = onto @ axes.T
    told = [turn @ shape @ turn.T for shape in (np.diag([0.5, -0.5]), np.array([[0.0, 0.5], [0.5, 0.0]]))]
    return np.stack([[one[0, 0] - one[1, 1], one[0, 1] + one[1, 0]] for one in told], axis=1)


def _section(particles: Particles) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places across the axis (N, 3) [m], the section's variances along its principal axes (2,) [m²], and these (2, 3), widest first."""
    x, free = particles.x, ~particles.pinned
    if free.all() or not free.any():
        raise ValueError("only a body that is held in part has an axis to bend about")
    middle = x[free].mean(axis=0)
    axis, across = held_axis(x, particles.pinned), x - middle
    if axis is not None:
        across = across - np.outer(across @ axis, axis)
    values, vectors = np.linalg.eigh(across[free].T @ across[free] / free.sum())
    return across, values[2:0:-1], vectors[:, 2:0:-1].T
