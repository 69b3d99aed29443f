"""The force that a body felt, and the force that it would feel in a given wind: data and forward model of the inverse problem.

The recovered force is expressed in modes over the body, as in the solve (`recovery.prior.basis`): the first is the net force, and the next
contain the torque. The wind on the body is expressed in the same modes,

    u(X, t) = sum_k phi_k(X) c_k(t)         [m/s]

and the modes of the acceleration by drag are

    g_j(t) = 1/M sum_e phi_j(X_e) f(u(X_e, t) - v_e)         [m/s²]

summed over the pieces of the surface, with their velocities and normals in the middle of the frame, as a force is a mean over its frame.
The data are only those combinations of modes that show in the motion: a pressure that merely stretches the body leaves no trace, and the
solve takes it for zero (`recovery.prior.stretch`). For a stiff body, the net force and the torque remain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...records import Particles, Recovery
from ..prior.basis import SpatialBasis
from ..prior.stretch import stretch_rows
from .drag import AIR, face_force_derivative, face_forces
from .surface import BodySurface

RANK = 1e-3
"""Singular values of the stretch below this share of the largest count as zero."""


@dataclass(frozen=True)
class Felt:
    """The acceleration that a recovery found, in modes, and the moving surface on which a wind has to produce it."""

    measured: np.ndarray
    """(T, D) visible combinations of the modes [m/s²]: the net force's first, then those of its variation that do not stretch the body."""
    seen: np.ndarray
    """(T, D, P, 3) the visible combinations: measured = seen . modes; the rows are orthonormal."""
    deviation: np.ndarray
    """(T, D) standard deviation of `measured` [m/s²]."""
    phi: np.ndarray
    """(E, P) modes at the pieces."""
    share: np.ndarray
    """(E,) the part of each piece that is free to move: pinned parts feel the air, too, but do not show it."""
    velocity: np.ndarray
    """(T, E, 3) velocities of the pieces [m/s]."""
    normals: np.ndarray
    """(T, E, 3) unit normals times areas of the pieces [m²]."""
    mass: float
    """M, the mass of the particles that are not pinned [kg]: all accelerations here are those of the body's material, whatever its parts
    are made of, as it is their force that counts."""
    closed: bool
    """As in `drag.face_forces`."""

    @property
    def net(self) -> np.ndarray:
        """(D,) bool: which data belong to the net force."""
        return np.arange(self.measured.shape[1]) < 3

    @property
    def size(self) -> np.ndarray:
        """(D,) root mean square acceleration [m/s²] over the frames in which it is not zero, the same for all data."""
        squares = (self.measured**2).sum(axis=1)
        return np.full(self.measured.shape[1], np.sqrt(squares.sum() / max(np.count_nonzero(squares), 1)))

    @property
    def modes(self) -> int:
        """P, the number of modes."""
        return self.phi.shape[1]

    @property
    def uniform_modes(self) -> list[int]:
        """Indices of the modes that are constant over the body."""
        return [0]

    def predicted(self, wind: np.ndarray) -> np.ndarray:
        """The data (T, D) [m/s²] that a wind with the coefficients (T, P, 3) [m/s] would give."""
        force = face_forces(self._relative(wind), self.normals, closed=self.closed)
        modes = np.einsum("ej,tei->tji", self.phi * self.share[:, None], force) / self.mass
        return np.einsum("tdji,tji->td", self.seen, modes)

    def slopes(self, wind: np.ndarray) -> np.ndarray:
        """Derivatives d predicted[t, d] / d wind[t, k, b] (T, D, P, 3) [1/s]; the wind of a frame affects that frame only."""
        slope = face_force_derivative(self._relative(wind), self.normals, closed=self.closed)
        pairs = np.einsum("ej,ek->ejk", self.phi * self.share[:, None], self.phi).reshape(len(self.phi), -1)
        both = np.einsum("eq,teab->tqab", pairs, slope, optimize=True) / self.mass
        modes = self.phi.shape[1]
        return np.einsum("tdja,tjkab->tdkb", self.seen, both.reshape(len(both), modes, modes, 3, 3))

    def without(self, still: np.ndarray) -> Felt:
        """The same with the data of the frames `still` (T,) set to zero, as their force says nothing about the wind."""
        heard = ~still[:, None]
        return replace(self, measured=self.measured * heard, seen=self.seen * heard[..., None, None])

    def uniform(self) -> np.ndarray:
        """(T, 3) a first guess of the wind [m/s]: along each frame's net force, and so strong that drag on the area facing it makes it."""
        net = self.measured[:, :3]
        size = np.linalg.norm(net, axis=1, keepdims=True)
        direction = net / np.maximum(size, 1e-12)
        facing = np.maximum(np.einsum("tei,ti->te", self.normals, direction), 0.0).sum(axis=1)
        if not self.closed:
            facing = np.abs(np.einsum("tei,ti->te", self.normals, direction)).sum(axis=1)
        area = np.maximum(facing, 0.1 * np.median(facing))[:, None]
        return self.velocity.mean(axis=1) + direction * np.sqrt(2.0 * self.mass * size / (AIR.density * AIR.normal * area))

    def _relative(self, wind: np.ndarray) -> np.ndarray:
        return np.einsum("ek,tki->tei", self.phi, wind) - self.velocity


