"""The winds of the library: what blows, what flies in it, and how it is filed. `WINDS` has them all.

A wind is a function of places (M, 3) [m] and a time [s] that gives the velocity of the air (M, 3) [m/s]. Recover sees nothing of it but the
motion of a plate that it carries.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

Wind = Callable[[np.ndarray, float], np.ndarray]

FPS, FRAMES, OVERLAP = 24.0, 50, 10
"""Frames a second, frames that are recovered, and how many of them are mixed with the last ones so that a wind goes round."""
LOOP = (FRAMES - OVERLAP) / FPS
"""Of a wind that goes round [s]: gusts whose period divides it go on without a seam by themselves."""

CARD, LEAF, STRIP = (8, 6, 1), (6, 4, 1), (12, 4, 1)
"""Particles along the sides of a plate."""


@dataclass(frozen=True)
class Flight:
    """A plate that is let go in a wind."""

    counts: tuple[int, int, int] = CARD
    spacing: float = 0.02
    """Of its particles [m]."""
    areal_density: float = 0.5
    """kg/m²."""
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: tuple[float, float, float] = (0.4, -0.5, 0.2)
    """Rotation vector at the start [rad]; at zero its normal is Z."""
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: tuple[float, float, float] = (1.0, -2.0, 0.5)
    """rad/s."""
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Shelved:
    """A wind of the library."""

    name: str
    catalog: str
    description: str
    tags: tuple[str, ...]
    wind: Wind
    flight: Flight = field(default_factory=Flight)
    loops: bool = True
    everywhere: bool = True
    """It blows outside the box as at the box's faces; else it ends beside it."""


def _wave(t: float, times: int, phase: float = 0.0) -> float:
    """A sine that goes round so many times in a loop."""
    return float(np.sin(2.0 * np.pi * times * t / LOOP + phase))


def swelling(mean: tuple[float, float, float], share: float) -> Wind:
    """The same everywhere; its speed swells and sinks by a share."""
    return lambda x, t: np.broadcast_to(np.array(mean) * (1.0 + share * (_wave(t, 1) + 0.4 * _wave(t, 2, 1.0))), x.shape)


def gusts(mean: tuple[float, float, float], gust: tuple[float, float, float], times: int) -> Wind:
    """A mean, and gusts of two periods along another direction."""
    return lambda x, t: np.broadcast_to(np.array(mean) + np.array(gust) * (_wave(t, times) + 0.5 * _wave(t, 2 * times, 1.0)), x.shape)


def over_ground(mean: tuple[float, float, float], slope: float) -> Wind:
    """Stronger with height, by a share for each metre."""
    return lambda x, t: np.array(mean) * (1.0 + slope * x[:, 2:] + 0.2 * _wave(t, 1))


def turning(speed: float, swing: float) -> Wind:
    """Of one speed, its direction swinging by an angle [rad] to both sides of X."""
    return lambda x, t: np.broadcast_to(
        speed * np.array([np.cos(swing * _wave(t, 1)), np.sin(swing * _wave(t, 1)), 0.15 * _wave(t, 2)]), x.shape
    )


def puff(speed: float, middle: float, width: float) -> Wind:
    """One gust along X that comes and goes, over still air."""
    return lambda x, t: np.broadcast_to(np.array([0.15 + speed * np.exp(-(((t - middle) / width) ** 2)), 0.1, 0.25]), x.shape)


