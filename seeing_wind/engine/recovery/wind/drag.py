"""The drag law: the force of moving air on a piece of surface.

The force on a flat piece with area A and unit normal n, in air that moves relative to it at w = u - v (wind minus the piece's velocity), is

    f = 1/2 rho A |w| [ C_n (w.n) n + C_t (w - (w.n) n) ]

The law is quasi-steady: the force is that of a steady flow at the instantaneous w. Graphics uses this form for cloth and leaves (Wejchert
and Haumann 1991; Ling, Damodaran and Gay 1996). Measurements support it: the translational force that Andersen, Pesavento and Wang (2005,
J. Fluid Mech. 541, section 5) fitted to falling plates, a drag A - B cos 2a with a lift C_T sin 2a at the angle of attack a, is exactly
this law if C_T = B, as it is there, with C_n = A + B along the normal and C_t = A - B along the plate. Their further effects
are left out: added mass, lift from rotation, and a centre of pressure that moves with the angle of attack.

A piece of a sheet has air on both sides and counts once. A piece of a closed body has air on its outer side only: it feels the full
pressure, wake included, if it faces the wind and none otherwise, and half of the friction along the surface in either case. A sheet
therefore feels the same force when it is modelled as a closed body.

As f = D(w) w with D symmetric and positive, a velocity update that is implicit in w with D held, (m/dt + D) w' = (m/dt) w, is stable at
any dt and never makes a surface overtake the wind. For one mass it is exact: w' = w / (1 + k |w| dt) solves dw/dt = -k |w| w.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DragLaw:
    """Coefficients of the law."""

    normal: float = 1.17
    """C_n, for a square or round plate across the wind (Hoerner 1965, Fluid-Dynamic Drag, section 3-5). Long strips: 1.98."""
    tangential: float = 0.05
    """C_t, for both sides of a plate along the wind. Laminar friction on 0.1 m at 3 m/s is 0.02 (Blasius); edges and ripples add to it, up
    to 0.4 for cards whose thickness is a tenth of their width (Andersen, Pesavento and Wang 2005)."""
    density: float = 1.2
    """rho [kg/m³], of air at 20 °C and sea level."""


AIR = DragLaw()
"""The coefficients used for all bodies."""

TINY = 1e-300
"""Lower bound of denominators, so that quotients stay finite where an area or a speed is zero."""


def face_forces(relative: np.ndarray, area_normal: np.ndarray, closed: bool = False) -> np.ndarray:
    """Force of the air on faces (F, 3) [N].

    Args:
        relative: (F, 3) w = u - v, wind minus the face's velocity [m/s].
        area_normal: (F, 3) unit normals times areas [m²]; those of a closed body point outwards, those of a sheet to either side.
        closed: True if the faces bound a body and have air on their outer side only; False for a sheet with air on both sides.
    """
    along, across = _coefficients(relative, area_normal, closed)
    n = _unit(area_normal)
    push = (relative * n).sum(axis=-1)
    return along[..., None] * relative + ((across - along) * push)[..., None] * n


def face_damping(relative: np.ndarray, area_normal: np.ndarray, closed: bool = False) -> np.ndarray:
    """The matrix D (F, 3, 3) [N s/m], symmetric and positive semidefinite, with `face_forces` = D w. Arguments as in `face_forces`."""
    along, across = _coefficients(relative, area_normal, closed)
    n = _unit(area_normal)
    return along[..., None, None] * np.eye(3) + (across - along)[..., None, None] * n[..., :, None] * n[..., None, :]


def face_force_derivative(relative: np.ndarray, area_normal: np.ndarray, closed: bool = False) -> np.ndarray:
    """The derivative d f / d w (F, 3, 3) [N s/m], equal to d f / d u and to - d f / d v. Arguments as in `face_forces`."""
    speed = np.linalg.norm(relative, axis=-1)
    direction = relative / np.maximum(speed, TINY)[..., None]
    # D is proportional to |w|, so the derivative of f = D w is D + (D w) (w / |w|)^T / |w|.
    damping = face_damping(relative, area_normal, closed)
    return damping + (damping @ direction[..., None]) * direction[..., None, :]


def _coefficients(relative: np.ndarray, area_normal: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Ratios of force to relative velocity, along the face and across it, (F,) each [N s/m]."""
    size = 0.5 * AIR.density * np.linalg.norm(area_normal, axis=-1) * np.linalg.norm(relative, axis=-1)
    along, across = AIR.tangential * size, AIR.normal * size
    if closed:
        windward = (relative * area_normal).sum(axis=-1) < 0.0
        along, across = 0.5 * along, np.where(windward, across, 0.0)
    return along, across


def _unit(area_normal: np.ndarray) -> np.ndarray:
    return area_normal / np.maximum(np.linalg.norm(area_normal, axis=-1, keepdims=True), TINY)


def area_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals times areas (..., F, 3) [m²] of the triangles `faces` (F, 3) of vertices (..., V, 3) [m], by the right-hand rule."""
    a, b, c = (vertices[..., faces[:, corner], :] for corner in range(3))
    return 0.5 * np.cross(b - a, c - a)


def vertex_drag(wind: np.ndarray, vertices: np.ndarray, velocity: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force of the air on the vertices of a sheet, and its damping for a semi-implicit step.

    A face feels the mean wind and moves at the mean velocity of its vertices, and passes a third of its force to each. The damping is
    lumped: a vertex gets a third of the D of each of its faces. It bounds the true damping, so v' = v + dt (m + dt D)^-1 f is stable at
    any dt.

    Args:
        wind: (V, 3) u at the vertices, or (3,) for a uniform wind [m/s].
        vertices: (V, 3) positions [m].
        velocity: (V, 3) velocities of the vertices [m/s].
        faces: (F, 3) vertex indices.

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
