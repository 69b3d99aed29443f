"""The six kinds of object of the paper's synthetic scenes, made by scripts: simple, but recognisable.

About half a metre tall, facing -Y. Stiffness and yield stress are chosen so that the winds of `fields` bend, and the plastic ones
mark, them visibly within a clip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from seeing_wind.engine.materials import Material

from .shapes import Part, Solid, box, capsule, cylinder, ellipsoid

RED, BLUE, YELLOW, BLACK = (0.78, 0.16, 0.13), (0.16, 0.30, 0.66), (0.94, 0.76, 0.22), (0.10, 0.09, 0.09)
GREEN, DARK_GREEN, BROWN, TERRACOTTA = (0.32, 0.60, 0.22), (0.20, 0.44, 0.18), (0.36, 0.22, 0.12), (0.74, 0.40, 0.26)
FUR, MUZZLE, WOOD, CUSHION = (0.66, 0.46, 0.28), (0.88, 0.76, 0.58), (0.62, 0.42, 0.24), (0.70, 0.24, 0.26)
BUN, SAUSAGE, MUSTARD = (0.86, 0.64, 0.34), (0.68, 0.26, 0.16), (0.95, 0.80, 0.18)


@dataclass(frozen=True)
class Thing:
    """An object of the tables."""

    name: str
    kind: str
    """The paper's material type: elastic, elastoplastic, viscoplastic."""
    solid: Solid
    material: Material
    field: str
    """Name of the one of `fields` that acts on it."""
    spacing: float
    """Spacing of the true simulation's particles [m]; the recovery's are coarser."""
    held: Callable[[np.ndarray], np.ndarray] | None = None
    """Which points (M, 3) at rest are held."""


def lego() -> Thing:
    """A toy-brick figure with legs, torso, arms and a studded head."""
    parts = [
        Part(box((-0.055, 0, -0.17), (0.045, 0.045, 0.085)), BLUE),
        Part(box((0.055, 0, -0.17), (0.045, 0.045, 0.085)), BLUE),
        Part(box((0, 0, -0.075), (0.10, 0.045, 0.025)), BLUE),
        Part(box((0, 0, 0.03), (0.095, 0.05, 0.085)), RED),
        Part(cylinder((0, 0, 0.185), 2, 0.065, 0.065, 0.02), YELLOW),
        Part(cylinder((0, 0, 0.255), 2, 0.035, 0.02), YELLOW),
        Part(ellipsoid((-0.025, -0.062, 0.20), (0.011, 0.008, 0.014)), BLACK),
        Part(ellipsoid((0.025, -0.062, 0.20), (0.011, 0.008, 0.014)), BLACK),
        Part(capsule((-0.02, -0.062, 0.163), (0.02, -0.062, 0.163), 0.007), BLACK),
    ]
    for side in (-1, 1):
        parts.append(Part(capsule((side * 0.105, 0, 0.085), (side * 0.15, -0.02, -0.02), 0.032), RED))
        parts.append(Part(ellipsoid((side * 0.157, -0.03, -0.05), (0.032, 0.032, 0.032)), YELLOW))
    solid = Solid(tuple(parts), (-0.2, -0.08, -0.26), (0.2, 0.08, 0.28))
    return Thing("Lego", "elastic", solid, elastic(6e4), "front", 0.0145)


def ficus() -> Thing:
    """A potted plant with a forked trunk and broad leaves; the pot is held."""
    parts = [
        Part(cylinder((0, 0, -0.21), 2, 0.075, 0.055, 0.012), TERRACOTTA),
        Part(cylinder((0, 0, -0.165), 2, 0.085, 0.018), TERRACOTTA),
        Part(cylinder((0, 0, -0.148), 2, 0.066, 0.012), BROWN),
        Part(capsule((0, 0, -0.16), (0, 0, 0.02), 0.03), BROWN),
        Part(capsule((0, 0, 0.0), (-0.09, 0, 0.13), 0.025), BROWN),
        Part(capsule((0, 0, 0.0), (0.09, 0.01, 0.14), 0.025), BROWN),
        Part(capsule((0, 0, 0.02), (0.0, 0.0, 0.20), 0.024), BROWN),
    ]
    random = np.random.default_rng(3)
    tips = [(-0.09, 0, 0.13), (0.09, 0.01, 0.14), (0, 0, 0.2), (-0.05, 0, 0.08), (0.05, 0, 0.08)]
    for k in range(17):
        tip = np.array(tips[k % len(tips)])
        angle = 2 * np.pi * (k * 0.382)
        out = np.array([np.cos(angle), -0.5 * abs(np.sin(angle)), 0.55 * np.sin(angle) + 0.1])
        out /= np.linalg.norm(out)
        facing = np.cross(out, [0.0, 1.0, 0.15 * random.normal()])
        facing /= np.linalg.norm(facing)
        axes = np.stack([out, facing, np.cross(out, facing)], axis=1)
        parts.append(Part(ellipsoid(tip + 0.06 * out, (0.07, 0.038, 0.02), axes), GREEN if k % 2 else DARK_GREEN))
    solid = Solid(tuple(parts), (-0.27, -0.15, -0.28), (0.27, 0.15, 0.35))
    return Thing("Ficus", "elastic", solid, elastic(1.2e5), "breeze", 0.0145, held=lambda x: x[:, 2] < -0.15)


