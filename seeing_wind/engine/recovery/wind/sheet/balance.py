"""The balance of forces on a sheet that was seen: its accelerations tell what pushed it, but for the tension in it, which nobody sees.

With h_k the hat over frames k-1 to k+1, Newton's law of the vertices, multiplied by h_k and integrated over time, is exactly

    M (x_{k+1} - 2 x_k + x_{k-1}) fps² = M g + ∫ h_k (f_bending + f_membrane + f_cause) dt / ∫ h_k dt

Places between frames are those of a spline. Bending follows from the places; the stress of the membrane does not, as cloth hardly
stretches: changes of length that nobody can see carry its whole weight. It is a hidden Gaussian (`tension`), and so are errors of what is
seen. The balance is looked at in Q smooth virtual displacements, the lowest bending modes of the sheet as it is held, of which the
forces at the clamp, also hidden, know nothing. No simulation takes part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from ....mpm.shell import Shell
from .observed import Observed
from .tension import Tension

TESTS = 15
"""Q at most. Higher ones tell of folds as small as the mesh, which two engines fold differently."""
MOST_DATA = 6000
"""(T-1) 3 Q at most: time and memory grow with its square and more. A longer clip has fewer modes."""
POINTS = 2
"""Of Gauss's rule in each frame."""
ROUGH = 0.015
"""Standard deviation of an acceleration's error at a vertex, as a part of the root mean square: what is left by the sampling in time."""
SLACK = 0.003
"""Of the edges' length: how far places between frames may be off, as the bending forces see them."""
MOMENT = 0.3
"""Error of the bending moment in each face, as a part of the root mean square: two meshes, or two clamps, of the same sheet differ so."""
INSTANT = 1e-4
"""s, of the finite difference that damps the bending."""


@dataclass(frozen=True)
class Moments:
    """When the sheet is looked at, between frames too: at S points of Gauss's rule in each of T frames."""

    x: np.ndarray
    """(T, S, V, 3) places [m] and"""
    v: np.ndarray
    """(T, S, V, 3) velocities [m/s]."""
    rising: np.ndarray
    """(S,) weights of a frame's points under the hat that ends with it, and"""
    falling: np.ndarray
    """(S,) under the one that begins with it."""

    @staticmethod
    def of(seen: Observed, plainly: bool = False) -> Moments:
        """Of a sheet's path, or `plainly` by the other interpolation."""
        at, weight = np.polynomial.legendre.leggauss(POINTS)
        at, weight = 0.5 * (1.0 + at), 0.5 * weight
        path = seen.plainly_at if plainly else seen.at
        return Moments(*path(np.arange(seen.frames)[:, None] + at), weight * at, weight * (1.0 - at))

    def over_hats(self, values: np.ndarray) -> np.ndarray:
        """Means (T-1, ...) under the hats of values (T, S, ...)."""
        return np.tensordot(values[:-1], self.rising, (1, 0)) + np.tensordot(values[1:], self.falling, (1, 0))


@dataclass(frozen=True)
class Balance:
    """K = T-1 balances of 3 Q components each [kg^1/2 m/s²]."""

    tests: np.ndarray
    """(V, Q) virtual displacements; orthonormal over the mass."""
    at: Moments
    plainly: Moments
    """The same moments by another interpolation."""
    seen: np.ndarray
    """(K, 3 Q) what the cause has to make up for: inertia less weight and bending."""
    bending: np.ndarray
    """(K, 3 Q) forces of bending."""
    hidden: np.ndarray
    """(K, 3 Q, 3 Q) covariance of tension and sampling, independent from frame to frame."""
    bent: np.ndarray
    """(3 Q, 3 Q) that of what is wrong with `bending` in some faces and not in others, which lasts."""
    noise: np.ndarray
    """(T+1, 3 Q, 3 Q) that of errors in the places of each frame, times mass and fps²: the balance has their second difference."""


