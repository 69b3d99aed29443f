"""Elastic laws as small functions F -> Kirchhoff stress tau = J sigma [Pa], and their adjoints.

Every adjoint takes `tau_bar` = d loss / d tau and returns the derivatives of the loss with respect to F, mu and lam. No singular values
anywhere: nothing to divide by when two of them meet, as they do at rest.

The stretch V = sqrt(B), B = F F^T, of F = V R needs no iteration on matrices. Its trace is the largest root of a quartic whose
coefficients are invariants of F; there the quartic's slope is 8 times the product of the sums of two stretches, so the root is simple
wherever R is defined at all. V and R then are polynomials in F (Cayley, Hamilton).

Sources: corotated: Stomakhin et al. 2012, "Energetically consistent invertible elasticity", psi = mu |F - R|² + lam/2 (J - 1)²;
neo-Hookean: Bonet and Wood, "Nonlinear continuum mechanics", psi = mu/2 (|F|² - 3) - mu log J + lam/2 (log J)²;
stretch: Hoger and Carlson 1984, "Determination of the stretch and rotation in the polar decomposition of the deformation gradient";
Franca 1989, "An algorithm to compute the square root of a 3x3 positive definite matrix".
"""
# Taichi reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import taichi as ti

from .eigen import adjugate, full, left_cauchy_green, plus_identity, product, squared, symmetric_part
from .plasticity import PLASTIC_LAWS, VON_MISES, hencky, hencky_adjoint, plastic_flow_stress
from .precision import is_double

COROTATED = 0
NEO_HOOKEAN = 1
ELASTIC_LAWS = {"corotated": COROTATED, "neo_hookean": NEO_HOOKEAN}
LAWS = ELASTIC_LAWS | PLASTIC_LAWS
"""All laws by the names that materials use."""

_ITERATIONS = 30
"""Of Newton's method; one to three in practice."""
_LAST_STEP = {True: 1e-9, False: 2e-4}
"""Relative step after which the next, about its square, is below rounding; by whether in double precision."""


@ti.func
def cofactor(F):
    """J F^-T."""
    return ti.Matrix(
        [
            [
                F[(i + 1) % 3, (j + 1) % 3] * F[(i + 2) % 3, (j + 2) % 3] - F[(i + 1) % 3, (j + 2) % 3] * F[(i + 2) % 3, (j + 1) % 3]
                for j in ti.static(range(3))
            ]
            for i in ti.static(range(3))
        ]
    )


@ti.func
def stretch_invariants(B, J):
    """tr B, and of V = sqrt(B) the trace i, the second invariant ii and i ii - J, the product of the sums of two stretches."""
    first = B[0] + B[1] + B[2]
    second = B[1] * B[2] - B[3] * B[3] + B[0] * B[2] - B[4] * B[4] + B[0] * B[1] - B[5] * B[5]
    # Start: the series of tr sqrt(I + X) in the invariants -p and q of X = 3 B / tr B - I, up to the fifth power of X.
    scale = 3.0 / first
    p = 3.0 - second * scale * scale
    q = J * J * scale * scale * scale - 1.0 + p
    i = ti.sqrt(first / 3.0) * (3.0 - p * (0.25 + 0.078125 * p) + q * (0.1875 + 0.13671875 * p))
    step, iteration = i, 0
    while ti.abs(step) > ti.static(_LAST_STEP[is_double()]) * i and iteration < _ITERATIONS:
        u = i * i - first
        step = (u * u - 4.0 * second - 8.0 * J * i) / (4.0 * i * u - 8.0 * J)
        i -= step
        iteration += 1
    ii = 0.5 * (i * i - first)
    return first, i, ii, i * ii - J


@ti.func
def polar_rotation(F):
    """R of F = V R; det F > 0."""
    B, J = left_cauchy_green(F), F.determinant()
    first, i, ii, sums = stretch_invariants(B, J)
    return (product(full(plus_identity(-B, first + ii)), F) + i * cofactor(F)) / sums


