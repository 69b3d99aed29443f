"""Laws with plastic flow: Hencky strain, von Mises yield, with or without viscosity. Forward only.

The stress is tau = U diag(2 mu e_i + lam tr e) U^T with the Hencky strains e_i = log s_i of F = U diag(s) V^T (St. Venant-Kirchhoff in
logarithmic strain). No V is needed: U and s² are the eigenvectors and eigenvalues of F F^T.

`yield_stress` is the stress Y at which a bar yields in tension: |dev tau| = sqrt(2/3) Y. Several MPM codes compare |dev tau| with their
yield stress itself; a number taken from one of them is sqrt(3/2) = 1.2247 times as large here.

Sources: Simo 1992, "Algorithms for static and dynamic multiplicative plasticity that preserve the classical return mapping schemes";
Perzyna's overstress as in Simo and Hughes, "Computational inelasticity", section 2.7; Bingham's fluid |s| = sqrt(2/3) Y + 2 eta |d_p|.
"""
# Taichi reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import taichi as ti

VON_MISES = 2
VISCOPLASTIC = 3
PLASTIC_LAWS = {"von_mises": VON_MISES, "viscoplastic": VISCOPLASTIC}
"""Plastic laws by the names that materials use."""

_SWEEPS = 6
"""Jacobi sweeps: convergence is quadratic, four reach double precision for any 3x3 matrix met here."""


@ti.func
def rotate_pair(S, U, p: ti.template(), q: ti.template()):
    """One Jacobi rotation that brings S[p, q] to zero: S <- G^T S G, U <- U G."""
    if ti.abs(S[p, q]) > 1e-300:
        theta = (S[q, q] - S[p, p]) / (2.0 * S[p, q])
        t = 1.0 / (ti.abs(theta) + ti.sqrt(theta * theta + 1.0))
        if theta < 0.0:
            t = -t
        c = 1.0 / ti.sqrt(t * t + 1.0)
        G = ti.Matrix.identity(ti.f64, 3)
        G[p, p], G[q, q], G[p, q], G[q, p] = c, c, t * c, -t * c
        S = G.transpose() @ S @ G
        U = U @ G
    return S, U


@ti.func
def stretches(F):
    """U (3, 3) and Hencky strains (3,): eigenvectors and half the logarithms of the eigenvalues of F F^T, by Jacobi's method.

    Closed forms lose half the digits where two stretches meet, as they do at rest.
    """
    S = F @ F.transpose()
    U = ti.Matrix.identity(ti.f64, 3)
    for _ in range(_SWEEPS):
        S, U = rotate_pair(S, U, 0, 1)
        S, U = rotate_pair(S, U, 0, 2)
        S, U = rotate_pair(S, U, 1, 2)
    return U, 0.5 * ti.log(ti.Vector([S[0, 0], S[1, 1], S[2, 2]]))


@ti.func
def spread(U, d):
    """U diag(d) U^T."""
    return U @ ti.Matrix([[d[0], 0.0, 0.0], [0.0, d[1], 0.0], [0.0, 0.0, d[2]]]) @ U.transpose()


@ti.func
def hencky(F, mu, lam):
    """tau = U diag(2 mu e + lam tr e) U^T."""
    U, e = stretches(F)
    return spread(U, 2.0 * mu * e + lam * e.sum())


@ti.func
def plastic_flow(law, F, mu, yield_stress, viscosity, dt):
    """F of a trial substep -> F after plastic flow. The volume stays; von Mises is the limit of no viscosity."""
    U, e = stretches(F)
    mean = e.sum() / 3.0
    deviator = e - mean
    trial = 2.0 * mu * deviator.norm()
    limit = ti.sqrt(2.0 / 3.0) * yield_stress
    flowed = F
    if trial > limit:
        stress = limit
        if law == VISCOPLASTIC:
            # Backward Euler of d_p = (|s| - limit) / (2 eta): stable however small the viscosity.
            stress = (viscosity * trial + mu * dt * limit) / (viscosity + mu * dt)
        flowed = spread(U, ti.exp((stress / trial - 1.0) * deviator)) @ F
    return flowed