def balance_of(shell: Shell, seen: Observed, gravity: np.ndarray) -> Balance:
    """The balance of a sheet that was seen in at least three frames; gravity: (3,) [m/s²]."""
    tests, squared = _modes(shell, max(1, min(TESTS, MOST_DATA // (3 * max(1, seen.frames - 1)))), seen.fps)
    at = Moments.of(seen)
    acceleration = np.diff(seen.x, 2, axis=0) * seen.fps**2 - gravity
    bent = np.array([[tests.T @ _bending(shell, *one) for one in zip(*frame, strict=True)] for frame in zip(at.x, at.v, strict=True)])
    bending = at.over_hats(bent)
    places = seen.x if seen.measured is None else seen.measured.x
    inertia = np.einsum("vq,v,kvi->kqi", tests, shell.mass, np.diff(places, 2, axis=0) * seen.fps**2 - gravity)
    free = shell.mass * ~shell.pinned
    size = float(np.sqrt(np.average((acceleration**2).sum(axis=2).mean(axis=0), weights=free)))
    tension = Tension.of(shell, tests, size)
    hidden = np.stack([tension.covariance(moved) for moved in at.over_hats(tension.gradients(at.x))])
    white = (ROUGH * size) ** 2 * float(free.sum() / np.count_nonzero(free)) * np.eye(len(hidden[0]))
    off = np.hypot(seen.noise, SLACK * shell.surface.edge_length) * np.hypot(1.0, shell.sheet.retardation * seen.fps)
    vertices = tests.T @ (shell.mass[:, None] ** 2 * tests)
    count = len(bending)
    return Balance(
        tests,
        at,
        Moments.of(seen, plainly=True),
        seen=(inertia - bending).reshape(count, -1),
        bending=bending.reshape(count, -1),
        hidden=hidden + white + _in_each_direction(off**2 * squared[:, None] * vertices * squared),
        bent=_in_each_direction(_wrong_moments(shell, seen, tests)),
        noise=_noise(shell, seen, tests),
    )


def _noise(shell: Shell, seen: Observed, tests: np.ndarray) -> np.ndarray:
    """(T+1, 3 Q, 3 Q), see `Balance`: of vertices whose errors have nothing to do with each other's, or as a camera measured them."""
    weighted = shell.mass[:, None] * tests * seen.fps**2
    if seen.measured is None:
        variances = np.broadcast_to(seen.deviation**2, seen.x.shape[:2])
        return np.stack([_in_each_direction(weighted.T @ (variance[:, None] * weighted)) for variance in variances])
    onto = np.kron(weighted.T @ seen.measured.modes, np.eye(3))
    return onto @ seen.measured.covariance.reshape(len(seen.x), len(onto.T), -1) @ onto.T


def _in_each_direction(covariance: np.ndarray) -> np.ndarray:
    """(3 Q, 3 Q) of (Q, Q)."""
    return np.kron(covariance, np.eye(3))


def _modes(shell: Shell, count: int, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """The lowest bending modes (V, Q) of the sheet as it is held, orthonormal over the mass, and their squared frequencies (Q,).

    Those that swing faster than half the frame rate are left out, but for the first: their shapes follow the load, and how stiff they are
    hangs on the mesh and on how the clamp is made.
    """
    free = np.flatnonzero(~shell.pinned)
    matrix = shell.bending.matrix[free][:, free].toarray()
    mass = shell.mass[free]
    last = min(count, len(free)) - 1
    squared, shapes = eigh(0.5 * (matrix + matrix.T), np.diag(mass), subset_by_index=(0, last))
    slow = squared <= (np.pi * fps) ** 2
    slow[0] = True
    modes = np.zeros((len(shell.mass), int(slow.sum())))
    modes[free] = shapes[:, slow]
    return modes, np.maximum(squared[slow], 0.0)


def _wrong_moments(shell: Shell, seen: Observed, tests: np.ndarray) -> np.ndarray:
    """(Q, Q) covariance, in one direction, of the forces of moments that are wrong by `MOMENT`."""
    b, count = shell.bending, len(shell.surface.faces)
    parts = [b.curvature[i * count : (i + 1) * count] for i in range(3)]
    places = seen.x.swapaxes(0, 1).reshape(len(shell.mass), -1)
    moment = np.tensordot(b.law, np.stack([part @ places for part in parts]), 1)
    size = MOMENT * float(np.sqrt((moment**2).sum(axis=0).reshape(count, -1, 3).sum(axis=2).mean() / 3.0))
    forces = [b.area[:, None] * (part @ tests) for part in parts]
    return size**2 * sum(one.T @ one for one in forces)


def _bending(shell: Shell, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Forces (V, 3) [N] of bending, damped as the sheet's material is."""

    def elastic(place: np.ndarray) -> np.ndarray:
        faces = shell.forces.faces(place)
        none = np.zeros_like(place)
        return -shell.forces.at_vertices(place, np.zeros(len(place)), none, none, replace(faces, gradient=np.zeros_like(faces.gradient)))

    rate = (elastic(x + INSTANT * v) - elastic(x - INSTANT * v)) / (2.0 * INSTANT)
    return elastic(x) + shell.sheet.retardation * rate
