"""Particles in packed rows, and their transfer to a flat grid and back with quadratic B-splines.

The state of a particle is stored in vectors of four numbers, one for each axis j:

    states       F_0j F_1j F_2j x_j, then C_0j C_1j C_2j v_j        six vectors, 96 bytes in single precision
    forces       G_0j G_1j G_2j a_j                                 three vectors; G is d a / d x
    nodes        momentum or velocity, and mass                     one vector

so that what is added to a node, S + i X + j Y + k Z, and the moments that are gathered are such vectors from the start. They stay in the
processor's SIMD vectors from the load to the store (`settings.native_vectors`; augmented assignment to such a vector is an atomic
operation, which Taichi cannot compile). Indices are `bounded`. All functions are generic in precision.
"""
# The compiler reads the annotations of functions at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti

states = ti.types.ndarray(element_shape=(4,), ndim=1)
"""(6 N,), see above."""
constants = ti.types.ndarray(ndim=1)
"""(8 N,): the eight constants of each particle, one particle after another, as named below."""
MASS, VOLUME, MU, LAM, YIELD_STRESS, VISCOSITY, LAW, ROLE = range(8)
"""Places of a particle's constants in its part of `constants`."""
forces = ti.types.ndarray(element_shape=(4,), ndim=1)
"""(3 N,), see above; a includes gravity."""
nodes = ti.types.ndarray(element_shape=(4,), ndim=1)
"""Momentum or velocity, and mass."""

integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
table = ti.types.ndarray(dtype=ti.i32, ndim=2)
flags = ti.types.ndarray(dtype=ti.i32, ndim=3)
numbers = ti.types.ndarray(ndim=1)
rows = ti.types.ndarray(ndim=2)
lattice_rows = ti.types.ndarray(ndim=4)

MOST_NODES_ACROSS = 2**13 - 1
"""Most nodes of a grid along y or z."""
MOST_NODES = 2**28
"""Most nodes of all tasks' grids together. With `MOST_NODES_ACROSS` this keeps every index of a number in a grid below 2³¹."""
MOST_PARTICLES = 2**25
"""Most particles: their 24 numbers each have indices below 2³¹."""


@ti.func
def bounded(i, most: ti.template()):
    """i unchanged, but so that the compiler knows that it lies in 0..most, as it always does.

    Only if no sum of 32-bit indices can overflow may the compiler put the constant part of an address into the load or store itself;
    otherwise every number of a row costs two more instructions for its address, a sixth of all instructions.
    """
    return ti.max(0, ti.min(i, most))


@ti.func
def rows_of(p):
    """Where particle p begins in `states`, `forces` and `constants`."""
    return bounded(6 * p, 6 * MOST_PARTICLES), bounded(3 * p, 3 * MOST_PARTICLES), bounded(8 * p, 8 * MOST_PARTICLES)


@ti.func
def lattice_of(lattice: ti.template()):
    """offset (3,) [m], dx [m], dt [s] from an array of these five numbers."""
    return ti.Vector([lattice[0], lattice[1], lattice[2]]), lattice[3], lattice[4]


@ti.func
def triple(bounds: ti.template(), row: ti.template()):
    """A row of three integers of the array `bounds`, see `body.Body`."""
    return ti.Vector([bounds[3 * row], bounds[3 * row + 1], bounds[3 * row + 2]])


@ti.func
def bounds_of(bounds: ti.template()):
    """First node lo (3,) and node counts dims (3,) of the box of nodes in use."""
    d = triple(bounds, 1)
    return triple(bounds, 0), ti.Vector([d[0], bounded(d[1], MOST_NODES_ACROSS), bounded(d[2], MOST_NODES_ACROSS)])


@ti.func
def node_count(bounds: ti.template()):
    """Number of nodes in the box of nodes in use."""
    d = triple(bounds, 1)
    return d[0] * d[1] * d[2]


@ti.func
def with_fourth(a, fourth):
    """a (4,) with its fourth number replaced."""
    return ti.Vector([a[0], a[1], a[2], fourth])


@ti.func
def fourths(a, b, c, fourth):
    """The fourth numbers of a, b, c, and `fourth`."""
    return ti.Vector([a[3], b[3], c[3], fourth])


@ti.func
def base_of(x, offset, inv_dx):
    """First (3,) int of the three nodes along each axis that a particle at x [m] touches."""
    return ti.Vector([ti.floor((x[a] - offset[a]) * inv_dx - 0.5, ti.i32) for a in ti.static(range(3))])


@ti.func
def spread(low: ti.template(), high: ti.template(), x):
    """Widen the box with corners low, high (3,) so that it contains x."""
    for a in ti.static(range(3)):
        low[a] = ti.select(x[a] < low[a], x[a], low[a])  # one instruction; min takes three
        high[a] = ti.select(x[a] > high[a], x[a], high[a])


@ti.func
def spline(f):
    """Weights of the first, second and third node along every axis, each (4,); f (4,) in 0.5..1.5: distance to the first node [cells]."""
    a, b, c = 1.5 - f, f - 1.0, f - 0.5
    return 0.5 * (a * a), 0.75 - b * b, 0.5 * (c * c)


