"""The substep, and the kernel that runs substeps for many copies of one body at once.

Copies are independent: the outer loop over them is the compiler's parallel loop, and all of a copy's work stays on one thread with one
private grid. That needs no atomics and no barrier, and a grid of a few thousand nodes stays in the core's cache.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..lattice.boundary import FREE, HELD
from ..laws.plasticity import VON_MISES, plastic_flow
from .transfer import affine_momentum, base_of, clear, gather, momentum_to_velocity, scatter, vec3

RUNNING, NOT_FINITE, TOO_FAST, INVERTED, GRID_FULL, BURST = 0, 1, 2, 3, 4, 5
"""Status of a copy. GRID_FULL is no failure: the caller gives more nodes and calls again."""

scalars = ti.types.ndarray(dtype=ti.f64, ndim=1)
flags = ti.types.ndarray(dtype=ti.i32, ndim=1)
vectors = ti.types.ndarray(dtype=ti.types.vector(3, ti.f64), ndim=2)
matrices = ti.types.ndarray(dtype=ti.types.matrix(3, 3, ti.f64), ndim=2)
grids = ti.types.ndarray(dtype=ti.types.vector(4, ti.f64), ndim=2)
nodes = ti.types.ndarray(dtype=ti.i32, ndim=3)
statuses = ti.types.ndarray(dtype=ti.i32, ndim=2)


@ti.func
def window(b, x: ti.template(), role: ti.template(), offset, dx):
    """The box of nodes that copy b touches: first node and node counts."""
    lo, hi = ti.Vector([2**30, 2**30, 2**30]), ti.Vector([-(2**30), -(2**30), -(2**30)])
    for p in range(x.shape[1]):
        if role[p] != HELD:
            base = base_of(x[b, p], offset, 1.0 / dx)
            lo = ti.min(lo, base)
            hi = ti.max(hi, base)
    if hi[0] < lo[0]:  # everything is held
        hi = lo
    return lo, hi - lo + 3


@ti.func
def particles_to_grid(
    plastic: ti.template(), b, r, mass: ti.template(), volume: ti.template(), mu: ti.template(), lam: ti.template(),
    viscosity: ti.template(), law: ti.template(), role: ti.template(),
    x: ti.template(), v: ti.template(), C: ti.template(), F: ti.template(),
    force_row, acceleration: ti.template(), gradient: ti.template(), offset, dx, dt, lo, dims, grid: ti.template(),
):  # fmt: skip
    """p2g of the particles in row b under the force in row `force_row`."""
    for p in range(x.shape[1]):
        if role[p] != HELD:
            A = affine_momentum(
                plastic, law[p], mass[p], volume[p], mu[p], lam[p], viscosity[p], C[b, p], F[b, p], gradient[force_row, p], dt, 1.0 / dx
            )
            scatter(x[b, p], mass[p] * (v[b, p] + dt * acceleration[force_row, p]), mass[p], A, offset, dx, lo, dims, grid, r)


@ti.func
def grid_to_particles(
    plastic: ti.template(), b, r, mu: ti.template(), yield_stress: ti.template(), viscosity: ti.template(), law: ti.template(),
    role: ti.template(), x: ti.template(), v: ti.template(), C: ti.template(), F: ti.template(),
    offset, dx, dt, lo, dims, grid: ti.template(),
):  # fmt: skip
    """g2p of copy b. Pinned particles deform but keep their place. Returns status, particle and the next window."""
    status, culprit = RUNNING, -1
    next_lo, next_hi = ti.Vector([2**30, 2**30, 2**30]), ti.Vector([-(2**30), -(2**30), -(2**30)])
    for p in range(x.shape[1]):
        if role[p] != HELD:
            v_p, C_p = gather(x[b, p], offset, dx, lo, dims, grid, r)
            F_p = F[b, p] + dt * (C_p @ F[b, p])
            x_p = x[b, p]
            if role[p] == FREE:
                x_p += dt * v_p
            size = v_p.norm() + C_p.norm()
            if not (size < 1e300):  # also when it is NaN
                status, culprit = NOT_FINITE, p
            elif dt * v_p.norm() > dx:
                status, culprit = TOO_FAST, p
            elif not (F_p.determinant() > 0.0):
                status, culprit = INVERTED, p
            else:
                base = base_of(x_p, offset, 1.0 / dx)
                next_lo = ti.min(next_lo, base)
                next_hi = ti.max(next_hi, base)
                if ti.static(plastic):
                    if law[p] >= VON_MISES:
                        F_p = plastic_flow(law[p], F_p, mu[p], yield_stress[p], viscosity[p], dt)
            x[b, p], v[b, p], C[b, p], F[b, p] = x_p, v_p, C_p, F_p
    if next_hi[0] < next_lo[0]:
        next_hi = next_lo
    return status, culprit, next_lo, next_hi - next_lo + 3


STRIDE = 1024
"""Turns of the outer loop per copy."""


@ti.kernel
def run_substeps(
    # model; `plastic`: whether any particle has a plastic law
    plastic: ti.template(), mass: scalars, volume: scalars, mu: scalars, lam: scalars, yield_stress: scalars, viscosity: scalars,
    law: flags, role: flags, clamp_lo: ti.types.vector(3, ti.i32), clamp: nodes,
    offset: vec3, dx: ti.f64, dt: ti.f64,
    # which copies, and up to which substep of the frame
    copies: flags, until: ti.i32,
    # force
    acceleration: vectors, gradient: matrices,
    # state in and out
    x: vectors, v: vectors, C: matrices, F: matrices,
    # scratch
    grid: grids,
    # progress in and out: status (B, 4) = code, particle, substeps done, nodes wanted
    status: statuses,
):  # fmt: skip
    """Bring the copies listed in `copies` from substep status[b, 2] to `until`, or to the substep at which a copy fails."""
    # One copy per task: they take long, and unevenly when one of them fails. The compiler runs loops of less than about a thousand turns on
    # one thread, so every copy is given a block of STRIDE turns, all but one of them empty.
    ti.loop_config(block_dim=STRIDE)
    for turn in range(copies.shape[0] * STRIDE):
        if turn % STRIDE == 0:
            r = turn // STRIDE
            b = copies[r]
            lo, dims = window(b, x, role, offset, dx)
            code = RUNNING
            while status[b, 2] < until and code == RUNNING:
                # In 64 bits: the box of an exploding body overflows 32.
                wanted = ti.cast(dims[0], ti.i64) * dims[1] * dims[2]
                if wanted > grid.shape[1]:
                    code = GRID_FULL
                    status[b, 3] = ti.cast(ti.min(wanted, 2**31 - 1), ti.i32)
                else:
                    clear(grid, r, dims)
                    particles_to_grid(
                        plastic, b, r, mass, volume, mu, lam, viscosity, law, role, x, v, C, F, b, acceleration, gradient,
                        offset, dx, dt, lo, dims, grid,
                    )
                    momentum_to_velocity(lo, dims, clamp_lo, clamp, grid, r)
                    code, status[b, 1], lo, dims = grid_to_particles(
                        plastic, b, r, mu, yield_stress, viscosity, law, role, x, v, C, F, offset, dx, dt, lo, dims, grid
                    )
                    if code == RUNNING:
                        status[b, 2] += 1
            status[b, 0] = code


@ti.kernel
def assemble_force(
    phi: ti.types.ndarray(dtype=ti.f64, ndim=2), dphi: ti.types.ndarray(dtype=ti.types.vector(3, ti.f64), ndim=2),
    gravity: ti.types.ndarray(dtype=ti.types.vector(3, ti.f64), ndim=1), copies: flags,
    coefficients: ti.types.ndarray(dtype=ti.types.vector(3, ti.f64), ndim=2), F: matrices,
    acceleration_out: vectors, gradient_out: matrices,
):  # fmt: skip
    """a_p = g_p + sum_j phi_j(X_p) c_j and grad a_p = (sum_j c_j dphi_j/dX) F^-1 for the listed copies."""
    for r in range(copies.shape[0]):
        b = copies[r]
        for p in range(phi.shape[0]):
            a = gravity[p]
            G = ti.Matrix.zero(ti.f64, 3, 3)
            for j in range(phi.shape[1]):
                a += phi[p, j] * coefficients[b, j]
                G += coefficients[b, j].outer_product(dphi[p, j])
            acceleration_out[b, p] = a
            gradient_out[b, p] = G @ F[b, p].inverse()
