"""What another clip of the same held body has told of it: a prior of the stiffness and the clamp, in place of the wide one.

A clip in which the body was plucked by hand, or rings after a gust, tells its stiffness better than one that is shorter than a swing.
What is carried over is q of `stiffness`: Young's modulus, where the clamp begins, and how the stiffness is spread over the section. The
new clip may still change it, by a little more than the other's fit leaves open: another clip has another mask.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...errors import UsageError
from ...mpm.model import Model
from ...records import Particles, Recovery
from ..prior.constants import PRIOR
from .section import section_axes, turned
from .stiffness import Stiffness, youngs_modulus


@dataclass(frozen=True)
class KnownBody:
    """A held body as a recovery found it."""

    youngs_modulus: float
    """[Pa]."""
    clamp: float
    """Where it begins to be held, below the border of what was marked as held [m]."""
    section: np.ndarray
    """(2,) a and b, along `axes` (2, 3)."""
    axes: np.ndarray
    covariance: np.ndarray
    """(4, 4) of log E, the clamp [m], a and b."""

    @staticmethod
    def of(recovery: Recovery, name: str) -> KnownBody:
        """From a recovery; `name` is told in errors.

        Raises:
            UsageError: when it did not tell the stiffness.
        """
        found = (recovery.youngs_modulus, recovery.section, recovery.section_axes, recovery.held_covariance)
        modulus, section, axes, covariance = found
        if modulus is None or section is None or axes is None or covariance is None or not recovery.cell > 0.0:
            raise UsageError(
                f"{name} does not tell how stiff its body is: it is not held, its stiffness was given, or it hardly swings.",
                "Give the take of a clip in which the held body swings, or leave --body out.",
            )
        size = np.array([1.0, recovery.cell, 1.0, 1.0])
        return KnownBody(modulus, recovery.clamp_depth * recovery.cell, section, axes, covariance * np.outer(size, size))

    def stiffness_of(self, particles: Particles, model: Model, free: bool) -> Stiffness:
        """The same of a body built anew; `free`: its own clip may change it."""
        size, turn = np.array([1.0, 1.0 / model.dx, 1.0, 1.0]), np.eye(4)
        turn[2:, 2:] = turned(self.axes, section_axes(particles))
        deeper = self.clamp / model.dx - model.clamp_depth
        q = np.array([math.log(self.youngs_modulus / youngs_modulus(model, particles)), deeper, *turn[2:, 2:] @ self.section])
        covariance = turn @ (self.covariance * np.outer(size, size)) @ turn.T + np.diag(np.square(PRIOR.body_anew))
        return Stiffness.of_another_clip(q, covariance, free)
