"""Particles to grid and back: MLS-MPM with APIC and quadratic B-splines, on a grid private to one copy of the body.

Hu et al. 2018, "A moving least squares material point method"; Jiang et al. 2015, "The affine particle-in-cell method".
The lattice's nodes are at offset + dx * (i, j, k) for all integers; `lo` and `dims` name the box of it that the body touches now,
so the body may travel as far as it likes. A node is one 4-vector: momentum (then velocity) and mass. Row `r` of `grid` belongs to copy `b`.

The external acceleration a_p, held over a frame, is added to the particle's velocity before p2g, as in the paper (arXiv 2512.00762); its
gradient goes into the affine momentum. Without that the torque and the strain that a field has over one kernel are lost.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..laws.constitutive import kirchhoff
from ..laws.viscous import is_damped, viscous

vec3 = ti.types.vector(3, ti.f64)
vec4 = ti.types.vector(4, ti.f64)
mat3 = ti.types.matrix(3, 3, ti.f64)


@ti.func
def base_of(x, offset, inv_dx):
    """First of the three nodes per axis that a particle at x [m] touches."""
    local = (x - offset) * inv_dx - 0.5
    return ti.Vector([ti.floor(local[a], ti.i32) for a in ti.static(range(3))])


@ti.func
def spline(f):
    """Weights of the three nodes per axis, row i for node base + i; f in 0.5..1.5 is the distance to the first."""
    a, b, c = 1.5 - f, f - 1.0, f - 0.5
    return ti.Matrix.rows([0.5 * a * a, 0.75 - b * b, 0.5 * c * c])


@ti.func
def spline_slope(f):
    """Derivatives of `spline` with respect to f."""
    return ti.Matrix.rows([f - 1.5, -2.0 * (f - 1.0), f - 0.5])


@ti.func
def clear(grid: ti.template(), r, dims):
    for i in range(dims[0] * dims[1] * dims[2]):
        grid[r, i] = ti.Vector.zero(float, 4)


@ti.func
def affine_momentum(plastic: ti.template(), law, mass, volume, mu, lam, viscosity, C, F, G, dt, inv_dx):
    """A of the MLS-MPM transfer: m (C + dt grad a) - dt V 4/dx² tau [kg/s]."""
    tau, _known = kirchhoff(plastic, law, F, mu, lam)
    if is_damped(law, viscosity):
        tau += viscous(C, mu, lam, viscosity)
    return mass * (C + dt * G) - (4.0 * dt * volume * inv_dx * inv_dx) * tau


@ti.func
def scatter(x, momentum, mass, A, offset, dx, lo, dims, grid: ti.template(), r):
    """Add one particle: each node gets w (m v + A (x_i - x_p)) and w m."""
    inv_dx = 1.0 / dx
    base = base_of(x, offset, inv_dx)
    f = (x - offset) * inv_dx - base
    w = spline(f)
    B = A * dx
    q = momentum - B @ f
    start = ti.Vector([q[0], q[1], q[2], mass])
    column_x = ti.Vector([B[0, 0], B[1, 0], B[2, 0], 0.0])
    column_y = ti.Vector([B[0, 1], B[1, 1], B[2, 1], 0.0])
    column_z = ti.Vector([B[0, 2], B[1, 2], B[2, 2], 0.0])
    corner = base - lo
    for i in ti.static(range(3)):
        for j in ti.static(range(3)):
            row = ((corner[0] + i) * dims[1] + corner[1] + j) * dims[2] + corner[2]
            w_ij = w[i, 0] * w[j, 1]
            value = start + i * column_x + j * column_y
            for k in ti.static(range(3)):
                # The grid is private to this thread: a plain add, no atomic.
                grid[r, row + k] = grid[r, row + k] + (w_ij * w[k, 2]) * (value + k * column_z)


@ti.func
def momentum_to_velocity(lo, dims, clamp_lo, clamp: ti.template(), grid: ti.template(), r):
    """Divide by mass; nodes that `clamp` marks stand still."""
    for i in range(dims[0]):
        for j in range(dims[1]):
            for k in range(dims[2]):
                node = (i * dims[1] + j) * dims[2] + k
                g = grid[r, node]
                if g[3] > 0.0:
                    inv_mass = 1.0 / g[3]
                    c = lo + ti.Vector([i, j, k]) - clamp_lo
                    if 0 <= c[0] < clamp.shape[0] and 0 <= c[1] < clamp.shape[1] and 0 <= c[2] < clamp.shape[2]:
                        if clamp[c[0], c[1], c[2]] != 0:
                            inv_mass = 0.0
                    grid[r, node] = ti.Vector([g[0] * inv_mass, g[1] * inv_mass, g[2] * inv_mass, g[3]])


@ti.func
def gather(x, offset, dx, lo, dims, grid: ti.template(), r):
    """v = sum w v_i and C = 4/dx² sum w v_i (x_i - x_p)^T at one particle."""
    inv_dx = 1.0 / dx
    base = base_of(x, offset, inv_dx)
    f = (x - offset) * inv_dx - base
    w = spline(f)
    corner = base - lo
    zero = ti.Vector.zero(float, 4)
    v, moment_x, moment_y, moment_z = zero, zero, zero, zero
    for i in ti.static(range(3)):
        plane, plane_y, plane_z = zero, zero, zero
        for j in ti.static(range(3)):
            row = ((corner[0] + i) * dims[1] + corner[1] + j) * dims[2] + corner[2]
            middle = w[1, 2] * grid[r, row + 1]
            last = w[2, 2] * grid[r, row + 2]
            line = w[0, 2] * grid[r, row] + middle + last
            plane += w[j, 1] * line
            plane_z += w[j, 1] * (middle + 2.0 * last)
            if ti.static(j > 0):
                plane_y += (j * w[j, 1]) * line
        v += w[i, 0] * plane
        moment_y += w[i, 0] * plane_y
        moment_z += w[i, 0] * plane_z
        if ti.static(i > 0):
            moment_x += (i * w[i, 0]) * plane
    v3 = ti.Vector([v[0], v[1], v[2]])
    moment = ti.Matrix([[moment_x[a], moment_y[a], moment_z[a]] for a in ti.static(range(3))])
    return v3, 4.0 * inv_dx * (moment - v3.outer_product(f))
