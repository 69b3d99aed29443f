"""How fast a clamped bar swings down in the solver, against the Kelvin-Voigt solid's closed form. Prints the table of
docs/notebook/solver.md.

    python benchmarks/accuracy/damping.py

The bar is six thicknesses long; its first mode rings for two periods. `own` is the damping ratio that the solver has without any
damping; `law` is what the viscous stress adds to it, over half the natural frequency times the retardation time.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.damping import substeps_for, with_retardation
from seeing_wind.engine.mpm.model import Model
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.records import Particles

THICK, SLENDER, MODULUS, DENSITY = 0.06, 6, 1e5, 500.0
PINNED_ROWS, PERIODS, PER_PERIOD = 2, 2, 16
RATIO = 0.02
"""Damping ratio of the first mode."""


def bar(across: int) -> Particles:
    """A bar that is clamped at its foot and `across` particles thick."""
    spacing = THICK / across
    axes = [(np.arange(n) + 0.5) * spacing for n in (across, across, SLENDER * across + PINNED_ROWS)]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return Particles(x, np.full(len(x), spacing**3), x[:, 2] < PINNED_ROWS * spacing, spacing)


def ring(model: Model, body: Particles, omega: float) -> tuple[float, float]:
    """Natural frequency, relative to that of beam theory, and damping ratio of the first mode."""
    length = SLENDER * THICK
    z = 1.8751 * np.clip(body.x[:, 2] - PINNED_ROWS * body.spacing, 0.0, None) / length
    mode = np.cosh(z) - np.cos(z) - 0.7341 * (np.sinh(z) - np.sin(z))
    start = State.at_rest(body.x, 1e-3 * length * omega * mode[:, None] * [1.0, 0.0, 0.0])
    path = rollout(model, start, np.zeros((PERIODS * PER_PERIOD, model.particles, 3)))
    assert (path.substeps == model.substeps).all(), "the bar broke down"
    y = (path.x[:, :, 0] - body.x[:, 0]) @ mode
    t = np.arange(len(y)) * model.frame_dt

    def residual(q: np.ndarray) -> np.ndarray:
        missed: np.ndarray = np.exp(-q[3] * t) * (q[0] * np.cos(q[2] * t) + q[1] * np.sin(q[2] * t)) - y
        return missed / np.ptp(y)

    size = np.ptp(y)
    found = least_squares(residual, [0.0, size / 2, omega, 0.01 * omega], x_scale=[size, size, omega, 0.01 * omega])
    natural = float(np.hypot(found.x[2], found.x[3]))
    return natural / omega, float(found.x[3]) / natural


def main() -> None:
    """The table, row by row."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    omega = 3.516 * np.sqrt(MODULUS * THICK**2 / (12.0 * DENSITY * (SLENDER * THICK) ** 4))
    retardation = 2.0 * RATIO / omega
    print("| particles across | substeps a period | frequency over beam theory's | own | law over closed form | all over closed form |")
    print("|---|---|---|---|---|---|")
    for across in (3, 4, 6):
        body, fps = bar(across), PER_PERIOD * omega / (2.0 * np.pi)
        material = Material("bar", "corotated", DENSITY, MODULUS, 0.3)
        model, _ = model_for(body, material, fps, gravity=(0, 0, 0), max_substeps=100_000, speed=0.01)
        fewest = substeps_for(model, retardation)
        for substeps in (model.substeps, fewest, 2 * fewest) if across < 6 else (model.substeps, fewest):  # six across take minutes
            free = replace(model, substeps=substeps)
            frequency, own = ring(free, body, omega)
            row = f"| {across} | {PER_PERIOD * substeps} | {frequency:.3f} | {own:.4f} |"
            if substeps < fewest:
                print(row, "unstable | unstable |", flush=True)
                continue
            wanted = 0.5 * frequency * omega * retardation
            _, both = ring(with_retardation(free, retardation), body, omega)
            print(row, f"{(both - own) / wanted:.3f} | {both / wanted:.2f} |", flush=True)


if __name__ == "__main__":
    main()
