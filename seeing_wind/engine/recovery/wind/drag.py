"""The drag law: the force of moving air on a piece of surface.

A flat piece with area A and unit normal n, which the air passes at w = u - v (wind minus the surface's own velocity), feels

    f = 1/2 rho A |w| [ C_n (w.n) n + C_t (w - (w.n) n) ]

It is quasi-steady: the force is that of a steady flow at this instant. The form is that of cloth and leaves in graphics (Wejchert and
Haumann 1991; Ling, Damodaran and Gay 1996). Measurements support it: the translational force that Andersen, Pesavento and Wang (2005,
J. Fluid Mech. 541, section 5) fitted to falling plates, a drag A - B cos 2a with a lift C_T sin 2a at the angle of attack a, is this law
exactly where C_T = B, as it is there, with C_n = A + B along the normal and C_t = A - B along the plate. Left out are what
they find besides: added mass, lift from rotation, and a centre of pressure that moves with the angle of attack.

A sheet has air on both sides and counts once. Of a closed body each piece has air on one side: where that is the windward one it feels
the pressure, wake included, on the other nothing; of the friction along the surface each side has half. A sheet taken as a closed body
therefore feels the same.

As f = D(w) w with D symmetric and positive, a velocity update that is implicit in w with D held, (m/dt + D) w' = (m/dt) w, is stable at
any dt and never carries a surface past the wind. For one mass it is exact: w' = w / (1 + k |w| dt) solves dw/dt = -k |w| w.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DragLaw:
    """Coefficients of the law."""

    normal: float = 1.17
    """C_n, of a square or round plate across the wind (Hoerner 1965, Fluid-Dynamic Drag, section 3-5). Long strips: 1.98."""
    tangential: float = 0.05
    """C_t, both sides of a plate along the wind. Laminar friction on 0.1 m at 3 m/s is 0.02 (Blasius); edges and ripples add to it, up to
    0.4 for cards of a tenth of their width in thickness (Andersen, Pesavento and Wang 2005)."""
    density: float = 1.2
    """rho [kg/m³], of air at 20 °C and sea level."""


AIR = DragLaw()
"""The law of all bodies."""

TINY = 1e-300
"""Keeps quotients finite where an area or a speed is zero."""


def face_forces(relative: np.ndarray, area_normal: np.ndarray, closed: bool = False) -> np.ndarray:
    """Force of the air on faces (F, 3) [N].

    Args:
        relative: (F, 3) w = u - v, wind minus the face's velocity [m/s].
        area_normal: (F, 3) unit normals times areas [m²]; of a closed body they point outwards, of a sheet to either side.
        closed: the faces bound a body, air is on their outer side only; False: a sheet with air on both sides.
    """
    along, across = _coefficients(relative, area_normal, closed)
    n = _unit(area_normal)
    push = (relative * n).sum(axis=-1)
    return along[..., None] * relative + ((across - along) * push)[..., None] * n


def face_damping(relative: np.ndarray, area_normal: np.ndarray, closed: bool = False) -> np.ndarray:
    """D (F, 3, 3) [N s/m], symmetric and positive semidefinite, with `face_forces` = D w. Arguments as there."""
    along, across = _coefficients(relative, area_normal, closed)
    n = _unit(area_normal)
    return along[..., None, None] * np.eye(3) + (across - along)[..., None, None] * n[..., :, None] * n[..., None, :]


def face_force_derivative(relative: np.ndarray, area_normal: np.ndarray, closed: bool = False) -> np.ndarray:
    """d f / d w (F, 3, 3) [N s/m], which is d f / d u and - d f / d v. Arguments as in `face_forces`."""
    speed = np.linalg.norm(relative, axis=-1)
    direction = relative / np.maximum(speed, TINY)[..., None]
    # D is in proportion to |w|, so f = D w has the derivative D + (D w) (w / |w|)' / |w|.
    damping = face_damping(relative, area_normal, closed)
    return damping + (damping @ direction[..., None]) * direction[..., None, :]


def _coefficients(relative: np.ndarray, area_normal: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Force over velocity along the face and across it, (F,) each [N s/m]."""
    size = 0.5 * AIR.density * np.linalg.norm(area_normal, axis=-1) * np.linalg.norm(relative, axis=-1)
    along, across = AIR.tangential * size, AIR.normal * size
    if closed:
        windward = (relative * area_normal).sum(axis=-1) < 0.0
        along, across = 0.5 * along, np.where(windward, across, 0.0)
    return along, across


def _unit(area_normal: np.ndarray) -> np.ndarray:
    return area_normal / np.maximum(np.linalg.norm(area_normal, axis=-1, keepdims=True), TINY)


def area_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals times areas (..., F, 3) [m²] of triangles `faces` (F, 3) on vertices (..., V, 3) [m], by the right-hand rule."""
    a, b, c = (vertices[..., faces[:, corner], :] for corner in range(3))
    return 0.5 * np.cross(b - a, c - a)


def vertex_drag(wind: np.ndarray, vertices: np.ndarray, velocity: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force of the air on the vertices of a sheet, and its damping for a semi-implicit step.

    A face takes the mean wind and velocity of its vertices and gives each a third of its force. The damping is lumped: a vertex gets a
    third of D of each of its faces. It bounds the true one, so v' = v + dt (m + dt D)^-1 f is stable at any dt.

    Args:
        wind: (V, 3) u at the vertices, or (3,) everywhere [m/s].
        vertices: (V, 3) [m].
        velocity: (V, 3) of the vertices [m/s].
        faces: (F, 3) indices.

    Returns:
        Force (V, 3) [N] and damping (V, 3, 3) [N s/m].
    """
    relative = (np.broadcast_to(wind, velocity.shape) - velocity)[faces].mean(axis=1)
    damping = face_damping(relative, area_normals(vertices, faces))
    share = np.concatenate([(damping @ relative[..., None])[..., 0], damping.reshape(-1, 9)], axis=1) / 3.0
    total = np.zeros((len(vertices), share.shape[1]))
    for corner in range(3):
        np.add.at(total, faces[:, corner], share)
    return total[:, :3], total[:, 3:].reshape(-1, 3, 3)
