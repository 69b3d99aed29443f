"""The problem that all simulators of the benchmark solve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LAWS = ("corotated", "neo_hookean", "von_mises", "viscoplastic")


@dataclass(frozen=True)
class Problem:
    """A free cube of one material, slightly deformed and in motion, inside a cubic grid of `grid` nodes whose first node is at 0."""

    law_name: str
    x: np.ndarray
    """(N, 3) [m]."""
    v: np.ndarray
    """(N, 3) [m/s]."""
    C: np.ndarray
    """(N, 3, 3) [1/s]."""
    F: np.ndarray
    """(N, 3, 3)."""
    grid: int
    """Nodes per axis."""
    dx: float
    """[m]."""
    dt: float
    """[s]."""
    density: float = 1000.0
    youngs_modulus: float = 2e4
    poisson_ratio: float = 0.3
    yield_stress: float = 400.0
    viscosity: float = 20.0
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    particles_per_cell: float = 8.0

    @property
    def law(self) -> int:
        """Number of the law."""
        return LAWS.index(self.law_name)

    @property
    def volume(self) -> float:
        """Of a particle [m³]."""
        return self.dx**3 / self.particles_per_cell

    @property
    def mass(self) -> float:
        """Of a particle [kg]."""
        return self.density * self.volume

    @property
    def mu(self) -> float:
        """[Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def lam(self) -> float:
        """[Pa]."""
        return self.youngs_modulus * self.poisson_ratio / ((1.0 + self.poisson_ratio) * (1.0 - 2.0 * self.poisson_ratio))


def cube(law: str, particles: int, grid: int, seed: int = 0) -> Problem:
    """A cube of about that many particles, eight per cell, with a smooth twist and stretch that make every law work."""
    rng = np.random.default_rng(seed)
    dx, ppc = 1.0 / grid, 8.0
    side = dx * (particles / ppc) ** (1.0 / 3.0)
    x = 0.5 + side * (rng.random((particles, 3)) - 0.5)
    problem = Problem(law, x, x, x, x, grid, dx, 0.0)
    wave_speed = np.sqrt((problem.lam + 2.0 * problem.mu) / problem.density)
    rest = (x - 0.5) / side
    twist = 4.0 * rest[:, 2]
    v = np.stack([-twist * rest[:, 1], twist * rest[:, 0], 0.5 * rest[:, 2]], axis=1)
    F = np.tile(np.eye(3), (particles, 1, 1))
    F[:, 0, 0] += 0.05 * np.sin(3.0 * rest[:, 1])
    F[:, 0, 1] += 0.05 * rest[:, 2]
    F[:, 2, 2] -= 0.04 * np.cos(2.0 * rest[:, 0])
    return Problem(law, x, v, np.zeros((particles, 3, 3)), F, grid, dx, float(0.2 * dx / wave_speed))