def felt_force(
    recovery: Recovery, particles: Particles, density: float, surface: BodySurface, basis: SpatialBasis, fps: float
) -> Felt:
    """The recovered force on the body, as data for a wind.

    Args:
        density: density of the body's material [kg/m³].
        basis: the modes, orthonormal over the volume that is not pinned.
    """
    mass = density * particles.volume * ~particles.pinned
    total = float(mass.sum())
    acceleration = recovery.force_density / density
    modes = np.einsum("np,tni->tpi", mass[:, None] * basis.phi, acceleration) / total
    seen = _seen(stretch_rows(basis, particles.x, recovery.F, np.arange(len(modes))))
    variance = np.einsum("n,tni->ti", mass, (recovery.deviation / density) ** 2) / total / basis.phi.shape[1]  # of each mode
    places = [surface.normals(x, F) for x, F in zip(recovery.x, recovery.F, strict=True)]
    attachment = surface.attachment
    free = (~particles.pinned).astype(float)[None, :, None]
    return Felt(
        measured=np.einsum("tdpi,tpi->td", seen, modes),
        seen=seen,
        deviation=np.sqrt(np.einsum("tdpi,ti->td", seen**2, variance)),
        phi=np.einsum("ej,ejp->ep", attachment.weight, basis.phi[attachment.index]),
        share=attachment.follow(free)[0, :, 0],
        velocity=fps * np.diff(np.stack([attachment.follow(x) for x in recovery.x]), axis=0),  # by frames, to save memory
        normals=0.5 * (np.stack(places[:-1]) + np.stack(places[1:])),
        mass=total,
        closed=surface.closed,
    )


def _seen(stretch: np.ndarray) -> np.ndarray:
    """Orthonormal combinations of the modes that do not stretch the body (T, D, P, 3), given M that do, `stretch` (T, M, P, 3).

    The first three are the net force.
    """
    frames, _, modes, _ = stretch.shape
    net = np.tile(np.eye(3, 3 * modes), (frames, 1, 1))
    rest = 3 * (modes - 1)
    if rest:
        size, directions = np.linalg.svd(stretch[:, :, 1:].reshape(frames, -1, rest))[1:]
        rank = int((size > RANK * size.max()).sum(axis=1).max()) if size.size else 0
        varying = np.zeros((frames, rest - rank, 3 * modes))
        varying[:, :, 3:] = directions[:, rank:]
        net = np.concatenate([net, varying], axis=1)
    return net.reshape(frames, -1, modes, 3)
