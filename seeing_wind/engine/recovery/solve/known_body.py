"""The stiffness and clamp of a held body from another clip of it: a narrower prior in place of the default one.

A clip in which the body was plucked by hand, or rings after a gust, determines its stiffness better than one that is shorter than a swing.
What is taken over is q of `stiffness`: Young's modulus, where the clamp begins, and how the stiffness is distributed over the section. The
new clip may still change q, by a little more than the uncertainty of the other fit, as its mask differs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...errors import UsageError
from ...mpm.model import Model
from ...records import Particles, Recovery
from ..prior.constants import PRIOR
from .section import section_axes, section_rotation
from .stiffness import Stiffness, youngs_modulus


@dataclass(frozen=True)
class KnownBody:
    """The stiffness and clamp of a held body as found by a recovery."""

    youngs_modulus: float
    """Young's modulus E [Pa]."""
    clamp: float
    """Depth below the border of what was marked as held at which the clamp begins [m]."""
    section: np.ndarray
    """(2,) a and b, with respect to `axes`."""
    axes: np.ndarray
    """(2, 3) unit vectors along which u and v are measured, see `section`."""
    covariance: np.ndarray
    """(4, 4) covariance of log E, the clamp's depth [m], a and b."""

    @staticmethod
    def of(recovery: Recovery, name: str) -> KnownBody:
        """The body of a recovery; `name` stands for the recovery in errors.

        Raises:
            UsageError: when the recovery did not determine the stiffness.
        """
        found = (recovery.youngs_modulus, recovery.section, recovery.section_axes, recovery.held_covariance)
        modulus, section, axes, covariance = found
        if modulus is None or section is None or axes is None or covariance is None or not recovery.cell > 0.0:
            raise UsageError(
                f"{name} does not show how stiff its body is: it is not held, its stiffness was given, or it hardly swings.",
                "Give the take of a clip in which the held body swings, or leave --body out.",
            )
        size = np.array([1.0, recovery.cell, 1.0, 1.0])
        return KnownBody(modulus, recovery.clamp_depth * recovery.cell, section, axes, covariance * np.outer(size, size))

    def stiffness_of(self, particles: Particles, model: Model, free: bool) -> Stiffness:
        """The prior of q for a body that was built again from another clip; `free`: whether that clip may change q."""
        size, turn = np.array([1.0, 1.0 / model.dx, 1.0, 1.0]), np.eye(4)
        turn[2:, 2:] = section_rotation(self.axes, section_axes(particles))
        deeper = self.clamp / model.dx - model.clamp_depth
        q = np.array([math.log(self.youngs_modulus / youngs_modulus(model, particles)), deeper, *turn[2:, 2:] @ self.section])
        covariance = turn @ (self.covariance * np.outer(size, size)) @ turn.T + np.diag(np.square(PRIOR.body_anew))
        return Stiffness.of_another_clip(q, covariance, free)
