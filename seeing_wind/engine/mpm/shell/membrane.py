"""Stretching: the strain of flat triangles, and a stress that is limited in compression, because triangles buckle.

Strain is Green's, E = (F^T F - 1) / 2, stress St. Venant and Kirchhoff's in plane stress:
S = Y / (1 - nu²) ((1 - nu) E + nu tr(E) 1) [N/m], with the tensile stiffness Y = Young's modulus times thickness.

Compression is different: real cloth buckles into folds finer than any mesh, and a mesh of stiff triangles locks, because on a curved
surface its edges are chords, shorter than the cloth between their ends, and shortening would cost energy. So the principal stresses do
not go below -N, with N = pi² D / l² the load under which a plate of the triangle's size buckles. This is tension field theory (Pipkin
1986, IMA J. Appl. Math. 36, 85; Steigmann 1990, Proc. R. Soc. A 429, 141) about a small prestress; the energy is convex in the strain, and
N grows without bound as the mesh is refined, so that in the end buckling is left to the mesh itself. A compressive strain beyond `SLACK`
is resisted again: such folds are large enough for the mesh to resolve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .surface import Surface

SLACK = 0.02
"""Compressive strain up to which a triangle only carries its buckling load: half a circle of eight edges shortens each by 1 %."""
FIRM = 0.1
"""Stiffness against compressive strain beyond `SLACK`, over the tensile stiffness."""


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
    """(F,) load N that a triangle carries in compression [N/m]."""


def membrane(surface: Surface, tensile_stiffness: float, poisson_ratio: float, bending_stiffness: float) -> Membrane:
    """The membrane of a surface at rest; tensile_stiffness [N/m]; bending_stiffness: D of the plate [N m]."""
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
    """Deformation F (F, 3, 2) with vertices at x (V, 3) [m]: the images of the triangle's two axes at rest."""
    return np.einsum("fic,fia->fca", x[m.faces], m.slope)


def strain(F: np.ndarray) -> np.ndarray:
    """Green's strain (F, 3): E11, E22, 2 E12."""
    a, b = F[..., 0], F[..., 1]
    return np.stack([0.5 * ((a * a).sum(1) - 1.0), 0.5 * ((b * b).sum(1) - 1.0), (a * b).sum(1)], axis=1)


def energy(m: Membrane, E: np.ndarray) -> np.ndarray:
    """Energy (F,) [J] of each triangle with strain E (F, 3), zero at rest. `face_kernels` has its derivatives."""
    Y, nu, N = m.stiffness, m.poisson_ratio, m.buckling
    shift = N * (1.0 - nu) / Y
    mean, radius = 0.5 * (E[:, 0] + E[:, 1]), np.hypot(0.5 * (E[:, 0] - E[:, 1]), 0.5 * E[:, 2])
    first, second = mean + shift + radius, mean + shift - radius
    hooke = 0.5 * Y / (1.0 - nu**2) * ((1.0 - nu) * (E[:, 0] ** 2 + E[:, 1] ** 2 + 0.5 * E[:, 2] ** 2) + nu * (E[:, 0] + E[:, 1]) ** 2)
    folded = 0.5 * Y * np.maximum(first, 0.0) ** 2 - N * (first + second) + N**2 * (1.0 - nu) / Y
    firm = 0.5 * FIRM * Y * (np.minimum(mean + radius + SLACK, 0.0) ** 2 + np.minimum(mean - radius + SLACK, 0.0) ** 2)
    return m.area * (np.where(second + nu * first > 0.0, hooke, folded) + firm)
