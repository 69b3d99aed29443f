"""Elastic laws as small functions F -> Kirchhoff stress tau = J sigma [Pa], and their adjoints.

Every adjoint takes `tau_bar` = d loss / d tau and returns the derivatives of the loss with respect to F, mu and lam. Singular values are
not used, so there is no division by their difference, which vanishes at rest.

The stretch V = sqrt(B), B = F F^T, of F = V R needs no iteration on matrices. Its trace is the largest root of a quartic whose
coefficients are invariants of F; there the quartic's slope is 8 times the product of the pairwise sums of the stretches, so the root is
simple wherever R is defined at all. V then is a polynomial in B (Cayley, Hamilton).

Sources: corotated: Stomakhin et al. 2012, "Energetically consistent invertible elasticity", psi = mu |F - R|² + lam/2 (J - 1)²;
neo-Hookean: Bonet and Wood, "Nonlinear continuum mechanics", psi = mu/2 (|F|² - 3) - mu log J + lam/2 (log J)²;
stretch: Hoger and Carlson 1984, "Determination of the stretch and rotation in the polar decomposition of the deformation gradient";
Franca 1989, "An algorithm to compute the square root of a 3x3 positive definite matrix".
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..compiler.precision import is_double
from .eigen import (
    adjugate,
    column,
    from_columns,
    full,
    left_cauchy_green,
    plus_identity,
    squared,
    symmetric_part,
    symmetric_times,
    times_columns,
)
from .plasticity import PLASTIC_LAWS, hencky, hencky_both_ways

COROTATED = 0
NEO_HOOKEAN = 1
ELASTIC_LAWS = {"corotated": COROTATED, "neo_hookean": NEO_HOOKEAN}
LAWS = ELASTIC_LAWS | PLASTIC_LAWS
"""All laws by the names that materials use."""

_ITERATIONS = 30
"""Iterations of Newton's method, at most; one to three in practice."""
_LAST_STEP = {True: 1e-9, False: 2e-4}
"""Relative step after which the next one, about its square, is below the rounding error; True: in double precision."""


@ti.func
def stretch_trace(B, J):
    """tr V of V = sqrt(B)."""
    first, second = traces(B)
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
    return i


@ti.func
def traces(B):
    """tr B and the second invariant of B (6,)."""
    return B[0] + B[1] + B[2], B[1] * B[2] - B[3] * B[3] + B[0] * B[2] - B[4] * B[4] + B[0] * B[1] - B[5] * B[5]


@ti.func
def stretch_invariants(B, J, i):
    """tr B; and for V = sqrt(B) with trace i, the second invariant ii, and i ii - J, the product of the pairwise sums of the stretches."""
    first = B[0] + B[1] + B[2]
    ii = 0.5 * (i * i - first)
    return first, ii, i * ii - J


@ti.func
def corotated(F, mu, lam):
    """tau = 2 mu (F - R) F^T + lam J (J - 1) I = 2 mu (B - V) + lam J (J - 1) I; and tr V."""
    B, J = left_cauchy_green(F), F.determinant()
    i = stretch_trace(B, J)
    first, ii, sums = stretch_invariants(B, J, i)
    k = 2.0 * mu / sums
    return full(plus_identity((2.0 * mu - k * (first + ii)) * B + k * squared(B), (lam * (J - 1.0) - k * i) * J)), i


@ti.func
def neo_hookean(F, mu, lam):
    """tau = mu (F F^T - I) + lam log J I; and log J."""
    log_J = ti.log(F.determinant())
    return full(plus_identity(mu * left_cauchy_green(F), lam * log_J - mu)), log_J


@ti.func
def kirchhoff(plastic: ti.template(), law, F, mu, lam):
    """tau of the particle's law, and the costliest intermediate number, tr V or log J, which `kirchhoff_adjoint` needs again.

    `plastic` is a compile-time constant: False leaves the plastic laws out of kernels that do not need them.
    """
    tau, known = ti.Matrix.zero(float, 3, 3), 0.0
    if law == NEO_HOOKEAN:
        tau, known = neo_hookean(F, mu, lam)
    elif law == COROTATED:
        tau, known = corotated(F, mu, lam)
    elif ti.static(plastic):
        tau = hencky(F, mu, lam)
    return tau, known


@ti.func
def cross(a, b):
    """a x b."""
    ahead = ti.Vector([a[1], a[2], a[0]]) * ti.Vector([b[2], b[0], b[1]])
    return ahead - ti.Vector([a[2], a[0], a[1]]) * ti.Vector([b[1], b[2], b[0]])


