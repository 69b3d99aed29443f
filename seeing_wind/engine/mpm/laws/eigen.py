"""Symmetric 3x3 matrices in closed form: eigenvalues, eigenvectors, and functions of a matrix without eigenvectors.

A symmetric matrix S is stored as the vector of its six entries xx, yy, zz, yz, xz, xy. Eigenvalues are computed for the deviator divided
by its norm. Its characteristic polynomial t³ - t/2 = q has one root apart from the other two, with |t| between 0.707 and 0.817 and the
sign of q: two Newton steps from a cubic in |q| find it to double precision, and the other two follow from a quadratic equation.

Two close eigenvalues are accurate only to the square root of the rounding error. That does not matter here: a function f(S) is evaluated
as the polynomial that interpolates f at the computed eigenvalues, whose error is the third divided difference of f times the
characteristic polynomial, and that is at rounding level for any matrix. Eigenvectors are found by deflation: that of the root apart from
the adjugate, which is a multiple of its projector, the other two by one exact plane rotation.

Sources: Higham 2008, "Functions of matrices", section 1.2 (functions by interpolation);
Eberly 2014, "A robust eigensolver for 3x3 symmetric matrices" (deflation); Duff et al. 2017, "Building an orthonormal basis, revisited".
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..compiler.precision import epsilon, is_double

_MOST_SKEWED = 0.13608276348795434
"""1 / (3 sqrt 6): the largest |det| of a deviator of norm one, that of one with two equal eigenvalues."""


@ti.func
def column(A, j: ti.template()):
    """Column j of A (3, 3)."""
    return ti.Vector([A[0, j], A[1, j], A[2, j]])


@ti.func
def times_columns(a, b, c, by):
    """The product of the matrix with columns a, b, c and the vector `by` (3,); as long as the columns."""
    return by[0] * a + by[1] * b + by[2] * c


@ti.func
def from_columns(a, b, c):
    """The matrix (3, 3) with these columns; only their first three numbers are used."""
    return ti.Matrix([[a[i], b[i], c[i]] for i in ti.static(range(3))])


@ti.func
def product(A, B):
    """A B for (3, 3), column by column. Taichi's `@` takes five times as long to compile, and begins every sum with zero."""
    a, b, c = column(A, 0), column(A, 1), column(A, 2)
    return from_columns(*[times_columns(a, b, c, column(B, j)) for j in ti.static(range(3))])


@ti.func
def left_cauchy_green(F):
    """B = F F^T as a symmetric matrix (6,)."""
    return ti.Vector(
        [
            F[0, 0] * F[0, 0] + F[0, 1] * F[0, 1] + F[0, 2] * F[0, 2],
            F[1, 0] * F[1, 0] + F[1, 1] * F[1, 1] + F[1, 2] * F[1, 2],
            F[2, 0] * F[2, 0] + F[2, 1] * F[2, 1] + F[2, 2] * F[2, 2],
            F[1, 0] * F[2, 0] + F[1, 1] * F[2, 1] + F[1, 2] * F[2, 2],
            F[0, 0] * F[2, 0] + F[0, 1] * F[2, 1] + F[0, 2] * F[2, 2],
            F[0, 0] * F[1, 0] + F[0, 1] * F[1, 1] + F[0, 2] * F[1, 2],
        ]
    )


@ti.func
def full(S):
    """The matrix (3, 3) of S (6,)."""
    return ti.Matrix([[S[0], S[5], S[4]], [S[5], S[1], S[3]], [S[4], S[3], S[2]]])


@ti.func
def symmetric_part(A):
    """(A + A^T) / 2 of a matrix (3, 3), (6,)."""
    return ti.Vector([A[0, 0], A[1, 1], A[2, 2], 0.5 * (A[1, 2] + A[2, 1]), 0.5 * (A[0, 2] + A[2, 0]), 0.5 * (A[0, 1] + A[1, 0])])


@ti.func
def plus_identity(S, c):
    """S + c I."""
    return ti.Vector([S[0] + c, S[1] + c, S[2] + c, S[3], S[4], S[5]])


@ti.func
def squared(S):
    """S²."""
    yz, xz, xy = S[3] * S[3], S[4] * S[4], S[5] * S[5]
    return ti.Vector(
        [
            S[0] * S[0] + xy + xz,
            S[1] * S[1] + xy + yz,
            S[2] * S[2] + xz + yz,
            S[5] * S[4] + S[3] * (S[1] + S[2]),
            S[5] * S[3] + S[4] * (S[0] + S[2]),
            S[4] * S[3] + S[5] * (S[0] + S[1]),
        ]
    )


@ti.func
def adjugate(S):
    """det(S) S^-1."""
    return ti.Vector(
        [
            S[1] * S[2] - S[3] * S[3],
            S[0] * S[2] - S[4] * S[4],
            S[0] * S[1] - S[5] * S[5],
            S[5] * S[4] - S[0] * S[3],
            S[5] * S[3] - S[1] * S[4],
            S[4] * S[3] - S[2] * S[5],
        ]
    )


