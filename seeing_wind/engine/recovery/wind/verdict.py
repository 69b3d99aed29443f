"""Judging a recovered wind: whether a wind can explain the force at all, and how strong the wind is."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ...conventions import beaufort, in_figures
from ...records import Particles, Recovery
from ..diagnostics.remarks import force_remarks, reaction_remarks
from .drag import AIR
from .estimate import Estimate

UNEXPLAINED = 0.5
"""Above this unexplained share of the net force, the force is not taken for a wind's."""
SPEEDS = (("mean_speed", "mean"), ("strongest_gust", "strongest_gust"))
"""Keys of speeds in `figures`, each with its key in the dictionary of Beaufort numbers."""
STRONGEST = 60.0
"""Median speed [m/s] that winds near the ground exceed only in the worst hurricanes."""


class Found(Protocol):
    """An estimate that `figures` can summarise."""

    @property
    def velocity(self) -> np.ndarray:
        """(T, N, 3) wind at the particles or vertices [m/s]."""

    @property
    def deviation(self) -> np.ndarray:
        """(T, N, 3) posterior standard deviation of the wind [m/s]."""

    @property
    def unexplained(self) -> float:
        """Share of the force that the wind does not explain."""


def objection(
    estimate: Estimate, recovery: Recovery, particles: Particles, density: float, fps: float, gravity: tuple[float, float, float]
) -> str:
    """Why a wind cannot have caused the force, as text; "" if it can have.

    Args:
        density: density of the body [kg/m³].
        gravity: known acceleration [m/s²].
    """
    acceleration = recovery.force_density / density
    if reaction_remarks(particles, acceleration, recovery.x, gravity):
        return "The force is the reaction that holds the body up against gravity."
    if not particles.pinned.any() and force_remarks(acceleration, density, recovery.x, fps, gravity):
        return "The body moves as if no air were there: the force is too small to show a wind."
    speed = float(np.median(np.linalg.norm(estimate.velocity, axis=-1)))
    if speed > STRONGEST:
        return f"It would take a wind of {speed:.0f} m/s to push a body of this weight and surface so hard: something else must move it."
    if estimate.unexplained > UNEXPLAINED:
        return f"No wind can push this surface in such directions: {100 * estimate.unexplained:.0f} % of the net force stays unexplained."
    return ""


def figures(estimate: Found) -> dict[str, Any]:
    """The report's figures for a wind, as plain values that JSON can hold."""
    over_time = estimate.velocity.mean(axis=1)
    mean = over_time.mean(axis=0)
    speed = np.linalg.norm(over_time, axis=-1)
    return {
        "unit": "m/s",
        "mean_velocity": mean.tolist(),
        "mean_speed": float(np.linalg.norm(mean)),
        "strongest_gust": float(speed.max()),
        "gusts_rms": float(np.sqrt(((over_time - mean) ** 2).sum(axis=-1).mean())),
        "beaufort": {"mean": beaufort(float(np.linalg.norm(mean))), "strongest_gust": beaufort(float(speed.max()))},
        "deviation": float(np.median(estimate.deviation)),
        "unexplained_share": estimate.unexplained,
        "drag_law": {"normal": AIR.normal, "tangential": AIR.tangential, "air_density": AIR.density},
    }


def sentence(told: dict[str, Any]) -> str:
    """The `figures` as a note for the user."""
    mean, gust = (f"{in_figures(told[key], 2)} m/s (Beaufort {told['beaufort'][number]})" for key, number in SPEEDS)
    return (
        f"Effective wind: {mean} in the mean, gusts up to {gust}. It was inferred from the body's motion by a drag law, not measured; "
        f"{100 * told['unexplained_share']:.0f} % of the net force stays unexplained."
    )
