"""The balance of forces on an observed sheet: its acceleration gives the sum of the cause and the tension, and the tension is hidden.

With h_k the hat over frames k-1 to k+1, Newton's law of the vertices, multiplied by h_k and integrated over time, is exactly

    M (x_{k+1} - 2 x_k + x_{k-1}) fps² = M g + ∫ h_k (f_bending + f_membrane + f_cause) dt / ∫ h_k dt

Positions between frames are interpolated by a spline. Bending follows from the positions; membrane stress does not, as cloth hardly
stretches: changes of length too small to see carry its whole weight. The stress is a hidden Gaussian variable (`tension`), and so are the
errors of the observed positions. The balance is evaluated in Q smooth virtual displacements, the lowest bending modes of the sheet as it is
held; these vanish at the clamp, whose unknown forces therefore drop out. No simulation is needed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh

from ....mpm.shell import Shell
from .observed import Observed
from .tension import Tension

TESTS = 15
"""Largest Q. Higher modes describe folds as small as the mesh, which differ between engines."""
MOST_DATA = 6000
"""Largest (T-1) 3 Q: time and memory grow at least with its square. A longer clip gets fewer modes."""
POINTS = 2
"""Points of Gauss's rule in each frame."""
ROUGH = 0.015
"""Standard deviation of the error of a vertex's acceleration, relative to the root mean square: what sampling in time leaves."""
SLACK = 0.003
"""Error of positions between frames in the bending forces, relative to the length of the edges."""
MOMENT = 0.3
"""Error of the bending moment in each face, relative to the root mean square: two meshes or two clamps of one sheet differ by as much."""
INSTANT = 1e-4
"""Step of the finite difference for the damping of the bending [s]."""


@dataclass(frozen=True)
class Moments:
    """A sheet's state at the times where the balance is evaluated: S points of Gauss's rule in each of T intervals between frames."""

    x: np.ndarray
    """(T, S, V, 3) positions [m]."""
    v: np.ndarray
    """(T, S, V, 3) velocities [m/s]."""
    rising: np.ndarray
    """(S,) weights of an interval's points under the hat whose peak is at the interval's end."""
    falling: np.ndarray
    """(S,) weights under the hat whose peak is at the interval's start."""

    @staticmethod
    def of(seen: Observed, catmull_rom: bool = False) -> Moments:
        """The moments of a sheet's path, interpolated by the cubic spline or by Catmull and Rom's."""
        at, weight = np.polynomial.legendre.leggauss(POINTS)
        at, weight = 0.5 * (1.0 + at), 0.5 * weight
        path = seen.catmull_rom_at if catmull_rom else seen.at
        return Moments(*path(np.arange(seen.frames)[:, None] + at), weight * at, weight * (1.0 - at))

    def over_hats(self, values: np.ndarray) -> np.ndarray:
        """Means (T-1, ...) of values (T, S, ...), weighted by the hats."""
        return np.tensordot(values[:-1], self.rising, (1, 0)) + np.tensordot(values[1:], self.falling, (1, 0))


@dataclass(frozen=True)
class Balance:
    """K = T-1 balances of 3 Q components each [kg^1/2 m/s²]."""

    tests: np.ndarray
    """(V, Q) virtual displacements, orthonormal over the mass."""
    at: Moments
    """The sheet's state, interpolated by a cubic spline."""
    catmull_rom: Moments
    """The same moments by Catmull and Rom's interpolation."""
    seen: np.ndarray
    """(K, 3 Q) generalised forces that cause and tension have to provide: inertia less weight and bending."""
    bending: np.ndarray
    """(K, 3 Q) generalised forces of bending."""
    hidden: np.ndarray
    """(K, 3 Q, 3 Q) covariance of tension and of sampling errors, independent from frame to frame."""
    bent: np.ndarray
    """(3 Q, 3 Q) covariance of the error in `bending` from wrong moments in individual faces, which changes only slowly over the frames."""
    noise: np.ndarray
    """(T+1, 3 Q, 3 Q) covariance of each frame's position errors times mass and fps²; the balance contains their second difference."""


def balance_of(shell: Shell, seen: Observed, gravity: np.ndarray) -> Balance:
    """The balance of forces on a sheet that was seen in at least three frames; gravity: (3,) [m/s²]."""
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
        Moments.of(seen, catmull_rom=True),
        seen=(inertia - bending).reshape(count, -1),
        bending=bending.reshape(count, -1),
        hidden=hidden + white + _in_each_direction(off**2 * squared[:, None] * vertices * squared),
        bent=_in_each_direction(_wrong_moments(shell, seen, tests)),
        noise=_noise(shell, seen, tests),
    )


def _noise(shell: Shell, seen: Observed, tests: np.ndarray) -> np.ndarray:
    """`Balance.noise` (T+1, 3 Q, 3 Q): for independent errors of the vertices, or with the covariance of a camera's measurement."""
    weighted = shell.mass[:, None] * tests * seen.fps**2
    if seen.measured is None:
        variances = np.broadcast_to(seen.deviation**2, seen.x.shape[:2])
        return np.stack([_in_each_direction(weighted.T @ (variance[:, None] * weighted)) for variance in variances])
    onto = np.kron(weighted.T @ seen.measured.modes, np.eye(3))
    return onto @ seen.measured.covariance.reshape(len(seen.x), len(onto.T), -1) @ onto.T


def _in_each_direction(covariance: np.ndarray) -> np.ndarray:
    """Covariance (3 Q, 3 Q) of three independent directions, each with the covariance (Q, Q)."""
    return np.kron(covariance, np.eye(3))


def _modes(shell: Shell, count: int, fps: float) -> tuple[np.ndarray, np.ndarray]:
    """The lowest bending modes (V, Q) of the sheet as it is held, orthonormal over the mass, and their squared frequencies (Q,).

    Modes that oscillate faster than half the frame rate are left out, except for the first: they follow the load quasi-statically, and
    their stiffness depends on the mesh and on the details of the clamp.
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
    """Covariance (Q, Q), in one direction, of the generalised forces of bending moments with the relative error `MOMENT`."""
    b, count = shell.bending, len(shell.surface.faces)
    parts = [b.curvature[i * count : (i + 1) * count] for i in range(3)]
    places = seen.x.swapaxes(0, 1).reshape(len(shell.mass), -1)
    moment = np.tensordot(b.law, np.stack([part @ places for part in parts]), 1)
    size = MOMENT * float(np.sqrt((moment**2).sum(axis=0).reshape(count, -1, 3).sum(axis=2).mean() / 3.0))
    forces = [b.area[:, None] * (part @ tests) for part in parts]
    return size**2 * sum(one.T @ one for one in forces)


def _bending(shell: Shell, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Forces (V, 3) [N] of bending, with the damping of the sheet's material."""

    def elastic(place: np.ndarray) -> np.ndarray:
        faces = shell.forces.faces(place)
        none = np.zeros_like(place)
        return -shell.forces.at_vertices(place, np.zeros(len(place)), none, none, replace(faces, gradient=np.zeros_like(faces.gradient)))

    rate = (elastic(x + INSTANT * v) - elastic(x - INSTANT * v)) / (2.0 * INSTANT)
    return elastic(x) + shell.sheet.retardation * rate