@ti.func
def corotated_adjoint(F, mu, lam, i, tau_bar):
    """F_bar, mu_bar, lam_bar; i = tr V. R turns with dR = [w]x R, (tr(V) I - V) w = axial(dF R^T), where axial(A) . u = A : [u]x for all u.

    With R = (K F + i cof F) / sums, K = (tr B + ii) I - B, and W = T + [w]x the derivative by F is
    2 mu (2 T - W K / sums) F + (lam (2 J - 1) tr T - 2 mu i W / sums) cof F. Matrices are built column by column.
    """
    B, J = left_cauchy_green(F), F.determinant()
    first, ii, sums = stretch_invariants(B, J, i)
    per_sums = 1.0 / sums
    S = symmetric_part(tau_bar)
    trace = S[0] + S[1] + S[2]
    V = plus_identity(((first + ii) * B - squared(B)) * per_sums, i * J * per_sums)
    w = symmetric_times(adjugate(plus_identity(-1.0 * V, i)), axial_of_product(S, V)) * per_sums
    T0, T1, T2 = ti.Vector([S[0], S[5], S[4]]), ti.Vector([S[5], S[1], S[3]]), ti.Vector([S[4], S[3], S[2]])
    k = 2.0 * mu * per_sums
    W0 = k * (T0 + ti.Vector([0.0, w[2], -w[1]]))
    W1 = k * (T1 + ti.Vector([-w[2], 0.0, w[0]]))
    W2 = k * (T2 + ti.Vector([w[1], -w[0], 0.0]))
    K = plus_identity(-1.0 * B, first + ii)
    M0 = (4.0 * mu) * T0 - times_columns(W0, W1, W2, ti.Vector([K[0], K[5], K[4]]))
    M1 = (4.0 * mu) * T1 - times_columns(W0, W1, W2, ti.Vector([K[5], K[1], K[3]]))
    M2 = (4.0 * mu) * T2 - times_columns(W0, W1, W2, ti.Vector([K[4], K[3], K[2]]))
    swell = lam * (2.0 * J - 1.0) * trace
    F0, F1, F2 = column(F, 0), column(F, 1), column(F, 2)
    cof0, cof1, cof2 = cross(F1, F2), cross(F2, F0), cross(F0, F1)
    a = times_columns(M0, M1, M2, F0) + swell * cof0 - i * times_columns(W0, W1, W2, cof0)
    b = times_columns(M0, M1, M2, F1) + swell * cof1 - i * times_columns(W0, W1, W2, cof1)
    c = times_columns(M0, M1, M2, F2) + swell * cof2 - i * times_columns(W0, W1, W2, cof2)
    mu_bar = 2.0 * contracted(S, B - V)
    return from_columns(a, b, c), mu_bar, trace * J * (J - 1.0)


@ti.func
def axial_of_product(S, V):
    """axial(S V) of symmetric S, V (6,), (3,)."""
    return ti.Vector(
        [
            S[4] * V[5] + S[3] * V[1] + S[2] * V[3] - S[5] * V[4] - S[1] * V[3] - S[3] * V[2],
            S[0] * V[4] + S[5] * V[3] + S[4] * V[2] - S[4] * V[0] - S[3] * V[5] - S[2] * V[4],
            S[5] * V[0] + S[1] * V[5] + S[3] * V[4] - S[0] * V[5] - S[5] * V[1] - S[4] * V[3],
        ]
    )


@ti.func
def contracted(S, E):
    """S : E of symmetric matrices (6,)."""
    return S[0] * E[0] + S[1] * E[1] + S[2] * E[2] + 2.0 * (S[3] * E[3] + S[4] * E[4] + S[5] * E[5])


@ti.func
def neo_hookean_adjoint(F, mu, lam, log_J, tau_bar):
    """F_bar, mu_bar, lam_bar, with d log J = F^-T : dF."""
    S = symmetric_part(tau_bar)
    trace = S[0] + S[1] + S[2]
    k, swell = 2.0 * mu, lam * trace / F.determinant()
    T0, T1, T2 = k * ti.Vector([S[0], S[5], S[4]]), k * ti.Vector([S[5], S[1], S[3]]), k * ti.Vector([S[4], S[3], S[2]])
    F0, F1, F2 = column(F, 0), column(F, 1), column(F, 2)
    a = times_columns(T0, T1, T2, F0) + swell * cross(F1, F2)
    b = times_columns(T0, T1, T2, F1) + swell * cross(F2, F0)
    c = times_columns(T0, T1, T2, F2) + swell * cross(F0, F1)
    mu_bar = contracted(S, left_cauchy_green(F)) - trace
    return from_columns(a, b, c), mu_bar, trace * log_J


@ti.func
def kirchhoff_adjoint(law, F, mu, lam, known, tau_bar):
    """F_bar, mu_bar, lam_bar of an elastic law; `known` is the second result of `kirchhoff`."""
    F_bar, mu_bar, lam_bar = ti.Matrix.zero(float, 3, 3), 0.0, 0.0
    if law == NEO_HOOKEAN:
        F_bar, mu_bar, lam_bar = neo_hookean_adjoint(F, mu, lam, known, tau_bar)
    elif law == COROTATED:
        F_bar, mu_bar, lam_bar = corotated_adjoint(F, mu, lam, known, tau_bar)
    return F_bar, mu_bar, lam_bar


@ti.func
def kirchhoff_both_ways(plastic: ti.template(), law, F, mu, lam, tau_bar):
    """tau, F_bar, mu_bar, lam_bar of the particle's law; `plastic` as in `kirchhoff`."""
    tau, F_bar, mu_bar, lam_bar = ti.Matrix.zero(float, 3, 3), ti.Matrix.zero(float, 3, 3), 0.0, 0.0
    if law == NEO_HOOKEAN:
        tau, log_J = neo_hookean(F, mu, lam)
        F_bar, mu_bar, lam_bar = neo_hookean_adjoint(F, mu, lam, log_J, tau_bar)
    elif law == COROTATED:
        tau, i = corotated(F, mu, lam)
        F_bar, mu_bar, lam_bar = corotated_adjoint(F, mu, lam, i, tau_bar)
    elif ti.static(plastic):
        tau, F_bar, mu_bar, lam_bar = hencky_both_ways(F, mu, lam, tau_bar)
    return tau, F_bar, mu_bar, lam_bar
