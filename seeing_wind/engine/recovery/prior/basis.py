"""The functions in which the solve writes its unknowns: smooth modes over the body, hats over time, and possible initial motions.

    a(X, t) = sum_j phi_j(X) sum_k H_k(t) c_kj        acceleration [m/s²] in interval t of the particle with rest position X

The modes are polynomials of the rest position, orthonormal over the body's mass, and sorted by their expected size in a smooth field.
Polynomials along a thin axis are nearly constant and are left out: a plate gets functions of two coordinates, a rod of one.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ...errors import ObjectError
from .constants import PRIOR


@dataclass(frozen=True)
class SpatialBasis:
    """P orthonormal modes on N particles, in the order of their expected size in a smooth field."""

    phi: np.ndarray
    """(N, P) values; the mass-weighted mean of phi_i phi_j is 1 for i = j, else 0. phi[:, 0] = 1."""
    gradient: np.ndarray
    """(N, P, 3) d phi / d X [1/m]."""
    degree: np.ndarray
    """(P,) polynomial degree."""
    size: np.ndarray
    """(P,) standard deviation of the mode in a random field with the correlation length `radius` (Taylor terms of a Gaussian kernel)."""
    radius: float
    """Largest distance from the centre of mass [m]."""
    centre: np.ndarray
    """(3,) centre of mass [m]."""

    def first(self, count: int) -> SpatialBasis:
        """The first `count` modes."""
        return SpatialBasis(self.phi[:, :count], self.gradient[:, :count], self.degree[:count], self.size[:count], self.radius, self.centre)

    def up_to(self, degree: int) -> SpatialBasis:
        """The modes of at most this degree."""
        keep = self.degree <= degree
        return SpatialBasis(self.phi[:, keep], self.gradient[:, keep], self.degree[keep], self.size[keep], self.radius, self.centre)


def spatial_basis(x: np.ndarray, mass: np.ndarray, modes: int) -> SpatialBasis:
    """At most `modes` smooth orthonormal functions of the rest positions.

    Args:
        x: (N, 3) rest positions [m].
        mass: (N,) weights of the inner product (mass, or ones).
        modes: most modes to return; there are fewer for few particles or thin bodies.

    Raises:
        ObjectError: when all points coincide but there are several of them.
    """
    x, weight = np.asarray(x, np.float64), np.asarray(mass, np.float64) / np.sum(mass)
    centre = weight @ x
    radius = float(np.linalg.norm(x - centre, axis=1).max())
    if len(x) == 1:
        return SpatialBasis(np.ones((1, 1)), np.zeros((1, 1, 3)), np.zeros(1, int), np.ones(1), 1.0, centre)
    if not radius > 0.0:
        raise ObjectError("All particles of the body are in one place.", "Build the body again: its particles must fill a volume.")
    moments, axes = np.linalg.eigh(np.einsum("n,ni,nj->ij", weight, x - centre, x - centre))
    thin = np.sqrt(np.maximum(moments, 0.0)) < PRIOR.thin * np.sqrt(moments[2])
    axes = axes.T[::-1]  # longest first
    thin = thin[::-1]
    local = (x - centre) @ axes.T / radius

    phi, gradient, degree, size = [np.ones(len(x))], [np.zeros((len(x), 3))], [0], [1.0]
    for order in range(1, PRIOR.max_degree + 1):
        exponents = itertools.product(range(order + 1), repeat=3)
        for exponent in (e for e in exponents if sum(e) == order and not any(np.array(e)[thin])):
            value, slope = _monomial(local, exponent)
            scale = 1.0 / math.sqrt(math.prod(math.factorial(e) for e in exponent))
            for _ in range(2):  # Gram-Schmidt twice is stable
                for known, known_slope in zip(phi, gradient, strict=True):
                    share = weight @ (known * value)
                    value, slope = value - share * known, slope - share * known_slope
            norm = math.sqrt(weight @ value**2)
            if norm < 1e-6:  # on these particles, it depends linearly on the functions before it
                continue
            phi.append(value / norm)
            gradient.append(slope / norm)
            degree.append(order)
            size.append(norm * scale)
    # A stable sort by degree first: the coefficients of a smooth field fall with the degree whatever the body's shape.
    rank = np.lexsort((-np.array(size), np.array(degree)))[: min(modes, len(x))]
    slopes = np.stack(gradient, axis=1)[:, rank] @ axes / radius
    return SpatialBasis(np.stack(phi, axis=1)[:, rank], slopes, np.array(degree)[rank], np.array(size)[rank], radius, centre)


def told_apart(modes: np.ndarray, least: float) -> int:
    """How many of the first modes can be told apart by their values (K, M) at some points: each has, beyond what the modes before it
    explain, at least the share `least` of a mode of unit size."""
    if not len(modes):
        return 0
    own = np.abs(np.diag(np.linalg.qr(modes, mode="r"))) >= least * math.sqrt(len(modes))
    return int(np.argmin(np.append(own, False)))


def _monomial(local: np.ndarray, exponent: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """x^e0 y^e1 z^e2 at (N, 3) and its gradient (N, 3)."""
    powers = [local[:, axis] ** exponent[axis] for axis in range(3)]
    slope = np.zeros_like(local)
    for axis in range(3):
        if exponent[axis]:
            others = math.prod([1.0] + [powers[other] for other in range(3) if other != axis])
            slope[:, axis] = exponent[axis] * local[:, axis] ** (exponent[axis] - 1) * others
    return powers[0] * powers[1] * powers[2], slope


def knots(frames: int, spacing: float) -> np.ndarray:
    """Knots at 0, spacing, 2 spacing ... until the last of the `frames` is reached, so that a longer clip has the same first knots."""
    return spacing * np.arange(math.ceil((frames - 1) / spacing - 1e-9) + 1)


def hats(frames: int, spacing: float) -> np.ndarray:
    """Linear hat functions H (frames, knots): row t contains the weights of the knots in frame t and sums to one."""
    at = knots(frames, spacing)
    return np.stack([np.interp(np.arange(frames), at, column) for column in np.eye(len(at))], axis=1)


@dataclass(frozen=True)
class Knots:
    """The knots of a force in time."""

    at: np.ndarray
    """(K,) times of the knots [frames]."""
    hats: np.ndarray
    """(T, K) weights of the knots in each frame: they sum to one, or to zero in still air."""
    spacing: float
    """Frames between neighbouring knots."""


def runs_of(frames: np.ndarray) -> list[tuple[int, int]]:
    """The runs of consecutive True in frames (T,) bool, each as its first frame and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], frames, [False]]).astype(int))).tolist()
    return list(zip(edges[::2], edges[1::2]))


