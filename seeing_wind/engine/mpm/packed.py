"""Transfer between packed particles and a flat grid: what `transfer` does, laid out for one body of many particles on all cores.

A particle's x v C F are 24 consecutive numbers (three rows of eight), its constants eight, its force twelve, a node's momentum and mass
four. Rows of a power of two let the compiler see that numbers are neighbours in memory, and so use vector instructions; loose arrays of
threes doubled the instructions. What goes into a scatter and comes out of a gather passes through `scratch` for the same reason: it
vectorises what begins and ends in neighbouring memory. Indices are `bounded`. All functions are generic in precision, and on a GPU,
where threads share a grid, `atomic` adds atomically.
"""
# Taichi reads the annotations of functions at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import taichi as ti

from .transfer import spline, spline_slope

states = ti.types.ndarray(element_shape=(3, 8), ndim=1)
"""x 0..2, v 3..5, C 6..14, F 15..23, matrices row by row."""
constants = ti.types.ndarray(element_shape=(8,), ndim=1)
"""mass, volume, mu, lam, yield stress, viscosity, law, role."""
forces = ti.types.ndarray(element_shape=(3, 4), ndim=1)
"""Row i: acceleration a_i (gravity included) and d a_i / d x."""
nodes = ti.types.ndarray(element_shape=(4,), ndim=1)
"""Momentum or velocity, and mass."""

integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
numbers = ti.types.ndarray(ndim=1)

SCRATCH = 8
"""Vectors of `scratch` per task; room enough that two tasks share no line of the cache."""
MOST_NODES_ACROSS = 2**13 - 1
"""Along y or z."""
MOST_NODES = 2**28
"""Of all tasks' grids. With `MOST_NODES_ACROSS` this keeps every index of a number in a grid below 2³¹."""
MOST_PARTICLES = 2**25
"""Whose 24 numbers have indices below 2³¹."""


@ti.func
def bounded(i, most: ti.template()):
    """i, with the news for the compiler that it lies in 0..most, as it always does.

    Only where no sum of 32-bit indices can overflow may it add the constant part of an address for nothing, within the instruction that
    loads or stores; otherwise every number of a row costs two instructions for its address, a sixth of all.
    """
    return ti.max(0, ti.min(i, most))


@ti.func
def lattice_of(lattice: ti.template()):
    """offset (3,) [m], dx [m], dt [s] from an array of these five numbers."""
    return ti.Vector([lattice[0], lattice[1], lattice[2]]), lattice[3], lattice[4]


@ti.func
def triple(window: ti.template(), row: ti.template()):
    """A row of three of the array of integers `window`, see `body.Body`."""
    return ti.Vector([window[3 * row], window[3 * row + 1], window[3 * row + 2]])


@ti.func
def window_of(window: ti.template()):
    """lo (3,), dims (3,), the box of nodes in use."""
    d = triple(window, 1)
    return triple(window, 0), ti.Vector([d[0], bounded(d[1], MOST_NODES_ACROSS), bounded(d[2], MOST_NODES_ACROSS)])


@ti.func
def unpacked(s):
    """x, v, C, F of a row of `states`."""
    x = ti.Vector([s[0, 0], s[0, 1], s[0, 2]])
    v = ti.Vector([s[0, 3], s[0, 4], s[0, 5]])
    C = ti.Matrix([[s[0, 6], s[0, 7], s[1, 0]], [s[1, 1], s[1, 2], s[1, 3]], [s[1, 4], s[1, 5], s[1, 6]]])
    F = ti.Matrix([[s[1, 7], s[2, 0], s[2, 1]], [s[2, 2], s[2, 3], s[2, 4]], [s[2, 5], s[2, 6], s[2, 7]]])
    return x, v, C, F


