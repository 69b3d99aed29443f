"""Logarithm and exponential of symmetric matrices, and the divided differences ("slopes") that their derivatives consist of.

Near the identity both are power series, reduced to three terms by the theorem of Cayley and Hamilton; that is several times faster than
eigenvalues and library functions. The derivative of f(S) in the eigenvectors' basis multiplies entry ij by the divided difference
(f(x_i) - f(x_j)) / (x_i - x_j) (Daleckii and Krein; Higham 2008, "Functions of matrices", theorem 3.11). Where eigenvalues meet, these
are series as well: nothing is clamped. Both forms are computed and one is selected, because branches take long to compile.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import math

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial

from ..compiler import ti
from ..compiler.precision import is_double
from .eigen import eigenvalues, interpolant, norm_sqr, plus_identity, power_series, quadratic, squared

RADIUS = math.sqrt(2.0 / 3.0)
"""The largest eigenvalue that a traceless matrix of norm one can have."""

_LOG_REACH = 0.25
"""|X| up to which log(I + X) is evaluated as a series: stretches that differ by an eighth."""
_EXP_REACH = 0.125
"""|A| up to which exp(A) is evaluated as a series; a larger A is halved first."""
_SLOPE_REACH = 0.1
"""|z| up to which divided differences are evaluated as series."""


def _log_coefficients(degree: int) -> tuple[float, ...]:
    """Coefficients of log(1 + x) / 2 in powers of x, from a Chebyshev fit over the eigenvalues x within `_LOG_REACH`; exact at zero."""
    reach = RADIUS * _LOG_REACH
    quotient = Chebyshev.interpolate(lambda x: np.log1p(x) / (2.0 * x), degree, (-reach, reach))
    return (0.0, *quotient.convert(kind=Polynomial, domain=(-1, 1)).coef)


def _exp_coefficients(degree: int) -> tuple[float, ...]:
    """Coefficients of exp(x) - 1 in powers of x."""
    return (0.0, *(1.0 / math.factorial(k) for k in range(1, degree + 1)))


_LOG_SERIES = {True: _log_coefficients(15), False: _log_coefficients(7)}
"""True: in double precision; likewise below."""
_EXP_SERIES = {True: _exp_coefficients(10), False: _exp_coefficients(5)}
_LOG_SLOPE_SERIES = {True: tuple(2.0 / (2 * k + 1) for k in range(8)), False: tuple(2.0 / (2 * k + 1) for k in range(4))}
"""2 artanh(z) / z in powers of z²."""
_EXP_SLOPE_SERIES = {
    True: tuple(1.0 / math.factorial(2 * k + 1) for k in range(6)),
    False: tuple(1.0 / math.factorial(2 * k + 1) for k in range(3)),
}
"""sinh(z) / z in powers of z²."""


@ti.func
def half_logs(x):
    """log(1 + x) / 2 (3,); number by number, because the compiler has no logarithm of SIMD vectors."""
    return 0.5 * ti.Vector([ti.log(1.0 + x[0]), ti.log(1.0 + x[1]), ti.log(1.0 + x[2])])


@ti.func
def hencky_strain(m, X, size):
    """tr(e) / 3 and dev e (6,) of the Hencky strain e = log(B) / 2, B = m (I + X), |X| = size."""
    c = ti.Vector.zero(float, 3)
    if size < _LOG_REACH:
        c = power_series(X, ti.static(_LOG_SERIES[is_double()]))
    else:
        x = eigenvalues(X, size)
        c = interpolant(x, half_logs(x))
    e = quadratic(X, c)
    mean = (e[0] + e[1] + e[2]) / 3.0
    return mean + 0.5 * ti.log(m), plus_identity(e, -mean)


@ti.func
def exponential(A):
    """exp(A) - I of a traceless A (6,)."""
    halvings = 0
    size = ti.sqrt(norm_sqr(A))
    while size > _EXP_REACH and halvings < 10:
        size *= 0.5
        A = 0.5 * A
        halvings += 1
    N = quadratic(A, power_series(A, ti.static(_EXP_SERIES[is_double()])))
    while halvings > 0:
        N = 2.0 * N + squared(N)
        halvings -= 1
    return N


@ti.func
def horner(coefficients: ti.template(), z):
    """sum_k coefficients[k] z^k."""
    total = 0.0
    for k in ti.static(range(len(coefficients) - 1, -1, -1)):
        total = total * z + coefficients[k]
    return total


@ti.func
def log_slopes(x, e):
    """(log(1 + x_i) - log(1 + x_j)) / (x_i - x_j) (3,) for the pairs ij = 12, 02, 01; e (3,) is log(1 + x) / 2."""
    slopes = ti.Vector.zero(float, 3)
    for k in ti.static(range(3)):
        i, j = ti.static((k + 1) % 3, (k + 2) % 3)
        total = 2.0 + x[i] + x[j]
        z = (x[i] - x[j]) / total
        series = horner(ti.static(_LOG_SLOPE_SERIES[is_double()]), z * z) / total
        slopes[k] = ti.select(ti.abs(z) < _SLOPE_REACH, series, 2.0 * (e[i] - e[j]) / (x[i] - x[j]))
    return slopes


@ti.func
def exp_slopes(a, M):
    """(M_i - M_j) / (a_i - a_j) (3,) for the pairs ij = 12, 02, 01; M (3,) is exp(a)."""
    slopes = ti.Vector.zero(float, 3)
    for k in ti.static(range(3)):
        i, j = ti.static((k + 1) % 3, (k + 2) % 3)
        z = 0.5 * (a[i] - a[j])
        series = horner(ti.static(_EXP_SLOPE_SERIES[is_double()]), z * z) * ti.sqrt(M[i] * M[j])
        slopes[k] = ti.select(ti.abs(z) < _SLOPE_REACH, series, (M[i] - M[j]) / (a[i] - a[j]))
    return slopes
