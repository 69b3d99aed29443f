"""How many wind sources carry a field, how they end beside its box, and how far their sum is off the field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .kernels import choose_power, evaluate, fit_nodes, kernel, source_places
from .lattice import SampledField, differences, lattice

FADE, HOLD, CONTINUE = "FADE", "HOLD", "CONTINUE"
"""What becomes of the wind beside its box: it fades to nothing, holds the strength of the box's nearest place, or is left to the sources'
own falloff."""

RESOLUTIONS = (5, 7, 9, 12)
"""Nodes along the longest side that are tried, in this order."""

GOOD = (1.0, 0.02)
"""Mean angle [degrees] and mean relative error of the size at which more nodes are not tried."""

BETTER = 0.9
"""More nodes must bring the error to this share of the former one; otherwise the fewer are kept."""

FADE_WIDTH = 0.75
"""Of the box's longest side: over this distance beside it the wind fades. Shorter fades cost accuracy inside, where it counts."""

HOLD_REACH = 1.0
"""Of the longest side: so far the sources are held to the wind at the box's nearest place."""

BEYOND = {FADE: 0.6, HOLD: 0.3, CONTINUE: 0.3}
"""How far, in cells of the lattice, the outermost sources stand outside the box."""

OUTER_WEIGHT = 0.1
"""Of an error beside the box against one inside it. At 1 the error inside was half as large again; at 0.03 twice as much of the wind was
left at one box's length."""

FAR = (0.8, 1.5, 3.0, 6.0, 12.0)
"""Distances, in longest sides, at which a fading wind is fitted to nothing. Without them it would stay at 0.7 of its strength at 4."""

PLACES = 4000
"""Places in the box that a fit sees, at least, and three for each source: with 1000 for 343 sources the worst place was 3.6 % off, with
these 1.0 %."""

NEAR_SHARE, FAR_SHARE = 1 / 12, 1 / 60
"""Places at each distance near the box and far from it, relative to those in it."""

PROBES = 400
"""Places at which the error is measured; the fit does not see them."""


@dataclass(frozen=True)
class FieldFit:
    """A sum of wind sources, and how far it is off."""

    places: np.ndarray
    """(M, 3) of the sources, unit of the field's points."""
    vectors: np.ndarray
    """(T, M, 3) unit of the field's force."""
    power: float
    """Falloff: (1 + r)^-power."""
    resolution: int
    """Nodes along the longest side."""
    angle: float
    """Mean error of the direction in the box [degrees]."""
    size: float
    """Mean relative error of the size in the box."""
    reach: float
    """Sum of the falloffs of all sources, mean over the box: how much Blender's *Flow* acts."""
    unevenness: float
    """Standard deviation of that sum over its mean."""

    @property
    def badness(self) -> float:
        """1 where the error is just good enough."""
        return max(self.angle / GOOD[0], self.size / GOOD[1])


def fit_field(field: SampledField, resolution: int = 0, reach: str = FADE) -> FieldFit:
    """Fit sources to a field.

    Args:
        field: in scene units.
        resolution: nodes along the longest side of the box; 0 takes the fewest of `RESOLUTIONS` that are good enough.
        reach: FADE, HOLD or CONTINUE.
    """
    best = _fit(field, resolution or RESOLUTIONS[0], reach)
    for more in () if resolution else RESOLUTIONS[1:]:
        if best.badness < 1.0:
            break
        finer = _fit(field, more, reach)
        if finer.badness > BETTER * best.badness:
            break
        best = finer
    return best


def beside(box: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Distance of places (P, 3) from a box (2, 3): (P,), 0 inside."""
    return np.linalg.norm(np.maximum(np.maximum(box[0] - places, places - box[1]), 0.0), axis=-1)


def faded(distance: np.ndarray, width: float) -> np.ndarray:
    """Share of the wind that is left at a distance from the box: 1 at its faces, 0 from `width` on, smooth at both ends."""
    t = np.clip(distance / width, 0.0, 1.0)
    return 1.0 - t * t * (3.0 - 2.0 * t)


def _fit(field: SampledField, resolution: int, reach: str) -> FieldFit:
    nodes = lattice(field.box, resolution)
    inside, probes = _inside(field, max(PLACES, 3 * len(nodes)))
    places, forces = [inside[0]], [inside[1]]
    for outer, values in _outside(field, len(inside[0]), reach):
        places.append(outer)
        forces.append(values)
    weights = np.full(sum(map(len, places)), OUTER_WEIGHT)
    weights[: len(inside[0])] = 1.0
    power, standing = choose_power(nodes), source_places(nodes, BEYOND[reach])
    vectors = fit_nodes(standing, np.concatenate(places), np.concatenate(forces, axis=1), power, weights)
    off = differences(evaluate(standing, vectors, probes[0], power), probes[1])
    sums = kernel(standing, probes[0], power).sum(axis=1)
    return FieldFit(standing, vectors, power, resolution, *off, float(sums.mean()), float(sums.std() / sums.mean()))


Known = tuple[np.ndarray, np.ndarray]
"""Places (P, 3), and the field there (T, P, 3)."""


def _inside(field: SampledField, count: int) -> tuple[Known, Known]:
    """Places of a fit, and others to measure it: nodes of the field's own lattice, and places between them where these are too few."""
    rng, (low, high) = np.random.default_rng(0), field.box
    # a node on a face, edge or corner stands for half, a quarter, an eighth of the volume of one inside
    volume = 0.5 ** np.isclose((field.points - low) / (high - low) % 1.0, 0.0, atol=1e-6).sum(axis=1)
    probes = rng.choice(len(volume), min(PROBES, len(volume) // 4), replace=False, p=volume / volume.sum())
    own = rng.permutation(np.setdiff1d(np.arange(len(volume)), probes))[:count]
    amid = rng.uniform(*field.box, (max(count - len(own), 0), 3))
    places, forces = np.concatenate([field.points[own], amid]), np.concatenate([field.force[:, own], field.at(amid)], axis=1)
    return (places, forces), (field.points[probes], field.force[:, probes])


def _outside(field: SampledField, count: int, reach: str) -> list[Known]:
    """What the field is to be beside its box."""
    if reach == CONTINUE:
        return []
    side, rng = float(np.ptp(field.box, axis=0).max()), np.random.default_rng(1)
    width = side * (FADE_WIDTH if reach == FADE else HOLD_REACH)
    near = np.concatenate([_shell(field.box, share * width, round(NEAR_SHARE * count), rng) for share in (0.2, 0.5, 0.8, 1.1)])
    values = field.at(near)
    if reach == HOLD:
        return [(near, values)]
    far = np.concatenate([_shell(field.box, share * side, round(FAR_SHARE * count), rng) for share in FAR])
    values *= faded(beside(field.box, near), width)[:, None]
    return [(near, values), (far, np.zeros((len(field.force), len(far), 3)))]


def _shell(box: np.ndarray, distance: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Places (count, 3) outside a box, about as far from it as asked, on all sides."""
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    start = rng.uniform(*box, (count, 3))
    leave = np.where(ways > 0.0, box[1] - start, box[0] - start) / ways
    return start + ways * (leave.min(axis=1)[:, None] + distance)
