"""A field on a regular lattice, as sampled by the engine: what solvers, Geometry Nodes and exports read. NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...engine.errors import UsageError
from .display import FORCE, WIND
from .texture.reach import FADE, Reach, left_near, reach_of

CELLS = 24
"""Cells along a box's longest side at which the engine samples the field. For a recovered field with waves shorter than the body, linear
interpolation was off the engine's own values by 0.4 degrees and 0.8 % in the mean."""

GROUP = 4
"""Numbers of cells are multiples of this, so that a lattice can be thinned twice."""

CLEAR = 0.05
"""Forces below this share of their frame's root mean square are left out of comparisons, as their direction means little."""

ENOUGH = (0.25, 0.005)
"""Mean angle [degrees] and relative error of the size up to which a coarser lattice is good enough; the latter also for a fade's share."""


def lattice(box: np.ndarray, resolution: int = 6) -> np.ndarray:
    """Nodes of a regular lattice that fills a box, its faces included.

    Args:
        box: (2, 3) lower and upper corner [m].
        resolution: nodes along the longest side; the others get as many as give a similar spacing, at least 3.

    Returns:
        (M, 3) nodes [m], z fastest.
    """
    side = _sides(box)
    return _filled(box, np.clip(np.round((resolution - 1) * side / side.max()).astype(int) + 1, 3, max(resolution, 3)))


def fine_lattice(box: np.ndarray, cells: int = CELLS) -> np.ndarray:
    """Nodes (L, 3) [m], z fastest, at which the engine samples the field of a box (2, 3), with about `cells` along the longest side."""
    side = _sides(box)
    return _filled(box, GROUP * np.maximum(np.round(cells / GROUP * side / side.max()).astype(int), 1) + 1)


def lattice_counts(nodes: np.ndarray) -> tuple[int, int, int]:
    """Nodes along x, y, z of a full lattice (M, 3), z fastest.

    Raises:
        ValueError: when the nodes do not form such a lattice.
    """
    size = max(1e-9, float(np.ptp(nodes, axis=0).max()))
    axes = [np.unique(np.round(nodes[:, k] / size, 5)) for k in range(3)]
    counts = (len(axes[0]), len(axes[1]), len(axes[2]))
    full = _filled(np.stack([nodes.min(axis=0), nodes.max(axis=0)]), np.array(counts))
    if full.shape != np.shape(nodes) or not np.allclose(full, nodes, atol=1e-5 * size):
        raise ValueError("the nodes do not fill a lattice")
    return counts