def knots_between(still: np.ndarray, spacing: float) -> Knots:
    """Knots for the frames that are not `still` (T,) bool, separate in each run of them, as the air does not come to rest gradually.

    If all frames are still, there is one knot without any effect.
    """
    parts = [(begin + knots(end - begin, spacing), begin, end) for begin, end in runs_of(~still)]
    at = np.concatenate([one for one, _, _ in parts]) if parts else np.zeros(1)
    weights, first = np.zeros((len(still), len(at))), 0
    for one, begin, end in parts:
        weights[begin:end, first : first + len(one)] = hats(end - begin, spacing)
        first += len(one)
    return Knots(at, weights, spacing)


def held_axis(x: np.ndarray, pinned: np.ndarray) -> np.ndarray | None:
    """Unit vector (3,) from the pinned part to the free part, for particles x (N, 3) of which some, not all, are `pinned` (N,) bool.

    None if neither part lies to one side of the other, as with a membrane that is held all round.
    """
    along = x[~pinned].mean(axis=0) - x[pinned].mean(axis=0)
    length, size = np.linalg.norm(along), np.linalg.norm(x - x.mean(axis=0), axis=1).max()
    return along / length if length > PRIOR.axis * size else None


def velocity_basis(x: np.ndarray, basis: SpatialBasis, pinned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The possible initial motions: velocities (V, N, 3) and their gradients d v_i / d X_j (V, N, 3, 3), with unit speed at the rim.

    A free body may move and spin (V = 6). A held body may swing (V = 3): a uniform velocity times a ramp that is zero, with zero slope, at
    the nearest pinned particle.
    """
    if pinned.any():
        held = x[pinned]
        distance, nearest = cKDTree(held).query(x)
        reach = max(float(distance.max()), 1e-12)
        ramp = (distance / reach) ** 2
        slope = 2.0 * (x - held[nearest]) / reach**2
        velocity = np.einsum("ij,n->inj", np.eye(3), ramp)
        return velocity, np.einsum("ij,nk->injk", np.eye(3), slope)
    return rigid_motions(x, basis.centre, basis.radius)


def rigid_motions(x: np.ndarray, centre: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Three uniform motions and three spins about `centre` (3,) with unit speed at `radius` [m], in the form of `velocity_basis`, V = 6."""
    velocity, gradient = np.zeros((6, len(x), 3)), np.zeros((6, len(x), 3, 3))
    for axis in range(3):
        velocity[axis, :, axis] = 1.0
        spin = np.cross(np.eye(3)[axis], np.eye(3)).T  # spin @ r = e_axis x r
        velocity[3 + axis] = (x - centre) @ spin.T / radius
        gradient[3 + axis] = spin / radius
    return velocity, gradient