def whirl(axis: int, speed: float, radius: float, along: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Wind:
    """A whirl about an axis through the origin, as of a Rankine vortex with a smooth core, and a steady wind."""

    def wind(x: np.ndarray, t: float) -> np.ndarray:
        offset = np.where(np.arange(3) == axis, 0.0, x)
        turned = np.cross(np.eye(3)[axis], offset)
        swell = 1.0 + 0.15 * _wave(t, 1)
        return np.array(along) + swell * 2.0 * speed * radius * turned / (radius**2 + (offset**2).sum(axis=1, keepdims=True))

    return wind


def column(speed: float, radius: float, drawn_in: float) -> Wind:
    """Up (or down, for a negative speed) a column round Z, air drawn in from (or pushed out to) its sides."""

    def wind(x: np.ndarray, t: float) -> np.ndarray:
        near = np.exp(-(x[:, :2] ** 2).sum(axis=1, keepdims=True) / radius**2)
        inwards = -drawn_in * x[:, :2] / radius * near
        return np.concatenate([inwards, speed * (1.0 + 0.2 * _wave(t, 1)) * near], axis=1)

    return wind


def buffeting(mean: tuple[float, float, float], speed: float) -> Wind:
    """A mean with gusts from all sides whose periods differ."""

    def wind(x: np.ndarray, t: float) -> np.ndarray:
        gust = [_wave(t, 2) + 0.6 * _wave(t, 5, 0.7), _wave(t, 3, 2.1) + 0.5 * _wave(t, 4), 0.7 * _wave(t, 3, 4.0) + 0.4 * _wave(t, 5)]
        return np.broadcast_to(np.array(mean) + speed * np.array(gust), x.shape)

    return wind


BREEZES, GUSTS, WHIRLS, COLUMNS = "Breezes", "Gusts", "Whirls", "Up and Down"
LOCAL = {"everywhere": False}

WINDS = (
    Shelved("Light Breeze", BREEZES, "Leaves rustle", ("breeze", "light"), swelling((2.2, 0.3, 0.1), 0.15), Flight(LEAF, 0.02, 0.3)),
    Shelved("Fresh Breeze", BREEZES, "Small trees sway", ("breeze", "strong"), swelling((7.5, -0.6, 0.3), 0.12), Flight(areal_density=0.8)),
    Shelved(
        "Ground Wind", BREEZES, "Slow at the ground, faster above it", ("breeze", "shear", "ground"), over_ground((3.0, 0.8, 0.0), 0.6),
        Flight(tilt=(0.3, 1.3, 0.3), spin=(-1.5, 2.0, 0.0)),
    ),
    Shelved("Shifting Wind", BREEZES, "Turns to and fro", ("breeze", "turning"), turning(3.5, 0.7), Flight(tilt=(-0.7, 0.6, 0.0))),
    Shelved(
        "Street Gusts", GUSTS, "Uneven, from one side", ("gust", "loop"), gusts((3.0, -1.5, 0.8), (1.2, 0.6, -0.5), 2),
        Flight(tilt=(-0.7, 0.6, 0.0), spin=(2.0, 2.5, 1.0)),
    ),
    Shelved("Squall", GUSTS, "Strong gusts", ("gust", "strong"), gusts((7.0, 1.5, 0.6), (2.5, -1.0, 0.8), 2), Flight(areal_density=0.8)),
    Shelved("Passing Gust", GUSTS, "One gust, then still air", ("gust", "once"), puff(5.0, 0.8, 0.35), Flight(STRIP), loops=False),
    Shelved("Buffeting", GUSTS, "Restless, from all sides", ("gust", "turbulent"), buffeting((2.0, 0.0, 0.2), 0.9), Flight(LEAF, 0.025)),
    Shelved(
        "Whirl", WHIRLS, "Round an upright axis", ("vortex", "swirl"), whirl(2, 2.0, 0.5),
        Flight(LEAF, 0.025, 0.25, (0.5, 0.0, 0.0), velocity=(0.0, 1.6, 0.0)), **LOCAL,
    ),
    Shelved(
        "Dust Devil", WHIRLS, "A whirl that lifts", ("vortex", "swirl", "updraft"), whirl(2, 2.5, 0.4, (0.0, 0.0, 1.2)),
        Flight(LEAF, 0.025, 0.25, (0.4, 0.0, 0.0), velocity=(0.0, 2.0, 0.8)), **LOCAL,
    ),
    Shelved(
        "Roller", WHIRLS, "Behind a wall: round a level axis", ("vortex", "lee", "eddy"), whirl(1, 1.8, 0.5, (0.3, 0.1, 0.0)),
        Flight(LEAF, 0.025, 0.25, (0.0, 0.0, 0.5), velocity=(1.5, 0.0, 0.0)), **LOCAL,
    ),
    Shelved(
        "Updraft", COLUMNS, "Rising warm air", ("updraft", "thermal"), column(2.5, 0.6, 0.5),
        Flight(CARD, 0.02, 0.3, (0.15, -0.1, 0.0), (0.3, 0.2, 0.0), spin=(1.0, 1.0, 0.0)), **LOCAL,
    ),
    Shelved(
        "Downwash", COLUMNS, "Air from above that spreads", ("downdraft", "rotor"), column(-4.0, 0.8, -1.5),
        Flight(CARD, 0.02, 0.5, (0.2, 0.1, 0.0), (0.3, 0.4, 0.0)), **LOCAL,
    ),
)  # fmt: skip
