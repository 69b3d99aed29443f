"""Laws with plastic flow: Hencky strain, von Mises yield, with or without viscosity; and their adjoints.

The stress is tau = 2 mu e + lam tr(e) I with the Hencky strain e = log(F F^T) / 2 (St. Venant-Kirchhoff in logarithmic strain).

`yield_stress` is the stress Y at which a bar yields in tension: |dev tau| = sqrt(2/3) Y. Several MPM codes compare |dev tau| with their
yield stress itself; a value taken from one of them must be multiplied by sqrt(3/2) = 1.2247 here.

Flow shrinks the deviator of the strain, dev e -> (1 + s) dev e, by F -> exp(s dev e) F, which preserves the volume;
s = w (sqrt(2/3) Y / |dev tau| - 1). Without viscosity w = 1: the stress returns to the yield surface. With viscosity eta,
w = mu dt / (eta + mu dt) is the backward Euler rule for d_p = (|dev tau| - sqrt(2/3) Y) / (2 eta), stable however small the viscosity.

Sources: Simo 1992, "Algorithms for static and dynamic multiplicative plasticity that preserve the classical return mapping schemes";
Perzyna's overstress as in Simo and Hughes, "Computational inelasticity", section 2.7; Bingham's fluid |s| = sqrt(2/3) Y + 2 eta |d_p|.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from .eigen import eigenvalues, eigenvectors, full, left_cauchy_green, norm_sqr, plus_identity, product, relative_deviator, symmetric_part
from .strain import RADIUS, exp_slopes, exponential, half_logs, hencky_strain, log_slopes

VON_MISES = 2
VISCOPLASTIC = 3
PLASTIC_LAWS = {"von_mises": VON_MISES, "viscoplastic": VISCOPLASTIC}
"""Plastic laws by the names that materials use."""


@ti.func
def hencky(F, mu, lam):
    """tau = 2 mu e + lam tr(e) I."""
    m, X, size = relative_deviator(left_cauchy_green(F))
    mean, e = hencky_strain(m, X, size)
    return full(plus_identity(2.0 * mu * e, (2.0 * mu + 3.0 * lam) * mean))


@ti.func
def certainly_elastic(size, mu, yield_stress):
    """Whether the bound |dev e| <= |log(I + X)| / 2 <= |X| / 2 / (1 - RADIUS |X|) already rules out plastic flow; size = |X|."""
    return mu * size <= RADIUS * yield_stress * (1.0 - RADIUS * size)


@ti.func
def rate_weight(law, mu, viscosity, dt):
    """w: the share of the overstress that relaxes in dt."""
    return ti.select(law == VISCOPLASTIC, mu * dt / (viscosity + mu * dt), 1.0)


@ti.func
def plastic_flow(law, F, mu, yield_stress, viscosity, dt):
    """Trial F, of an elastic substep -> F after plastic flow; unchanged under an elastic law."""
    F_next = F
    if law >= VON_MISES:
        m, X, size = relative_deviator(left_cauchy_green(F))
        if not certainly_elastic(size, mu, yield_stress):
            _, e = hencky_strain(m, X, size)
            trial, limit = 2.0 * mu * ti.sqrt(norm_sqr(e)), RADIUS * yield_stress
            if trial > limit:
                s = rate_weight(law, mu, viscosity, dt) * (limit / trial - 1.0)
                F_next = F + product(full(exponential(s * e)), F)
    return F_next


@ti.func
def principal_strains(X, size):
    """For B = m (I + X), |X| = size: its eigenvectors U, the eigenvalues x (3,) of X, and log(1 + x) / 2 (3,), the Hencky strains less
    log(m) / 2."""
    U, x = eigenvectors(X, eigenvalues(X, size)[0])
    return U, x, half_logs(x)


@ti.func
def hencky_terms(F):
    """The terms of F that `hencky_adjoint` needs for any tau_bar: m; U, x and e of `principal_strains`; the logarithm's divided
    differences."""
    m, X, size = relative_deviator(left_cauchy_green(F))
    U, x, e = principal_strains(X, size)
    return m, U, x, e, log_slopes(x, e)


@ti.func
def hencky_adjoint(F, mu, lam, m, U, x, e, slopes, tau_bar):
    """Adjoint of `hencky`: F_bar, mu_bar, lam_bar; m, U, x, e and slopes are those of `hencky_terms`."""
    basis = U.transpose()
    T = symmetric_part(product(product(basis, tau_bar), U))
    trace = T[0] + T[1] + T[2]
    # 2 m B_bar; in this basis the derivative of e by B is half the divided differences of the logarithm.
    B_bar = ti.Vector(
        [
            (2.0 * mu * T[0] + lam * trace) / (1.0 + x[0]),
            (2.0 * mu * T[1] + lam * trace) / (1.0 + x[1]),
            (2.0 * mu * T[2] + lam * trace) / (1.0 + x[2]),
            2.0 * mu * T[3] * slopes[0],
            2.0 * mu * T[4] * slopes[1],
            2.0 * mu * T[5] * slopes[2],
        ]
    )
    F_bar = product(U, product(full(B_bar / m), product(basis, F)))
    mean = 0.5 * ti.log(m)
    mu_bar = 2.0 * (T[0] * e[0] + T[1] * e[1] + T[2] * e[2] + trace * mean)
    return F_bar, mu_bar, trace * (e[0] + e[1] + e[2] + 3.0 * mean)


@ti.func
def hencky_both_ways(F, mu, lam, tau_bar):
    """tau of `hencky`, and F_bar, mu_bar, lam_bar; the principal strains are computed once for both."""
    m, U, x, e, slopes = hencky_terms(F)
    F_bar, mu_bar, lam_bar = hencky_adjoint(F, mu, lam, m, U, x, e, slopes, tau_bar)
    mean = 0.5 * ti.log(m)
    stress = 2.0 * mu * (e + mean) + lam * (e[0] + e[1] + e[2] + 3.0 * mean)
    scaled = ti.Matrix([[U[i, j] * stress[j] for j in ti.static(range(3))] for i in ti.static(range(3))])
    return product(scaled, U.transpose()), F_bar, mu_bar, lam_bar


@ti.func
def flow_terms(law, mu, yield_stress, viscosity, dt, X, size):
    """The terms that `through_flow` needs for any F_next_bar, and the distance from yield, for F F^T = m (I + X), |X| = size.

    Returns:
        U, x of `principal_strains`; the principal values e (3,) of dev e; s; -d s / d log |dev e| over |dev e|²; M = exp(s dev e) (3,);
        s times the divided differences (3,) of exp and of the logarithm; |dev tau|, its limit, and w.
    """
    U, x, e = principal_strains(X, size)
    e = e - (e[0] + e[1] + e[2]) / 3.0
    trial, limit = 2.0 * mu * e.norm(), RADIUS * yield_stress
    w = ti.select(trial > limit, rate_weight(law, mu, viscosity, dt), 0.0)
    s, kept = w * (limit / trial - 1.0), w * limit / trial
    a = s * e
    M = ti.Vector([ti.exp(a[0]), ti.exp(a[1]), ti.exp(a[2])])
    return U, x, e, s, kept / e.norm_sqr(), M, s * exp_slopes(a, M) * log_slopes(x, e), trial, limit, w


@ti.func
def through_flow(F, m, U, x, e, s, kept, M, shear, F_next_bar):
    """Adjoint of F_next = exp(s dev e) F: F_bar and s_bar; m of `relative_deviator`, the other arguments of `flow_terms`."""
    basis = U.transpose()
    turned, turned_bar = product(basis, F), product(basis, F_next_bar)
    M_bar = symmetric_part(product(turned_bar, turned.transpose()))
    a_bar = ti.Vector([M_bar[0] * M[0], M_bar[1] * M[1], M_bar[2] * M[2]])
    s_bar = a_bar.dot(e)
    e_bar = s * a_bar - (s_bar * kept) * e
    e_bar = e_bar - (e_bar[0] + e_bar[1] + e_bar[2]) / 3.0
    B_bar = ti.Vector(  # 2 m B_bar, in the basis of eigenvectors
        [
            e_bar[0] / (1.0 + x[0]),
            e_bar[1] / (1.0 + x[1]),
            e_bar[2] / (1.0 + x[2]),
            M_bar[3] * shear[0],
            M_bar[4] * shear[1],
            M_bar[5] * shear[2],
        ]
    )
    scaled_bar = ti.Matrix([[M[i] * turned_bar[i, j] for j in ti.static(range(3))] for i in ti.static(range(3))])
    return product(U, scaled_bar + product(full(B_bar / m), turned)), s_bar


@ti.func
def plastic_flow_adjoint(law, F, mu, yield_stress, viscosity, dt, F_next_bar):
    """Adjoint of `plastic_flow`: F_bar, mu_bar, yield_stress_bar, viscosity_bar. Exactly at yield, it is that of the elastic side."""
    F_bar, mu_bar, yield_stress_bar, viscosity_bar = F_next_bar, 0.0, 0.0, 0.0
    m, X, size = relative_deviator(left_cauchy_green(F))
    if law >= VON_MISES and not certainly_elastic(size, mu, yield_stress):
        U, x, e, s, kept, M, shear, trial, limit, w = flow_terms(law, mu, yield_stress, viscosity, dt, X, size)
        F_bar, s_bar = through_flow(F, m, U, x, e, s, kept, M, shear, F_next_bar)
        yield_stress_bar = s_bar * w * RADIUS / trial
        w_bar = ti.select(law == VISCOPLASTIC, s_bar * (ti.min(limit / trial, 1.0) - 1.0) / (viscosity + mu * dt), 0.0)
        mu_bar = w_bar * (1.0 - w) * dt - s_bar * w * limit / trial / mu
        viscosity_bar = -w_bar * w
    return F_bar, mu_bar, yield_stress_bar, viscosity_bar
