"""Stretching: the strain of flat triangles, and a stress that a triangle carries only as long as it would not buckle.

Strain is Green's, E = (F^T F - 1) / 2, stress St. Venant and Kirchhoff's in plane stress:
S = Y / (1 - nu²) ((1 - nu) E + nu tr(E) 1) [N/m], with the tensile stiffness Y = Young's modulus times thickness.

Compression is different: real cloth buckles into folds finer than any mesh, and a mesh of stiff triangles locks, for on a curved
surface its edges are chords, shorter than the cloth between their ends, which only matters if shortening costs something. So the
principal stresses do not go below -N, the load under which a plate of the size of the triangle buckles, N = pi² D / l². This is tension
field theory (Pipkin 1986, IMA J. Appl. Math. 36, 85; Steigmann 1990, Proc. R. Soc. A 429, 141) about a small prestress; the energy is
convex in the strain, and with finer meshes N grows without bound, until buckling is the mesh's own business. What shortens by more than
`SLACK` is resisted again: there the folds are large enough for the mesh to make.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .surface import Surface

SLACK = 0.02
"""Strain of compression up to which a triangle only carries its buckling load: half a circle of eight edges shortens each by 1 %."""
FIRM = 0.1
"""Stiffness against what is compressed beyond, over the tensile stiffness."""


@dataclass(frozen=True)
class Membrane:
    """Triangles that resist stretching."""

    faces: np.ndarray
    """(F, 3)."""
    area: np.ndarray
    """(F,) at rest [m²]."""
    slope: np.ndarray
    """(F, 3, 2) gradient of each corner's hat function in the triangle's own plane at rest [1/m]."""
    stiffness: float
    """Y [N/m]."""
    poisson_ratio: float
    buckling: np.ndarray
    """(F,) load N that it carries in compression [N/m]."""


def membrane(surface: Surface, tensile_stiffness: float, poisson_ratio: float, bending_stiffness: float) -> Membrane:
    """The membrane of a surface at rest; tensile_stiffness [N/m], bending_stiffness D of the plate [N m]."""
    x, faces = surface.x, surface.faces
    b, c = x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]
    t, s = plane_axes(b, c)
    flat = np.stack([np.zeros((len(faces), 2)), _in_plane(b, t, s), _in_plane(c, t, s)], axis=1)  # (F, 3, 2)
    ends = np.roll(flat, -2, axis=1) - np.roll(flat, -1, axis=1)
    slope = np.stack([-ends[..., 1], ends[..., 0]], axis=-1) / (2.0 * surface.area)[:, None, None]
    buckling = np.pi**2 * bending_stiffness / (2.0 * surface.area)
    return Membrane(faces, surface.area, slope, tensile_stiffness, poisson_ratio, buckling)


def plane_axes(b: np.ndarray, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two orthogonal unit vectors (F, 3) in the planes of edges b and c (F, 3), the first along b."""
    t = b / np.linalg.norm(b, axis=1, keepdims=True)
    s = c - (c * t).sum(axis=1, keepdims=True) * t
    return t, s / np.linalg.norm(s, axis=1, keepdims=True)


def _in_plane(d: np.ndarray, t: np.ndarray, s: np.ndarray) -> np.ndarray:
    return np.stack([(d * t).sum(axis=1), (d * s).sum(axis=1)], axis=1)


def deformation(m: Membrane, x: np.ndarray) -> np.ndarray:
    """F (F, 3, 2) of vertices x (V, 3) [m]: where the triangle's own two axes have gone."""
    return np.einsum("fic,fia->fca", x[m.faces], m.slope)


def strain(F: np.ndarray) -> np.ndarray:
    """Green's strain (F, 3): E11, E22, 2 E12."""
    a, b = F[..., 0], F[..., 1]
    return np.stack([0.5 * ((a * a).sum(1) - 1.0), 0.5 * ((b * b).sum(1) - 1.0), (a * b).sum(1)], axis=1)


@dataclass(frozen=True)
class Principal:
    """Strain in its principal axes, moved by what a triangle carries in compression, and the stress that goes with it."""

    e: np.ndarray
    """(F, 2) the larger one first."""
    cos: np.ndarray
    """(F,) of the angle from the first axis of the triangle to the first principal axis."""
    sin: np.ndarray
    sigma: np.ndarray
    """(F, 2) principal stresses plus N, never below zero [N/m]."""
    excess: np.ndarray
    """(F, 2) by how much the strain is below -SLACK, as a negative number; else zero."""


def principal(m: Membrane, E: np.ndarray) -> Principal:
    """Principal strains and stresses of E (F, 3)."""
    Y, nu = m.stiffness, m.poisson_ratio
    shift = m.buckling * (1.0 - nu) / Y
    mean, half, shear = 0.5 * (E[:, 0] + E[:, 1]) + shift, 0.5 * (E[:, 0] - E[:, 1]), 0.5 * E[:, 2]
    radius = np.hypot(half, shear)
    angle = 0.5 * np.arctan2(shear, half)
    e = np.stack([mean + radius, mean - radius], axis=1)
    hooke = Y / (1.0 - nu**2) * (e + nu * e[:, ::-1])
    taut = hooke[:, 1] > 0.0
    folded = np.stack([Y * np.maximum(e[:, 0], 0.0), np.zeros(len(e))], axis=1)
    excess = np.minimum(e - shift[:, None] + SLACK, 0.0)
    return Principal(e, np.cos(angle), np.sin(angle), np.where(taut[:, None], hooke, folded), excess)


