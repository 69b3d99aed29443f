"""Courant's condition: the substeps that a body's waves need, and how stiff it can be within the substeps allowed. Needs no compiler."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..materials import LIMITS, PLASTIC_LAWS, Material, substeps_needed
from ..records import Particles

Part = tuple[Particles, Material, float]
"""A body, its material, and the factor on its density."""


def substeps_of(particles: Particles, material: Material, fps: float) -> int:
    """Substeps per frame of one body that touches nothing and is no faster than `LIMITS.default_speed`."""
    dx, frame_dt = LIMITS.cell_spacings * particles.spacing, 1.0 / fps
    part = particles, material, 1.0
    _, needed = carried_modulus(part, dx, frame_dt, most_substeps([part], dx, frame_dt))
    return enough_substeps(LIMITS.default_speed, dx, frame_dt, needed)


def enough_substeps(speed: float, dx: float, frame_dt: float, needed: int) -> int:
    """Substeps per frame: at least those `needed` by the waves, and enough that nothing at `speed` [m/s] crosses over a cell in one."""
    return max(LIMITS.min_substeps, math.ceil(speed * frame_dt / dx), needed)


def most_substeps(parts: Iterable[Part], dx: float, frame_dt: float) -> int:
    """`LIMITS.max_substeps_held` if a body is pinned that keeps at least `LIMITS.worth` of its stiffness with it, else `max_substeps`."""
    most = LIMITS.max_substeps_held / math.sqrt(LIMITS.worth)
    held = any(np.any(part[0].pinned) and wave_substeps(part, dx, frame_dt) <= most for part in parts)
    return LIMITS.max_substeps_held if held else LIMITS.max_substeps


def wave_substeps(part: Part, dx: float, frame_dt: float) -> int:
    """Substeps per frame that the waves in the stiffest part of a body need; at most those of the part's material itself."""
    body, material, density = part
    if body.mixture is None:
        factor = 1.0 if body.stiffness is None else min(1.0, float(np.max(body.stiffness)))
        return substeps_needed(replace(material, youngs_modulus=factor * material.youngs_modulus), dx, frame_dt, density)
    nu = body.mixture.poisson_ratio
    stiffness = body.mixture.youngs_modulus * (1.0 if body.stiffness is None else np.minimum(body.stiffness, 1.0))
    squared = stiffness * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)) / body.mixture.density  # of the waves' speed, but for a factor
    i = int(np.argmax(squared))
    fastest = replace(material, youngs_modulus=float(stiffness[i]) * material.youngs_modulus, poisson_ratio=float(nu[i]))
    return substeps_needed(fastest, dx, frame_dt, density * float(body.mixture.density[i]))


def carried_modulus(part: Part, dx: float, frame_dt: float, max_substeps: int) -> tuple[float, int]:
    """Young's modulus [Pa] of a body's material, lowered if need be to what `max_substeps` allow, and the substeps that it needs."""
    material, needed = part[1], wave_substeps(part, dx, frame_dt)
    if needed > max_substeps:
        return material.youngs_modulus * (max_substeps / needed) ** 2, max_substeps
    if material.law in PLASTIC_LAWS:
        needed = min(max_substeps, max(needed, math.ceil(LIMITS.flow_substeps * frame_dt)))
    return material.youngs_modulus, needed
