"""MLS-MPM in plain NumPy: one substep, as slow and as readable as can be. The twin of `seeing_wind.engine.mpm.kernels.substep`.

Hu et al. 2018, "A moving least squares material point method", section 3 and 4.
"""

from __future__ import annotations

import itertools

import numpy as np


def polar(F: np.ndarray) -> np.ndarray:
    """The rotation of F = R S, by singular values."""
    U, _, Vt = np.linalg.svd(F)
    return U @ Vt


def hencky(F: np.ndarray, mu: float, lam: float) -> np.ndarray:
    """tau of the St. Venant-Kirchhoff law in logarithmic strain."""
    U, s, _ = np.linalg.svd(F)
    return U @ np.diag(2.0 * mu * np.log(s) + lam * np.log(s).sum()) @ U.T


def kirchhoff(law: str, F: np.ndarray, mu: float, lam: float) -> np.ndarray:
    """tau (3, 3) [Pa]."""
    J, one = np.linalg.det(F), np.eye(3)
    if law == "corotated":
        return 2.0 * mu * (F - polar(F)) @ F.T + lam * J * (J - 1.0) * one
    if law == "neo_hookean":
        return mu * (F @ F.T - one) + lam * np.log(J) * one
    return hencky(F, mu, lam)


def viscous(C: np.ndarray, mu: float, lam: float, viscosity: float) -> np.ndarray:
    """tau (3, 3) [Pa] of the rate of strain in an elastic law, a Kelvin-Voigt solid."""
    rate = 0.5 * (C + C.T)
    return viscosity / mu * (2.0 * mu * rate + lam * np.trace(rate) * np.eye(3))


def energy(law: str, F: np.ndarray, mu: float, lam: float) -> float:
    """psi [J/m³] with tau = dpsi/dF F^T."""
    J = np.linalg.det(F)
    if law == "corotated":
        return mu * ((F - polar(F)) ** 2).sum() + 0.5 * lam * (J - 1.0) ** 2
    if law == "neo_hookean":
        return 0.5 * mu * ((F**2).sum() - 3.0) - mu * np.log(J) + 0.5 * lam * np.log(J) ** 2
    e = np.log(np.linalg.svd(F, compute_uv=False))
    return mu * (e**2).sum() + 0.5 * lam * e.sum() ** 2


def return_mapping(F: np.ndarray, mu: float, yield_stress: float, viscosity: float, dt: float) -> np.ndarray:
    """F after von Mises flow, with Bingham's viscosity."""
    U, s, Vt = np.linalg.svd(F)
    e = np.log(s)
    deviator = e - e.mean()
    trial, limit = 2.0 * mu * np.linalg.norm(deviator), np.sqrt(2.0 / 3.0) * yield_stress
    if trial <= limit:
        return F
    stress = (viscosity * trial + mu * dt * limit) / (viscosity + mu * dt)
    return U @ np.diag(np.exp(e.mean() + deviator * stress / trial)) @ Vt


def weights(x: np.ndarray, offset: np.ndarray, dx: float):
    """(node index (3,), weight) of the 27 nodes that a particle at x touches."""
    local = (x - offset) / dx
    base = np.floor(local - 0.5).astype(int)
    f = local - base
    w = np.array([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2])
    for i, j, k in itertools.product(range(3), repeat=3):
        yield (base[0] + i, base[1] + j, base[2] + k), w[i, 0] * w[j, 1] * w[k, 2]


def substep(model, law: str, dt: float, state, acceleration: np.ndarray, gradient: np.ndarray):
    """x, v, C, F after dt. `acceleration` includes gravity."""
    dx, offset = model.dx, model.offset
    mass, momentum = {}, {}
    for p, x in enumerate(state.x):
        tau = kirchhoff(law, state.F[p], model.mu[p], model.lam[p])
        if law in ("corotated", "neo_hookean"):
            tau = tau + viscous(state.C[p], model.mu[p], model.lam[p], model.viscosity[p])
        A = model.mass[p] * (state.C[p] + dt * gradient[p]) - dt * model.volume[p] * 4.0 / dx**2 * tau
        for node, w in weights(x, offset, dx):
            distance = offset + dx * np.array(node) - x
            mass[node] = mass.get(node, 0.0) + w * model.mass[p]
            momentum[node] = momentum.get(node, 0.0) + w * (model.mass[p] * (state.v[p] + dt * acceleration[p]) + A @ distance)
    velocity = {node: momentum[node] / mass[node] for node in mass}
    for node in velocity:
        index = np.array(node) - model.clamp_lo
        if np.all(index >= 0) and np.all(index < model.clamp.shape) and model.clamp[tuple(index)]:
            velocity[node] = np.zeros(3)
    x_next, v_next, C_next, F_next = (np.empty_like(array) for array in (state.x, state.v, state.C, state.F))
    for p, x in enumerate(state.x):
        near = list(weights(x, offset, dx))
        v_next[p] = sum(w * velocity[node] for node, w in near)
        C_next[p] = 4.0 / dx**2 * sum(w * np.outer(velocity[node], offset + dx * np.array(node) - x) for node, w in near)
        F_next[p] = (np.eye(3) + dt * C_next[p]) @ state.F[p]
        if law in ("von_mises", "viscoplastic"):
            viscosity = model.viscosity[p] if law == "viscoplastic" else 0.0
            F_next[p] = return_mapping(F_next[p], model.mu[p], model.yield_stress[p], viscosity, dt)
        x_next[p] = x if model.pinned[p] else x + dt * v_next[p]
    return x_next, v_next, C_next, F_next