@ti.func
def packed(x, v, C, F):
    """A row of `states`."""
    return ti.Matrix(
        [
            [x[0], x[1], x[2], v[0], v[1], v[2], C[0, 0], C[0, 1]],
            [C[0, 2], C[1, 0], C[1, 1], C[1, 2], C[2, 0], C[2, 1], C[2, 2], F[0, 0]],
            [F[0, 1], F[0, 2], F[1, 0], F[1, 1], F[1, 2], F[2, 0], F[2, 1], F[2, 2]],
        ]
    )


@ti.func
def unpacked_force(g):
    """a, grad a of a row of `forces`."""
    G = ti.Matrix([[g[0, 1], g[0, 2], g[0, 3]], [g[1, 1], g[1, 2], g[1, 3]], [g[2, 1], g[2, 2], g[2, 3]]])
    return ti.Vector([g[0, 0], g[1, 0], g[2, 0]]), G


@ti.func
def packed_force(a, G):
    """A row of `forces`."""
    return ti.Matrix([[a[0], G[0, 0], G[0, 1], G[0, 2]], [a[1], G[1, 0], G[1, 1], G[1, 2]], [a[2], G[2, 0], G[2, 1], G[2, 2]]])


@ti.func
def times(A, b):
    """A b, written out: see `eigen.product`."""
    return ti.Vector([A[i, 0] * b[0] + A[i, 1] * b[1] + A[i, 2] * b[2] for i in ti.static(range(3))])


@ti.func
def transposed_times(A, b):
    """A^T b."""
    return ti.Vector([A[0, i] * b[0] + A[1, i] * b[1] + A[2, i] * b[2] for i in ti.static(range(3))])


@ti.func
def corner_of(x, offset, inv_dx, lo, dims, first_node):
    """Where a particle's 27 nodes begin in a grid of `dims` whose first node is `lo` and has the number `first_node`; and its distance f
    to the first of them in cells."""
    local = (x - offset) * inv_dx
    base = ti.floor(local - 0.5, ti.i32)
    c = base - lo
    return bounded(first_node + (c[0] * dims[1] + c[1]) * dims[2] + c[2], MOST_NODES), local - base


@ti.func
def linear(B, q, fourth, scratch: ti.template(), task, each):
    """Four-vectors S, X, Y, Z of the function S + i X + j Y + k Z that is q + B (i, j, k) at node (i, j, k), with a constant fourth."""
    nil = 0.0 * q[0]  # a constant 0 would keep the compiler from treating all four alike
    S = ti.Vector([q[0], q[1], q[2], fourth])
    X = ti.Vector([B[0, 0], B[1, 0], B[2, 0], nil])
    Y = ti.Vector([B[0, 1], B[1, 1], B[2, 1], nil])
    Z = ti.Vector([B[0, 2], B[1, 2], B[2, 2], nil])
    parts = [S, X, Y, Z]
    for c in ti.static(range(4)):
        scratch[task * SCRATCH + c] = parts[c]
    back = bounded(task * each, MOST_NODES)
    return scratch[back], scratch[back + 1], scratch[back + 2], scratch[back + 3]


@ti.func
def scatter(atomic: ti.template(), f, S, X, Y, Z, at, dims, grid: ti.template()):
    """Adds w_ijk (S + i X + j Y + k Z) to the 27 nodes from `at` on."""
    w = spline(f)
    low, middle, high = w[0, 2] * S, w[1, 2] * (S + Z), w[2, 2] * (S + Z + Z)
    low_x, middle_x, high_x = w[0, 2] * X, w[1, 2] * X, w[2, 2] * X
    low_y, middle_y, high_y = w[0, 2] * Y, w[1, 2] * Y, w[2, 2] * Y
    for i in ti.static(range(3)):
        first, second, third = low, middle, high
        for j in ti.static(range(3)):
            row = at + (i * dims[1] + j) * dims[2]
            w_ij = w[i, 0] * w[j, 1]
            if ti.static(atomic):
                ti.atomic_add(grid[row], w_ij * first)
                ti.atomic_add(grid[row + 1], w_ij * second)
                ti.atomic_add(grid[row + 2], w_ij * third)
            else:
                # All loads before all stores: after a store the compiler must look up afresh where the array is.
                a, b, c = grid[row] + w_ij * first, grid[row + 1] + w_ij * second, grid[row + 2] + w_ij * third
                grid[row], grid[row + 1], grid[row + 2] = a, b, c
            if ti.static(j < 2):
                first += low_y
                second += middle_y
                third += high_y
        if ti.static(i < 2):
            low += low_x
            middle += middle_x
            high += high_x


