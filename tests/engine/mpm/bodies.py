"""Small bodies for the solver's tests."""

from __future__ import annotations

import numpy as np

from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.laws.plasticity import VON_MISES
from seeing_wind.engine.records import Particles

SPACING = 0.01
RUBBER = Material("rubber", "corotated", density=300.0, youngs_modulus=2e4, poisson_ratio=0.3)


def block(shape=(4, 3, 5), jitter=0.1, pinned_below=None, seed=0) -> Particles:
    """A block of particles, slightly disordered; those lower than `pinned_below` [m] are pinned."""
    rng = np.random.default_rng(seed)
    x = np.stack(np.meshgrid(*[np.arange(n) * SPACING for n in shape], indexing="ij"), -1).reshape(-1, 3)
    pinned = np.zeros(len(x), bool) if pinned_below is None else x[:, 2] < pinned_below
    return Particles(x + jitter * SPACING * rng.uniform(-1, 1, size=x.shape), np.full(len(x), SPACING**3), pinned, SPACING)


def affine_basis(x):
    """Constant and linear modes (N, 4) at x (N, 3) [m] and their gradients (N, 4, 3) [1/m]."""
    X = (x - x.mean(axis=0)) / 0.03
    phi = np.concatenate([np.ones((len(x), 1)), X], axis=1)
    dphi = np.zeros((len(x), 4, 3))
    dphi[:, 1:] = np.eye(3) / 0.03
    return phi, dphi


def retardation_of(model) -> float:
    """The longest retardation time [s] of the model's elastic particles; 0 without damping."""
    return float(np.where(model.law < VON_MISES, model.viscosity / model.mu, 0.0).max())


def still(model, frames):
    """No force on any particle, (T, N, 3)."""
    return np.zeros((frames, model.particles, 3))