def energy(m: Membrane, E: np.ndarray) -> np.ndarray:
    """(F,) energy of each triangle [J], zero at rest."""
    Y, nu = m.stiffness, m.poisson_ratio
    p, N = principal(m, E), m.buckling
    hooke = 0.5 * Y / (1.0 - nu**2) * ((1.0 - nu) * (E[:, 0] ** 2 + E[:, 1] ** 2 + 0.5 * E[:, 2] ** 2) + nu * (E[:, 0] + E[:, 1]) ** 2)
    folded = 0.5 * p.sigma[:, 0] * p.e[:, 0] - N * p.e.sum(axis=1) + N**2 * (1.0 - nu) / Y
    firm = 0.5 * FIRM * Y * (p.excess**2).sum(axis=1)
    return m.area * (np.where(p.sigma[:, 1] > 0.0, hooke, folded) + firm)


def stress(m: Membrane, E: np.ndarray) -> np.ndarray:
    """Second Piola-Kirchhoff stress (F, 3): S11, S22, S12 [N/m]."""
    p = principal(m, E)
    S = _turned_back(p, p.sigma + FIRM * m.stiffness * p.excess)
    S[:, :2] -= m.buckling[:, None]
    return S


def _turned_back(p: Principal, sigma: np.ndarray) -> np.ndarray:
    """Principal stresses (F, 2) in the triangle's axes (F, 3)."""
    c, s = p.cos, p.sin
    a, b = sigma[:, 0], sigma[:, 1]
    return np.stack([a * c * c + b * s * s, a * s * s + b * c * c, (a - b) * s * c], axis=1)


def stress_tangent(m: Membrane, E: np.ndarray) -> np.ndarray:
    """dS/dE (F, 3, 3), symmetric and positive semidefinite, for strains E11, E22, 2 E12 [N/m]."""
    Y, nu = m.stiffness, m.poisson_ratio
    p = principal(m, E)
    taut, some = p.sigma[:, 1] > 0.0, p.sigma[:, 0] > 0.0
    along = np.where(taut, Y / (1.0 - nu**2), np.where(some, Y, 0.0))
    across = np.where(taut, Y / (1.0 - nu**2), 0.0)
    firm = FIRM * Y * (p.excess < 0.0)
    gap = np.maximum(p.e[:, 0] - p.e[:, 1], 1e-300)
    turning = np.where(taut, Y / (2.0 * (1.0 + nu)), 0.5 * (p.sigma[:, 0] - p.sigma[:, 1]) / gap)
    turning += 0.5 * np.where(gap > 1e-9, FIRM * Y * (p.excess[:, 0] - p.excess[:, 1]) / gap, firm[:, 0])
    c, s = p.cos, p.sin
    rotation = np.stack(  # engineering strain in the principal axes
        [np.stack([c * c, s * s, s * c], 1), np.stack([s * s, c * c, -s * c], 1), np.stack([-2 * s * c, 2 * s * c, c * c - s * s], 1)], 1
    )
    inner = np.zeros((len(E), 3, 3))
    inner[:, 0, 0], inner[:, 1, 1], inner[:, 2, 2] = along + firm[:, 0], across + firm[:, 1], turning
    inner[:, 0, 1] = inner[:, 1, 0] = np.where(taut, nu * Y / (1.0 - nu**2), 0.0)
    return rotation.transpose(0, 2, 1) @ inner @ rotation


def gradient(m: Membrane, F: np.ndarray, S: np.ndarray) -> np.ndarray:
    """(F, 3, 3) derivative of the energy by each corner's position [N], for stress S (F, 3)."""
    full = np.stack([np.stack([S[:, 0], S[:, 2]], 1), np.stack([S[:, 2], S[:, 1]], 1)], 1)
    return (m.area[:, None, None] * m.slope) @ full @ F.transpose(0, 2, 1)


def hessian(m: Membrane, F: np.ndarray, S: np.ndarray, T: np.ndarray, convex: bool = True) -> np.ndarray:
    """(F, 9, 9) second derivative of the energy by the corners' positions, corner by corner [N/m].

    Args:
        F: (F, 3, 2); S: (F, 3) stress; T: (F, 3, 3) its tangent.
        convex: leave out what compression takes away, which makes it positive semidefinite; False: the true one.
    """
    g = m.slope
    B = np.empty((len(g), 3, 3, 3))  # strain component, corner, coordinate
    B[:, 0] = F[:, None, :, 0] * g[:, :, 0, None]
    B[:, 1] = F[:, None, :, 1] * g[:, :, 1, None]
    B[:, 2] = F[:, None, :, 0] * g[:, :, 1, None] + F[:, None, :, 1] * g[:, :, 0, None]
    B = B.reshape(-1, 3, 9)
    H = B.transpose(0, 2, 1) @ (m.area[:, None, None] * T) @ B
    if convex:
        S = _tension(S)
    full = np.stack([np.stack([S[:, 0], S[:, 2]], 1), np.stack([S[:, 2], S[:, 1]], 1)], 1)
    taut = (m.area[:, None, None] * g) @ full @ g.transpose(0, 2, 1)  # (F, corner, corner)
    blocks = H.reshape(-1, 3, 3, 3, 3)
    for c in range(3):
        blocks[:, :, c, :, c] += taut
    return H


def _tension(S: np.ndarray) -> np.ndarray:
    """The stress (F, 3) without its compressive part."""
    mean, half, shear = 0.5 * (S[:, 0] + S[:, 1]), 0.5 * (S[:, 0] - S[:, 1]), S[:, 2]
    radius = np.hypot(half, shear)
    first = np.maximum(mean + radius, 0.0) / np.maximum(2.0 * radius, 1e-300)
    alone = np.stack([first * (radius + half), first * (radius - half), first * shear], axis=1)
    return np.where((mean >= radius)[:, None], S, alone)