def differences(found: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    """Mean angle [degrees] and mean relative difference of the size between vectors (T, P, 3), without weak ones (`CLEAR`)."""
    size_found, size_truth = np.linalg.norm(found, axis=-1), np.linalg.norm(truth, axis=-1)
    clear = size_truth > CLEAR * np.sqrt((size_truth**2).mean(axis=-1, keepdims=True))
    if not clear.any():
        return 0.0, 0.0
    product = (found * truth).sum(axis=-1)[clear] / np.maximum(size_found * size_truth, np.finfo(float).tiny)[clear]
    angle = np.degrees(np.arccos(np.clip(product, -1.0, 1.0)))
    return float(angle.mean()), float(np.abs(size_found[clear] / size_truth[clear] - 1.0).mean())


@dataclass(frozen=True)
class SampledField:
    """A force density on a lattice, constant from each frame to the next."""

    points: np.ndarray
    """(L, 3) nodes of the lattice, z fastest, in any unit of length."""
    force: np.ndarray
    """(T, L, 3) in any unit."""
    confidence: np.ndarray
    """(T, L) in 0..1."""
    velocity: np.ndarray | None = None
    """(T, L, 3) velocity of the wind that causes the force, in any unit; None if the field is a force only."""
    distance: np.ndarray | None = None
    """(T, L) distance from the filmed object, in the unit of the nodes; None if the field is known everywhere."""

    def __post_init__(self) -> None:
        """Refuse arrays that do not agree. Raises UsageError."""
        shape = np.shape(self.force)
        if len(shape) != 3 or shape[0] < 1 or shape[1:] != np.shape(self.points) or np.shape(self.confidence) != shape[:2]:
            raise UsageError(
                f"The field's samples have the shape {shape} for nodes of the shape {np.shape(self.points)}.",
                "Expected (T, L, 3) for (L, 3), and a confidence for each.",
            )
        if self.velocity is not None and np.shape(self.velocity) != shape:
            raise UsageError(f"The wind's samples have the shape {np.shape(self.velocity)}.", f"Expected {shape}.")
        if self.distance is not None and np.shape(self.distance) != shape[:2]:
            raise UsageError(f"The distances have the shape {np.shape(self.distance)}.", f"Expected {shape[:2]}.")
        if not all(np.isfinite(each).all() for each in (self.force, self.confidence, self.velocity, self.distance) if each is not None):
            raise UsageError("The sampled field is not finite everywhere.", "Recover it again.")
        try:
            lattice_counts(self.points)
        except ValueError as error:
            raise UsageError("The nodes do not fill a lattice.", "Use nodes as `fine_lattice` gives them.") from error

    @property
    def counts(self) -> tuple[int, int, int]:
        """Nodes along x, y, z."""
        return lattice_counts(self.points)

    @property
    def box(self) -> np.ndarray:
        """(2, 3) lower and upper corner."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    def felt_as(self, kind: str, reach: Reach | None = None) -> SampledField:
        """The field that solvers are to feel: the velocity in place of the force if `kind` is WIND; weakened by `reach`, if given."""
        felt = self.velocity if kind == WIND else self.force
        if reach is not None:
            felt = felt * self.left(reach)[..., None]
        return SampledField(self.points, felt, self.confidence)

    def left(self, reach: Reach) -> np.ndarray:
        """Share (T, L) of the field that its reach leaves at the nodes."""
        return left_near(reach, np.zeros(self.force.shape[:2]) if self.distance is None else self.distance)

    def some(self, keep: np.ndarray) -> SampledField:
        """The field at the nodes `keep` (indices), which must fill a lattice, too."""
        wind, distance = self.velocity, self.distance
        return SampledField(
            self.points[keep], self.force[:, keep], self.confidence[:, keep], None if wind is None else wind[:, keep],
            None if distance is None else distance[:, keep],
        )  # fmt: skip

    def distance_at(self, places: np.ndarray) -> np.ndarray:
        """The distance (T, P) at places (P, 3), interpolated as in `at`; only for a field that has a distance."""
        return SampledField(self.points, np.repeat(self.distance[..., None], 3, axis=-1), self.confidence).at(places)[..., 0]

    def at(self, places: np.ndarray) -> np.ndarray:
        """The force (T, P, 3) at places (P, 3), linear between the nodes; outside the box, that of the nearest place in it."""
        counts, (low, high) = np.array(self.counts), self.box
        where = np.clip((places - low) / (high - low), 0.0, 1.0) * (counts - 1)
        corner = np.minimum(where.astype(int), counts - 2)
        t = where - corner
        # all frames of a node side by side, to be copied at once
        nodes = np.ascontiguousarray(self.force.swapaxes(0, 1), dtype=np.float64).reshape(len(self.points), -1)
        found = np.zeros((len(places), nodes.shape[1]))
        for offset in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(offset, t, 1.0 - t), axis=1)
            part = nodes.take(np.ravel_multi_index(tuple((corner + offset).T), tuple(counts)), axis=0)
            part *= weight[:, None]
            found += part
        return found.reshape(len(places), -1, 3).swapaxes(0, 1)

    def thinned(self) -> SampledField:
        """The coarsest lattice, halved repeatedly, that reproduces the field (`ENOUGH`): most fields need far fewer nodes."""
        counts = self.counts
        if any(count % 2 == 0 or count < 5 for count in counts):
            return self
        keep = np.arange(len(self.points)).reshape(counts)[::2, ::2, ::2].ravel()
        coarse, fade = self.some(keep), reach_of(FADE, self.box)
        for kind in (FORCE, WIND) if self.velocity is not None else (FORCE,):
            angle, size = differences(coarse.felt_as(kind).at(self.points), self.felt_as(kind).force)
            if angle >= ENOUGH[0] or size >= ENOUGH[1]:
                return self
        left = SampledField(coarse.points, np.repeat(coarse.left(fade)[..., None], 3, axis=-1), coarse.confidence).at(self.points)[..., 0]
        return coarse.thinned() if np.abs(left - self.left(fade)).mean() < ENOUGH[1] else self

    def error_between_nodes(self) -> tuple[float, float]:
        """Estimated error of linear interpolation: mean angle [degrees] and mean relative error of the size.

        Every second node along each axis is left out, and its value is compared with the interpolation from the others. At twice the
        spacing the error is four times as large; its mean over all nodes is then three times that over the box at the actual spacing.
        """
        keep = np.arange(len(self.points)).reshape(self.counts)[tuple(slice(None, None, 2 if count % 2 else 1) for count in self.counts)]
        angle, size = differences(self.some(keep.ravel()).at(self.points), self.force)
        return angle / 3.0, size / 3.0


def _sides(box: np.ndarray) -> np.ndarray:
    low, high = np.asarray(box, dtype=np.float64)
    return np.maximum(high - low, 1e-9)


def _filled(box: np.ndarray, counts: np.ndarray) -> np.ndarray:
    axes = [np.linspace(box[0][k], box[1][k], counts[k]) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
