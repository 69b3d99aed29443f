"""How much damping explicit substeps allow, and how many substeps a given damping needs.

The viscous stress of a Kelvin-Voigt solid (`laws.viscous`) with the retardation time tau is explicit in the velocities: with substeps dt, a
wave of angular frequency omega is stable while (omega dt)² (1 + 2 tau / dt) < 4. For the fastest waves of a grid, which cross `crossed`
cells in a substep, this is a bound on crossed² (1 + 2 tau / dt); without damping it becomes that on the Courant number.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..materials import LIMITS
from .laws.plasticity import VON_MISES
from .model import Model


def cells_per_frame(model: Model) -> float:
    """Cells that the fastest elastic wave crosses in a frame."""
    return float(np.sqrt((model.lam + 2.0 * model.mu) * model.volume / model.mass).max()) * model.frame_dt / model.dx


def longest_retardation(model: Model) -> float:
    """The longest retardation time [s] for which the model's substeps are stable."""
    crossed, dt = cells_per_frame(model) / model.substeps, model.frame_dt / model.substeps
    return max(0.0, 0.5 * dt * ((LIMITS.viscous_courant / crossed) ** 2 - 1.0))


def substeps_for(model: Model, retardation: float) -> int:
    """Substeps per frame that a retardation time [s] needs; at least the model's."""
    cells = cells_per_frame(model)
    lean = retardation * cells**2 / model.frame_dt
    return max(model.substeps, math.ceil((lean + math.hypot(lean, LIMITS.viscous_courant * cells)) / LIMITS.viscous_courant**2))


def with_retardation(model: Model, retardation: float | np.ndarray) -> Model:
    """The model with a retardation time [s], one number or (N,), where its law is elastic; limited to `longest_retardation`."""
    carried = np.minimum(retardation, longest_retardation(model))
    return replace(model, viscosity=np.where(model.law < VON_MISES, carried * model.mu, model.viscosity))