@ti.func
def gather(f, at, dims, grid: ti.template(), scratch: ti.template(), task, each):
    """sum w g (3,) and sum w g (i, j, k)^T (3, 3) over the 27 nodes' four-vectors g, without their fourth."""
    w = spline(f)
    zero = ti.Vector.zero(float, 4)
    total, moment_x, moment_y, moment_z = zero, zero, zero, zero
    for i in ti.static(range(3)):
        plane, plane_y, plane_z = zero, zero, zero
        for j in ti.static(range(3)):
            row = at + (i * dims[1] + j) * dims[2]
            middle = w[1, 2] * grid[row + 1]
            last = w[2, 2] * grid[row + 2]
            line = w[0, 2] * grid[row] + middle + last
            plane += w[j, 1] * line
            plane_z += w[j, 1] * (middle + 2.0 * last)
            if ti.static(j > 0):
                plane_y += (j * w[j, 1]) * line
        total += w[i, 0] * plane
        moment_y += w[i, 0] * plane_y
        moment_z += w[i, 0] * plane_z
        if ti.static(i > 0):
            moment_x += (i * w[i, 0]) * plane
    sums = [total, moment_x, moment_y, moment_z]
    for c in ti.static(range(4)):
        scratch[task * SCRATCH + c] = sums[c]
    back = bounded(task * each, MOST_NODES)
    g, gx, gy, gz = scratch[back], scratch[back + 1], scratch[back + 2], scratch[back + 3]
    return ti.Vector([g[0], g[1], g[2]]), ti.Matrix([[gx[a], gy[a], gz[a]] for a in ti.static(range(3))]), g[3]


@ti.func
def spline_pull(f, S, X, Y, Z, at, dims, grid: ti.template(), scratch: ti.template(), task, each):
    """sum g . (S + i X + j Y + k Z) dw/df over the 27 nodes' four-vectors g: how w_ijk changes with the particle's place, (3,)."""
    w, slope = spline(f), spline_slope(f)
    zero = ti.Vector.zero(float, 4)
    pull_x, pull_y, pull_z = zero, zero, zero
    corner, Z2 = S, Z + Z
    for i in ti.static(range(3)):
        plane, plane_y, plane_z = zero, zero, zero
        value = corner
        for j in ti.static(range(3)):
            row = at + (i * dims[1] + j) * dims[2]
            first, middle, last = grid[row] * value, grid[row + 1] * (value + Z), grid[row + 2] * (value + Z2)
            if ti.static(j < 2):
                value += Y
            line = w[0, 2] * first + w[1, 2] * middle + w[2, 2] * last
            plane += w[j, 1] * line
            plane_y += slope[j, 1] * line
            plane_z += w[j, 1] * (slope[0, 2] * first + slope[1, 2] * middle + slope[2, 2] * last)
        pull_x += slope[i, 0] * plane
        pull_y += w[i, 0] * plane_y
        pull_z += w[i, 0] * plane_z
        if ti.static(i < 2):
            corner += X
    sums = [pull_x, pull_y, pull_z]
    for c in ti.static(range(3)):
        scratch[task * SCRATCH + 4 + c] = sums[c]
    back = bounded(task * each + 4, MOST_NODES)
    px, py, pz = scratch[back], scratch[back + 1], scratch[back + 2]
    return ti.Vector([px.sum(), py.sum(), pz.sum()])