def sunflower() -> Thing:
    """A flower with a brown disc, a ring of petals, a stem and two leaves; the foot of the stem is held."""
    parts = [
        Part(capsule((0, 0, -0.27), (0, 0, 0.10), 0.03), GREEN),
        Part(cylinder((0, -0.01, 0.14), 1, 0.085, 0.035, 0.02), BROWN),
        Part(ellipsoid((-0.085, 0, -0.10), (0.085, 0.02, 0.035), _tilted(0.5)), DARK_GREEN),
        Part(ellipsoid((0.085, 0, -0.05), (0.085, 0.02, 0.035), _tilted(-0.5)), DARK_GREEN),
    ]
    for k in range(14):
        angle = 2 * np.pi * k / 14
        out = np.array([np.cos(angle), 0.0, np.sin(angle)])
        axes = np.stack([out, [0.0, 1.0, 0.0], np.cross(out, [0.0, 1.0, 0.0])], axis=1)
        parts.append(Part(ellipsoid(np.array([0, 0, 0.14]) + 0.115 * out, (0.065, 0.02, 0.026), axes), YELLOW))
    solid = Solid(tuple(parts), (-0.2, -0.07, -0.31), (0.2, 0.05, 0.34))
    return Thing("Sunflower", "elastic", solid, elastic(2.0e5), "swirl", 0.0135, held=lambda x: x[:, 2] < -0.24)


def toy() -> Thing:
    """A soft bear."""
    parts = [
        Part(ellipsoid((0, 0, -0.06), (0.11, 0.085, 0.125)), FUR),
        Part(ellipsoid((0, -0.03, -0.07), (0.075, 0.065, 0.09)), MUZZLE),
        Part(ellipsoid((0, 0, 0.13), (0.095, 0.08, 0.085)), FUR),
        Part(ellipsoid((0, -0.07, 0.11), (0.04, 0.03, 0.03)), MUZZLE),
        Part(ellipsoid((0, -0.098, 0.122), (0.014, 0.01, 0.011)), BLACK),
    ]
    for side in (-1, 1):
        parts.append(Part(ellipsoid((side * 0.075, 0, 0.205), (0.035, 0.026, 0.035)), FUR))
        parts.append(Part(ellipsoid((side * 0.035, -0.074, 0.155), (0.011, 0.01, 0.012)), BLACK))
        parts.append(Part(capsule((side * 0.09, -0.01, 0.0), (side * 0.155, -0.05, -0.06), 0.036), FUR))
        parts.append(Part(capsule((side * 0.06, -0.01, -0.15), (side * 0.095, -0.07, -0.2), 0.043), FUR))
        parts.append(Part(ellipsoid((side * 0.099, -0.105, -0.205), (0.028, 0.012, 0.028)), MUZZLE))
    solid = Solid(tuple(parts), (-0.21, -0.13, -0.26), (0.21, 0.1, 0.26))
    return Thing("Toy", "elastoplastic", solid, plastic("von_mises", 5e4, 350.0), "squeeze", 0.0155)


def chair() -> Thing:
    """A chair with four legs, a cushion and a slatted back."""
    parts = [
        Part(box((0, 0, -0.03), (0.145, 0.13, 0.024)), WOOD),
        Part(box((0, 0, 0.002), (0.125, 0.115, 0.018), 0.014), CUSHION),
        Part(box((0, 0.115, 0.235), (0.145, 0.024, 0.035)), WOOD),
        Part(box((0, 0.115, 0.12), (0.145, 0.022, 0.028)), WOOD),
    ]
    for side in (-1, 1):
        parts.append(Part(box((side * 0.12, 0.115, 0.11), (0.026, 0.026, 0.15)), WOOD))
        for depth in (-1, 1):
            parts.append(Part(box((side * 0.117, depth * 0.105, -0.15), (0.027, 0.027, 0.115)), WOOD))
    solid = Solid(tuple(parts), (-0.18, -0.16, -0.29), (0.18, 0.17, 0.29))
    return Thing("Chair", "elastoplastic", solid, plastic("von_mises", 1.2e5, 900.0), "shear", 0.0145)


def hotdog() -> Thing:
    """A sausage in a bun with a line of mustard."""
    parts = [
        Part(ellipsoid((0, 0.03, -0.035), (0.215, 0.075, 0.055)), BUN),
        Part(ellipsoid((0, 0.055, 0.035), (0.215, 0.055, 0.055)), BUN),
        Part(capsule((-0.21, -0.02, 0.0), (0.21, -0.02, 0.0), 0.042), SAUSAGE),
    ]
    corners = [(-0.19 + 0.038 * k, -0.058, 0.018 if k % 2 else -0.014) for k in range(11)]
    parts += [Part(capsule(a, b, 0.011), MUSTARD) for a, b in zip(corners, corners[1:])]
    solid = Solid(tuple(parts), (-0.27, -0.09, -0.11), (0.27, 0.13, 0.11))
    return Thing("Hotdog", "viscoplastic", solid, plastic("viscoplastic", 5e4, 250.0, viscosity=40.0), "waves", 0.0145)


def elastic(youngs_modulus: float) -> Material:
    """Soft rubber foam."""
    return Material("foam", "neo_hookean", density=200.0, youngs_modulus=youngs_modulus, poisson_ratio=0.3)


def plastic(law: str, youngs_modulus: float, yield_stress: float, viscosity: float = 0.0) -> Material:
    """Something like dough."""
    return Material("dough", law, 200.0, youngs_modulus, 0.3, yield_stress, viscosity)


def _tilted(angle: float) -> np.ndarray:
    """Axes turned about Y [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


THINGS: dict[str, Callable[[], Thing]] = {
    "Lego": lego, "Ficus": ficus, "Sunflower": sunflower, "Toy": toy, "Chair": chair, "Hotdog": hotdog,
}  # fmt: skip
