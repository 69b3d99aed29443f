"""Between the states that the rest of the engine sees, float64 and in the model's order, and the packed ones of the kernels."""
# Taichi reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import taichi as ti

from .packed import MOST_PARTICLES, bounded, forces, packed, packed_force, states, unpacked

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
    """Row p of `state` is particle order[p], its position relative to offset (3,)."""
    for q in range(order.shape[0]):
        p = bounded(order[q], MOST_PARTICLES)
        # The difference in double precision, which is what single precision needs its digits for.
        place = ti.Vector([ti.cast(x[p, i] - offset[i], float) for i in ti.static(range(3))])
        state[q] = packed(place, real_vector(v, p), real_matrix(C, p), real_matrix(F, p))


@ti.kernel
def pack_forces(order: order_of, acceleration: vectors, gradient: matrices, force: forces):
    """Row p of `force` is particle order[p]; a gradient of no particles is zero."""
    for q in range(order.shape[0]):
        p = bounded(order[q], MOST_PARTICLES)
        G = ti.Matrix.zero(float, 3, 3)
        if gradient.shape[0] > 0:
            G = real_matrix(gradient, p)
        force[q] = packed_force(real_vector(acceleration, p), G)


@ti.kernel
def unpack(order: order_of, state: states, offset: numbers, x: vectors, v: vectors, C: matrices, F: matrices):
    """`pack` backwards; particles that `order` does not name are left alone."""
    for q in range(order.shape[0]):
        p = bounded(order[q], MOST_PARTICLES)
        place, speed, affine, deformation = unpacked(state[q])
        for i in ti.static(range(3)):
            x[p, i] = ti.cast(place[i], ti.f64) + offset[i]
            v[p, i] = speed[i]
            for j in ti.static(range(3)):
                C[p, i, j] = affine[i, j]
                F[p, i, j] = deformation[i, j]