@ti.func
def spline_slope(f):
    """Derivatives of the weights of `spline` by f."""
    return f - 1.5, 2.0 - 2.0 * f, f - 0.5


@ti.func
def corner_of(x, offset, inv_dx, lo, dims, first_node):
    """The number of the first of a particle's 27 nodes in a grid of `dims` nodes, whose first node is `lo` and has the number `first_node`;
    and the particle's distance f (4,) from that node [cells]. The fourth numbers of x (4,) and f have no meaning."""
    local = (x - ti.Vector([offset[0], offset[1], offset[2], 0.0])) * inv_dx
    base = ti.floor(local - 0.5)
    c = [ti.cast(base[a], ti.i32) - lo[a] for a in ti.static(range(3))]
    return bounded(first_node + (c[0] * dims[1] + c[1]) * dims[2] + c[2], MOST_NODES), local - base


@ti.func
def scatter(f, S, X, Y, Z, at, dims, grid: ti.template()):
    """Add w_ijk (S + i X + j Y + k Z) to the 27 nodes from `at` on."""
    w = spline(f)
    S_Z = S + Z
    low, middle, high = w[0][2] * S, w[1][2] * S_Z, w[2][2] * (S_Z + Z)
    low_x, middle_x, high_x = w[0][2] * X, w[1][2] * X, w[2][2] * X
    low_y, middle_y, high_y = w[0][2] * Y, w[1][2] * Y, w[2][2] * Y
    for i in ti.static(range(3)):
        first, second, third = low, middle, high
        for j in ti.static(range(3)):
            row = at + (i * dims[1] + j) * dims[2]
            w_ij = w[i][0] * w[j][1]
            # All loads before all stores: after a store the compiler must look up the array's address again.
            a, b, c = grid[row] + w_ij * first, grid[row + 1] + w_ij * second, grid[row + 2] + w_ij * third
            grid[row], grid[row + 1], grid[row + 2] = a, b, c
            if ti.static(j < 2):
                first, second, third = first + low_y, second + middle_y, third + high_y
        if ti.static(i < 2):
            low, middle, high = low + low_x, middle + middle_x, high + high_x


@ti.func
def gather(f, at, dims, grid: ti.template()):
    """The sums over the 27 nodes of w g, w g i, w g j and w g k, with the nodes' four-vectors g."""
    w = spline(f)
    zero = 0.0 * f
    total, moment_x, moment_y, moment_z = zero, zero, zero, zero
    for i in ti.static(range(3)):
        plane, plane_y, plane_z = zero, zero, zero
        row = at + i * dims[1] * dims[2]
        for k in ti.static(range(3)):
            middle, last = w[1][1] * grid[row + dims[2] + k], w[2][1] * grid[row + 2 * dims[2] + k]
            ends = middle + last
            part = w[k][2] * (w[0][1] * grid[row + k] + ends)
            plane = plane + part
            plane_y = plane_y + w[k][2] * (ends + last)
            if ti.static(k > 0):
                plane_z = plane_z + k * part
        total = total + w[i][0] * plane
        moment_y = moment_y + w[i][0] * plane_y
        moment_z = moment_z + w[i][0] * plane_z
        if ti.static(i > 0):
            moment_x = moment_x + (i * w[i][0]) * plane
    return total, moment_x, moment_y, moment_z


@ti.func
def spline_pull(f, S, X, Y, Z, at, dims, grid: ti.template(), T, U, V, W, other: ti.template()):
    """Derivative through the weights: for each axis a, the sum over the 27 nodes of dw/df_a times

    g . (S + i X + j Y + k Z) + h . (T + i U + j V + k W), with the four-vectors g of `grid` and h of `other`.

    Returns:
        Three vectors (4,), one for each axis; the caller sums the four numbers of each.
    """
    w, slope = spline(f), spline_slope(f)
    zero = 0.0 * f
    pull_x, pull_y, pull_z = zero, zero, zero
    for i in ti.static(range(3)):
        plane, plane_y, plane_z = zero, zero, zero
        value, other_value = S, T
        for j in ti.static(range(3)):
            row = at + (i * dims[1] + j) * dims[2]
            value_1, other_1 = value + Z, other_value + W
            first = grid[row] * value + other[row] * other_value
            middle = grid[row + 1] * value_1 + other[row + 1] * other_1
            last = grid[row + 2] * (value_1 + Z) + other[row + 2] * (other_1 + W)
            if ti.static(j < 2):
                value, other_value = value + Y, other_value + V
            line = w[0][2] * first + w[1][2] * middle + w[2][2] * last
            plane = plane + w[j][1] * line
            plane_y = plane_y + slope[j][1] * line
            plane_z = plane_z + w[j][1] * (slope[0][2] * first + slope[1][2] * middle + slope[2][2] * last)
        pull_x = pull_x + slope[i][0] * plane
        pull_y = pull_y + w[i][0] * plane_y
        pull_z = pull_z + w[i][0] * plane_z
        if ti.static(i < 2):
            S, T = S + X, T + U
    return pull_x, pull_y, pull_z
