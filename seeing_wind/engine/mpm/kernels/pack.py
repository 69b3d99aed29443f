"""Conversion between the states of the rest of the engine, float64 in the model's order, and the packed states of the kernels."""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..laws.eigen import from_columns
from .packed import MOST_PARTICLES, bounded, forces, rows_of, states

order_of = ti.types.ndarray(dtype=ti.i32, ndim=1)
numbers = ti.types.ndarray(dtype=ti.f64, ndim=1)
vectors = ti.types.ndarray(dtype=ti.f64, ndim=2)
matrices = ti.types.ndarray(dtype=ti.f64, ndim=3)


@ti.func
def real_vector(array: ti.template(), p):
    return ti.Vector([ti.cast(array[p, i], float) for i in ti.static(range(3))])


@ti.func
def real_matrix(array: ti.template(), p):
    return ti.Matrix([[ti.cast(array[p, i, j], float) for j in ti.static(range(3))] for i in ti.static(range(3))])


@ti.kernel
def pack(order: order_of, x: vectors, v: vectors, C: matrices, F: matrices, offset: numbers, state: states):
    """Rows 6 q to 6 q + 5 of `state` become those of particle order[q], with its position relative to offset (3,)."""
    for q in range(order.shape[0]):
        p = bounded(order[q], MOST_PARTICLES)
        # Subtracted in double precision, so that single precision keeps its digits for the small difference.
        place = ti.Vector([ti.cast(x[p, i] - offset[i], float) for i in ti.static(range(3))])
        row = rows_of(q)[0]
        speed, affine, deformation = real_vector(v, p), real_matrix(C, p), real_matrix(F, p)
        for j in ti.static(range(3)):
            state[row + j] = ti.Vector([deformation[0, j], deformation[1, j], deformation[2, j], place[j]])
            state[row + 3 + j] = ti.Vector([affine[0, j], affine[1, j], affine[2, j], speed[j]])


@ti.kernel
def pack_forces(order: order_of, acceleration: vectors, gradient: matrices, force: forces):
    """Rows 3 q to 3 q + 2 of `force` become those of particle order[q]; an empty `gradient` stands for zero."""
    for q in range(order.shape[0]):
        p = bounded(order[q], MOST_PARTICLES)
        G = ti.Matrix.zero(float, 3, 3)
        if gradient.shape[0] > 0:
            G = real_matrix(gradient, p)
        row, a = rows_of(q)[1], real_vector(acceleration, p)
        for j in ti.static(range(3)):
            force[row + j] = ti.Vector([G[0, j], G[1, j], G[2, j], a[j]])


@ti.kernel
def unpack(order: order_of, state: states, offset: numbers, x: vectors, v: vectors, C: matrices, F: matrices):
    """The inverse of `pack`; particles that are not in `order` are left alone."""
    for q in range(order.shape[0]):
        p = bounded(order[q], MOST_PARTICLES)
        row = rows_of(q)[0]
        for j in ti.static(range(3)):
            deformation, affine = state[row + j], state[row + 3 + j]
            x[p, j] = ti.cast(deformation[3], ti.f64) + offset[j]
            v[p, j] = affine[3]
            for i in ti.static(range(3)):
                C[p, i, j] = affine[i]
                F[p, i, j] = deformation[i]


@ti.kernel
def unpack_forces(order: order_of, force: forces, acceleration: vectors, gradient: matrices):
    """The inverse of `pack_forces`; particles that are not in `order` are left alone."""
    for q in range(order.shape[0]):
        p = bounded(order[q], MOST_PARTICLES)
        row = rows_of(q)[1]
        for j in ti.static(range(3)):
            column = force[row + j]
            acceleration[p, j] = column[3]
            for i in ti.static(range(3)):
                gradient[p, i, j] = column[i]


@ti.kernel
def combine_forces(phi: vectors, dphi: matrices, gravity: vectors, coefficients: matrices, state: states, force: forces):
    """Rows of `force` for all copies: a_p = g_p + sum_j phi_pj c_j and grad a_p = (sum_j c_j dphi_pj/dX) F^-1, with F from `state`.

    phi (M, P), dphi (M, P, 3), gravity (M, 3), coefficients (copies, P, 3).
    """
    for q in range(coefficients.shape[0] * phi.shape[0]):
        copy, p = q // phi.shape[0], q % phi.shape[0]
        a, G = real_vector(gravity, p), ti.Matrix.zero(float, 3, 3)
        for k in range(phi.shape[1]):
            c = ti.Vector([ti.cast(coefficients[copy, k, i], float) for i in ti.static(range(3))])
            slope = ti.Vector([ti.cast(dphi[p, k, i], float) for i in ti.static(range(3))])
            a += ti.cast(phi[p, k], float) * c
            G += c.outer_product(slope)
        at = rows_of(q)
        F0, F1, F2 = state[at[0]], state[at[0] + 1], state[at[0] + 2]
        G = G @ from_columns(F0, F1, F2).inverse()
        for j in ti.static(range(3)):
            force[at[1] + j] = ti.Vector([G[0, j], G[1, j], G[2, j], a[j]])