@ti.func
def determinant(S):
    return S[0] * (S[1] * S[2] - S[3] * S[3]) - S[5] * (S[5] * S[2] - S[3] * S[4]) + S[4] * (S[5] * S[3] - S[1] * S[4])


@ti.func
def norm_sqr(S):
    """|S|²."""
    return S[0] * S[0] + S[1] * S[1] + S[2] * S[2] + 2.0 * (S[3] * S[3] + S[4] * S[4] + S[5] * S[5])


@ti.func
def power_series(X, coefficients: ti.template()):
    """c with sum_k coefficients[k] X^k = c[0] I + c[1] X + c[2] X², for traceless X: X³ = (|X|²/2) X + det(X) I (Cayley, Hamilton)."""
    p = 0.5 * norm_sqr(X)
    q = determinant(X)
    a, b, c = 0.0, 0.0, 0.0
    for k in ti.static(range(len(coefficients) - 1, -1, -1)):
        a, b, c = coefficients[k] + q * c, a + p * c, b
    return ti.Vector([a, b, c])


@ti.func
def quadratic(X, c):
    """c[0] I + c[1] X + c[2] X²."""
    return plus_identity(c[1] * X + c[2] * squared(X), c[0])


@ti.func
def symmetric_times(S, b):
    """S b for symmetric S (6,)."""
    return ti.Vector(
        [S[0] * b[0] + S[5] * b[1] + S[4] * b[2], S[5] * b[0] + S[1] * b[1] + S[3] * b[2], S[4] * b[0] + S[3] * b[1] + S[2] * b[2]]
    )


@ti.func
def relative_deviator(B):
    """m (scalar), X (6,) and |X| of a positive definite B = m (I + X) with traceless X."""
    m = (B[0] + B[1] + B[2]) / 3.0
    X = plus_identity(B / m, -1.0)
    # The trace is removed once more: the first subtraction leaves only a rounding error, but near rest X is no larger than that.
    rest = (X[0] + X[1] + X[2]) / 3.0
    X = plus_identity(X, -rest)
    return m * (1.0 + rest), X, ti.sqrt(norm_sqr(X))


@ti.func
def eigenvalues(X, size):
    """Eigenvalues (3,) of a traceless X of norm `size`, the one apart first; they are kept distinct by about the rounding error."""
    norm = ti.max(size, ti.static(epsilon()))
    skewed = determinant(X) / (norm * norm * norm)
    q = ti.min(ti.abs(skewed), _MOST_SKEWED)
    t = 0.70713656 + q * (0.992425 + q * (q * 3.05971149 - 1.80247682))
    for _ in ti.static(range(2 if is_double() else 1)):
        t = (2.0 * t * t * t + q) / (3.0 * t * t - 0.5)
    gap = ti.sqrt(ti.max(2.0 - 3.0 * t * t, ti.static(4.0 * epsilon())))
    norm = ti.select(skewed < 0.0, -norm, norm)
    return ti.Vector([norm * t, -0.5 * norm * (t - gap), -0.5 * norm * (t + gap)])


@ti.func
def interpolant(x, f):
    """c with f(X) = c[0] I + c[1] X + c[2] X², for values f (3,) at the eigenvalues x (3,) of X."""
    f01 = (f[0] - f[1]) / (x[0] - x[1])
    f12 = (f[1] - f[2]) / (x[1] - x[2])
    f012 = (f01 - f12) / (x[0] - x[2])
    return ti.Vector([f[1] - f01 * x[1] + f012 * x[0] * x[1], f01 - f012 * (x[0] + x[1]), f012])


@ti.func
def eigenvectors(X, apart):
    """U (3, 3), with the eigenvectors of a traceless X as columns, and their eigenvalues (3,); `apart` is the first of `eigenvalues`."""
    P = adjugate(plus_identity(X, -apart))  # (product of the gaps) u u^T
    first = P[0] >= P[1]
    best = ti.select(first, ti.Vector([P[0], P[5], P[4]]), ti.Vector([P[5], P[1], P[3]]))
    third = P[2] > ti.max(P[0], P[1])
    u = ti.select(third, ti.Vector([P[4], P[3], P[2]]), best)
    u = u / ti.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    side = ti.select(u[2] < 0.0, -1.0, 1.0)
    a = -1.0 / (side + u[2])
    b = u[0] * u[1] * a
    v = ti.Vector([1.0 + side * u[0] * u[0] * a, side * b, -side * u[0]])
    w = ti.Vector([b, side + u[1] * u[1] * a, -u[1]])
    Xv = symmetric_times(X, v)
    vv, vw = v.dot(Xv), w.dot(Xv)
    half = vv + 0.5 * apart
    radius = ti.sqrt(half * half + vw * vw)
    # Below the square of the rounding error any basis will do.
    far = ti.max(radius + ti.abs(half), ti.static(epsilon() ** 2))
    scale = 1.0 / ti.sqrt(far * far + vw * vw)
    cosine = scale * ti.select(half >= 0.0, far, vw)
    sine = scale * ti.select(half >= 0.0, vw, far)
    U = ti.Matrix.cols([u, cosine * v + sine * w, cosine * w - sine * v])
    return U, ti.Vector([apart, radius - 0.5 * apart, -radius - 0.5 * apart])