@ti.func
def corotated(F, mu, lam):
    """tau = 2 mu (F - R) F^T + lam J (J - 1) I = 2 mu (B - V) + lam J (J - 1) I."""
    B, J = left_cauchy_green(F), F.determinant()
    first, i, ii, sums = stretch_invariants(B, J)
    k = 2.0 * mu / sums
    return full(plus_identity((2.0 * mu - k * (first + ii)) * B + k * squared(B), (lam * (J - 1.0) - k * i) * J))


@ti.func
def neo_hookean(F, mu, lam):
    """tau = mu (F F^T - I) + lam log J I."""
    return full(plus_identity(mu * left_cauchy_green(F), lam * ti.log(F.determinant()) - mu))


@ti.func
def kirchhoff(plastic: ti.template(), law, F, mu, lam):
    """tau of the particle's law; `plastic` is a constant that keeps the plastic laws out of kernels that do not need them."""
    tau = ti.Matrix.zero(float, 3, 3)
    if law == NEO_HOOKEAN:
        tau = neo_hookean(F, mu, lam)
    elif law == COROTATED:
        tau = corotated(F, mu, lam)
    elif ti.static(plastic):
        tau = hencky(F, mu, lam)
    return tau


@ti.func
def flow_and_stress(law, F, mu, lam, yield_stress, viscosity, dt):
    """`plastic_flow` and `kirchhoff` of its result: F, tau. For plastic laws both come from one logarithm."""
    F_next, tau = F, ti.Matrix.zero(float, 3, 3)
    if law >= VON_MISES:
        F_next, tau = plastic_flow_stress(law, F, mu, lam, yield_stress, viscosity, dt)
    else:
        tau = kirchhoff(False, law, F, mu, lam)
    return F_next, tau


@ti.func
def axial(A):
    """a with A : [w]x = a . w for all w."""
    return ti.Vector([A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]])


@ti.func
def cross_matrix(w):
    """[w]x, with [w]x y = w x y."""
    return ti.Matrix([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


@ti.func
def corotated_adjoint(F, mu, lam, tau_bar):
    """F_bar, mu_bar, lam_bar. R turns with dR = [w]x R, (tr(V) I - V) w = axial(dF R^T)."""
    B, J = left_cauchy_green(F), F.determinant()
    first, i, ii, sums = stretch_invariants(B, J)
    cof = cofactor(F)
    R = (product(full(plus_identity(-B, first + ii)), F) + i * cof) / sums
    V = plus_identity(((first + ii) * B - squared(B)) / sums, i * J / sums)
    T = full(symmetric_part(tau_bar))
    trace = T.trace()
    w = full(adjugate(plus_identity(-V, i))) @ axial(product(T, full(V))) / sums
    F_bar = 2.0 * mu * (2.0 * product(T, F) - product(T + cross_matrix(w), R)) + lam * (2.0 * J - 1.0) * trace * cof
    return F_bar, 2.0 * (T * full(B - V)).sum(), trace * J * (J - 1.0)


@ti.func
def neo_hookean_adjoint(F, mu, lam, tau_bar):
    """F_bar, mu_bar, lam_bar, with d log J = F^-T : dF."""
    J = F.determinant()
    trace = tau_bar.trace()
    F_bar = 2.0 * mu * product(full(symmetric_part(tau_bar)), F) + (lam * trace / J) * cofactor(F)
    return F_bar, (tau_bar * full(left_cauchy_green(F))).sum() - trace, trace * ti.log(J)


@ti.func
def kirchhoff_adjoint(plastic: ti.template(), law, F, mu, lam, tau_bar):
    """F_bar, mu_bar, lam_bar of the particle's law; `plastic` as in `kirchhoff`."""
    F_bar, mu_bar, lam_bar = ti.Matrix.zero(float, 3, 3), 0.0, 0.0
    if law == NEO_HOOKEAN:
        F_bar, mu_bar, lam_bar = neo_hookean_adjoint(F, mu, lam, tau_bar)
    elif law == COROTATED:
        F_bar, mu_bar, lam_bar = corotated_adjoint(F, mu, lam, tau_bar)
    elif ti.static(plastic):
        F_bar, mu_bar, lam_bar = hencky_adjoint(F, mu, lam, tau_bar)
    return F_bar, mu_bar, lam_bar
