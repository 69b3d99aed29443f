"""Elastic laws as small functions F -> Kirchhoff stress tau = J sigma [Pa], and their adjoints.

Every adjoint takes `tau_bar` = d loss / d tau and returns F_bar = d loss / d F. No singular values anywhere: nothing to divide by
when two of them meet, as they do at rest.

Sources: corotated: Stomakhin et al. 2012, "Energetically consistent invertible elasticity", psi = mu |F - R|² + lam/2 (J - 1)²;
neo-Hookean: Bonet and Wood, "Nonlinear continuum mechanics", psi = mu/2 (|F|² - 3) - mu log J + lam/2 (log J)²;
polar factor: Higham 1986, "Computing the polar decomposition".
"""
# Taichi reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import taichi as ti

from .plasticity import PLASTIC_LAWS, hencky

COROTATED = 0
NEO_HOOKEAN = 1
ELASTIC_LAWS = {"corotated": COROTATED, "neo_hookean": NEO_HOOKEAN}
LAWS = ELASTIC_LAWS | PLASTIC_LAWS
"""All laws by the names that materials use."""

_POLAR_ITERATIONS = 30
_POLAR_TOLERANCE = 1e-24
"""Squared change at which Newton's iteration has long been exact: it converges quadratically."""


@ti.func
def polar_rotation(F):
    """R of F = R S by Newton's iteration R <- (R + R^-T) / 2 (Higham 1986); det F > 0."""
    R = F
    change = 1.0
    iteration = 0
    while change > _POLAR_TOLERANCE and iteration < _POLAR_ITERATIONS:
        R_next = 0.5 * (R + R.inverse().transpose())
        change = (R_next - R).norm_sqr()
        R = R_next
        iteration += 1
    return R


@ti.func
def corotated(F, mu, lam):
    """tau = 2 mu (F - R) F^T + lam J (J - 1) I."""
    R = polar_rotation(F)
    J = F.determinant()
    return 2.0 * mu * (F - R) @ F.transpose() + lam * J * (J - 1.0) * ti.Matrix.identity(ti.f64, 3)


@ti.func
def neo_hookean(F, mu, lam):
    """tau = mu (F F^T - I) + lam log J I."""
    J = F.determinant()
    return mu * (F @ F.transpose()) + (lam * ti.log(J) - mu) * ti.Matrix.identity(ti.f64, 3)


@ti.func
def kirchhoff(plastic: ti.template(), law, F, mu, lam):
    """tau of the particle's law; `plastic` is a constant that keeps the plastic laws out of kernels that do not need them."""
    tau = ti.Matrix.zero(ti.f64, 3, 3)
    if law == NEO_HOOKEAN:
        tau = neo_hookean(F, mu, lam)
    elif law == COROTATED:
        tau = corotated(F, mu, lam)
    elif ti.static(plastic):
        tau = hencky(F, mu, lam)
    return tau


@ti.func
def cross_matrix(w):
    """[w]x, with [w]x y = w x y."""
    return ti.Matrix([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


@ti.func
def corotated_adjoint(F, mu, lam, tau_bar):
    """Differentiates R through (tr(S) I - S) w = axl(R^T dF - dF^T R), dR = R [w]x: regular unless two stretches sum to zero."""
    R = polar_rotation(F)
    J = F.determinant()
    S = R.transpose() @ F
    N = R.transpose() @ tau_bar @ F
    K = S.trace() * ti.Matrix.identity(ti.f64, 3) - 0.5 * (S + S.transpose())
    y = K.inverse() @ ti.Vector([N[2, 1] - N[1, 2], N[0, 2] - N[2, 0], N[1, 0] - N[0, 1]])
    through_R = R @ cross_matrix(y)
    cofactor = J * F.inverse().transpose()
    return 2.0 * mu * (tau_bar @ F + tau_bar.transpose() @ (F - R) - through_R) + lam * (2.0 * J - 1.0) * tau_bar.trace() * cofactor


@ti.func
def neo_hookean_adjoint(F, mu, lam, tau_bar):
    """d tau : tau_bar with d log J = F^-T : dF."""
    return mu * (tau_bar + tau_bar.transpose()) @ F + lam * tau_bar.trace() * F.inverse().transpose()


@ti.func
def kirchhoff_adjoint(law, F, mu, lam, tau_bar):
    """F_bar of the particle's elastic law."""
    F_bar = ti.Matrix.zero(ti.f64, 3, 3)
    if law == NEO_HOOKEAN:
        F_bar = neo_hookean_adjoint(F, mu, lam, tau_bar)
    else:
        F_bar = corotated_adjoint(F, mu, lam, tau_bar)
    return F_bar
