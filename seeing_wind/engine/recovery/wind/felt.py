"""What a body felt, and what it would feel in another wind: the observation of the inverse.

The recovered force is taken as modes over the body, as the solve writes it (`recovery.prior.basis`): the first is the net force, the next
hold the torque. So is the wind on the body,

    u(X, t) = sum_k phi_k(X) c_k(t)         [m/s]

and the same modes of the drag's acceleration are

    g_j(t) = 1/M sum_e phi_j(X_e) f(u(X_e, t) - v_e)         [m/s²]

summed over the pieces of the surface, each with its own velocity and normal in the middle of the frame: the force is a mean over it.
Of the modes only those combinations are data that the motion shows: a pressure that merely stretches the body leaves no trace, and the
solve takes it for zero (`recovery.prior.stretch`). Of a stiff body what remains is the net force and the torque.
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
"""Singular values of the stretch below this share of the largest are none."""


@dataclass(frozen=True)
class Felt:
    """Modes of the acceleration that a recovery found, and the moving surface that has to explain them."""

    measured: np.ndarray
    """(T, D) what is seen of the modes: the net force's acceleration first, then what of its variation does not stretch the body [m/s²]."""
    seen: np.ndarray
    """(T, D, P, 3): measured = seen . modes; the rows are orthonormal."""
    deviation: np.ndarray
    """(T, D) their standard deviation [m/s²]."""
    phi: np.ndarray
    """(E, P) modes at the pieces."""
    share: np.ndarray
    """(E,) part of a piece that is free to move: what is held feels air, too, but does not show it."""
    velocity: np.ndarray
    """(T, E, 3) [m/s]."""
    normals: np.ndarray
    """(T, E, 3) [m²]."""
    mass: float
    """M [kg], of what is free."""
    closed: bool

    @property
    def net(self) -> np.ndarray:
        """(D,) bool: of the net force."""
        return np.arange(self.measured.shape[1]) < 3

    @property
    def size(self) -> np.ndarray:
        """(D,) the root mean square acceleration [m/s²] over the frames that tell of one, for each of the data."""
        squares = (self.measured**2).sum(axis=1)
        return np.full(self.measured.shape[1], np.sqrt(squares.sum() / max(np.count_nonzero(squares), 1)))

    @property
    def modes(self) -> int:
        """P."""
        return self.phi.shape[1]

    @property
    def uniform_modes(self) -> list[int]:
        """Those that are the same everywhere on the body."""
        return [0]

    def predicted(self, wind: np.ndarray) -> np.ndarray:
        """What would be measured (T, D) [m/s²] in a wind of coefficients (T, P, 3) [m/s]."""
        force = face_forces(self._relative(wind), self.normals, closed=self.closed)
        modes = np.einsum("ej,tei->tji", self.phi * self.share[:, None], force) / self.mass
        return np.einsum("tdji,tji->td", self.seen, modes)

    def slopes(self, wind: np.ndarray) -> np.ndarray:
        """d predicted[t, d] / d wind[t, k, b], (T, D, P, 3) [1/s]: a frame's wind matters to that frame only."""
        slope = face_force_derivative(self._relative(wind), self.normals, closed=self.closed)
        pairs = np.einsum("ej,ek->ejk", self.phi * self.share[:, None], self.phi).reshape(len(self.phi), -1)
        both = np.einsum("eq,teab->tqab", pairs, slope, optimize=True) / self.mass
        modes = self.phi.shape[1]
        return np.einsum("tdja,tjkab->tdkb", self.seen, both.reshape(len(both), modes, modes, 3, 3))

    def without(self, still: np.ndarray) -> Felt:
        """The same without the frames `still` (T,), whose force tells of no wind."""
        heard = ~still[:, None]
        return replace(self, measured=self.measured * heard, seen=self.seen * heard[..., None, None])

    def uniform(self) -> np.ndarray:
        """(T, 3) a first wind [m/s]: along each frame's net force, and as strong over the surface that faces it as that force needs."""
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
    """What the recovered force did to the body.

    Args:
        density: of the body [kg/m³].
        basis: the modes, orthonormal over what is free.
    """
    mass = density * particles.volume * ~particles.pinned
    total = float(mass.sum())
    acceleration = recovery.force_density / density
    modes = np.einsum("np,tni->tpi", mass[:, None] * basis.phi, acceleration) / total
    seen = _seen(stretch_rows(basis, particles.x, recovery.F, np.arange(len(modes))))
    variance = np.einsum("n,tni->ti", mass, (recovery.deviation / density) ** 2) / total / basis.phi.shape[1]  # of a mode
    places = [surface.normals(x, F) for x, F in zip(recovery.x, recovery.F, strict=True)]
    attachment = surface.attachment
    free = (~particles.pinned).astype(float)[None, :, None]
    return Felt(
        measured=np.einsum("tdpi,tpi->td", seen, modes),
        seen=seen,
        deviation=np.sqrt(np.einsum("tdpi,ti->td", seen**2, variance)),
        phi=np.einsum("ej,ejp->ep", attachment.weight, basis.phi[attachment.index]),
        share=attachment.follow(free)[0, :, 0],
        velocity=fps * np.diff(np.stack([attachment.follow(x) for x in recovery.x]), axis=0),  # all at once takes too much memory
        normals=0.5 * (np.stack(places[:-1]) + np.stack(places[1:])),
        mass=total,
        closed=surface.closed,
    )


def _seen(stretch: np.ndarray) -> np.ndarray:
    """(T, D, P, 3) orthonormal combinations of the modes that do not stretch the body; `stretch` (T, M, P, 3) are those that do.

    The net force is the first three.
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
