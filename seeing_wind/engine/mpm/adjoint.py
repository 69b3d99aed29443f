"""The substep backwards: derivatives of a loss with respect to a frame's start, from those with respect to its end.

Each function here is the adjoint of its namesake in `transfer` and `substep`, called in reverse order. A name with `_bar` is the
derivative of the loss with respect to the name. The grid is not stored: every backward substep first redoes its p2g from the stored
particles.
"""
# Taichi reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import taichi as ti

from .boundary import FREE, HELD
from .constitutive import kirchhoff_adjoint
from .substep import (
    GRID_FULL,
    RUNNING,
    flags,
    grid_to_particles,
    grids,
    matrices,
    nodes,
    particles_to_grid,
    scalars,
    statuses,
    vectors,
    window,
)
from .transfer import affine_momentum, base_of, clear, momentum_to_velocity, spline, spline_slope, vec3, vec4


@ti.func
def gather_adjoint(x, v_bar, C_bar, offset, dx, lo, dims, grid: ti.template(), grid_bar: ti.template(), r):
    """Adjoint of `gather`: adds to the nodes' v_bar, returns x_bar."""
    inv_dx = 1.0 / dx
    base = base_of(x, offset, inv_dx)
    f = (x - offset) * inv_dx - ti.cast(base, ti.f64)
    w, slope = spline(f), spline_slope(f)
    corner = base - lo
    B_bar = (4.0 * inv_dx * inv_dx) * C_bar
    x_bar = vec3(0.0)
    for i, j, k in ti.ndrange(3, 3, 3):
        node = ((corner[0] + i) * dims[1] + corner[1] + j) * dims[2] + corner[2] + k
        g = grid[r, node]
        v_i = vec3(g[0], g[1], g[2])
        weight = w[i, 0] * w[j, 1] * w[k, 2]
        gradient = inv_dx * vec3(slope[i, 0] * w[j, 1] * w[k, 2], w[i, 0] * slope[j, 1] * w[k, 2], w[i, 0] * w[j, 1] * slope[k, 2])
        distance = dx * (vec3(i, j, k) - f)
        v_i_bar = v_bar + B_bar @ distance
        add = weight * v_i_bar
        grid_bar[r, node] = grid_bar[r, node] + vec4(add[0], add[1], add[2], 0.0)
        x_bar += v_i_bar.dot(v_i) * gradient - weight * (B_bar.transpose() @ v_i)
    return x_bar


@ti.func
def momentum_to_velocity_adjoint(lo, dims, clamp_lo, clamp: ti.template(), grid: ti.template(), grid_bar: ti.template(), r):
    """v_i = q_i / m_i: turns the nodes' v_bar into q_bar and m_bar; a clamped node passes nothing on."""
    for i in range(dims[0]):
        for j in range(dims[1]):
            for k in range(dims[2]):
                node = (i * dims[1] + j) * dims[2] + k
                g, bar = grid[r, node], grid_bar[r, node]
                if g[3] > 0.0:
                    inv_mass = 1.0 / g[3]
                    c = lo + ti.Vector([i, j, k]) - clamp_lo
                    if 0 <= c[0] < clamp.shape[0] and 0 <= c[1] < clamp.shape[1] and 0 <= c[2] < clamp.shape[2]:
                        if clamp[c[0], c[1], c[2]] != 0:
                            inv_mass = 0.0
                    along = bar[0] * g[0] + bar[1] * g[1] + bar[2] * g[2]
                    grid_bar[r, node] = inv_mass * vec4(bar[0], bar[1], bar[2], -along)


@ti.func
def scatter_adjoint(x, momentum, mass, A, offset, dx, lo, dims, grid_bar: ti.template(), r):
    """Adjoint of `scatter`: returns x_bar, momentum_bar, A_bar."""
    inv_dx = 1.0 / dx
    base = base_of(x, offset, inv_dx)
    f = (x - offset) * inv_dx - ti.cast(base, ti.f64)
    w, slope = spline(f), spline_slope(f)
    corner = base - lo
    x_bar, momentum_bar, A_bar = vec3(0.0), vec3(0.0), ti.Matrix.zero(ti.f64, 3, 3)
    for i, j, k in ti.ndrange(3, 3, 3):
        node = ((corner[0] + i) * dims[1] + corner[1] + j) * dims[2] + corner[2] + k
        bar = grid_bar[r, node]
        q_bar = vec3(bar[0], bar[1], bar[2])
        weight = w[i, 0] * w[j, 1] * w[k, 2]
        gradient = inv_dx * vec3(slope[i, 0] * w[j, 1] * w[k, 2], w[i, 0] * slope[j, 1] * w[k, 2], w[i, 0] * w[j, 1] * slope[k, 2])
        distance = dx * (vec3(i, j, k) - f)
        momentum_bar += weight * q_bar
        A_bar += weight * q_bar.outer_product(distance)
        x_bar += (q_bar.dot(momentum + A @ distance) + bar[3] * mass) * gradient - weight * (A.transpose() @ q_bar)
    return x_bar, momentum_bar, A_bar


@ti.func
def grid_to_particles_adjoint(
    s, r, role: ti.template(), x: ti.template(), F: ti.template(), C: ti.template(),
    x_bar: ti.template(), v_bar: ti.template(), C_bar: ti.template(), F_bar: ti.template(),
    offset, dx, dt, lo, dims, grid: ti.template(), grid_bar: ti.template(),
):  # fmt: skip
    """g2p backwards from row s + 1 to row s of the history: v_bar and C_bar are used up, x_bar and F_bar become partial."""
    for p in range(x.shape[1]):
        if role[p] != HELD:
            C_next, F_next_bar = C[s + 1, p], F_bar[0, p]
            v_total = v_bar[0, p]
            if role[p] == FREE:
                v_total += dt * x_bar[0, p]
            C_total = C_bar[0, p] + dt * F_next_bar @ F[s, p].transpose()
            F_bar[0, p] = F_next_bar + dt * C_next.transpose() @ F_next_bar
            x_bar[0, p] += gather_adjoint(x[s, p], v_total, C_total, offset, dx, lo, dims, grid, grid_bar, r)


@ti.func
def particles_to_grid_adjoint(
    s, r, mass: ti.template(), volume: ti.template(), mu: ti.template(), lam: ti.template(), law: ti.template(), role: ti.template(),
    x: ti.template(), v: ti.template(), C: ti.template(), F: ti.template(), acceleration: ti.template(), gradient: ti.template(),
    x_bar: ti.template(), v_bar: ti.template(), C_bar: ti.template(), F_bar: ti.template(),
    acceleration_bar: ti.template(), gradient_bar: ti.template(), offset, dx, dt, lo, dims, grid_bar: ti.template(),
):  # fmt: skip
    """p2g backwards: completes the derivatives with respect to row s of the history and adds up those of the force."""
    for p in range(x.shape[1]):
        if role[p] != HELD:
            A = affine_momentum(False, law[p], mass[p], volume[p], mu[p], lam[p], C[s, p], F[s, p], gradient[0, p], dt, 1.0 / dx)
            momentum = mass[p] * (v[s, p] + dt * acceleration[0, p])
            through_x, momentum_bar, A_bar = scatter_adjoint(x[s, p], momentum, mass[p], A, offset, dx, lo, dims, grid_bar, r)
            x_bar[0, p] += through_x
            v_bar[0, p] = mass[p] * momentum_bar
            C_bar[0, p] = mass[p] * A_bar
            acceleration_bar[0, p] += dt * mass[p] * momentum_bar
            gradient_bar[0, p] += dt * mass[p] * A_bar
            tau_bar = (-4.0 * dt * volume[p] / (dx * dx)) * A_bar
            F_bar[0, p] += kirchhoff_adjoint(law[p], F[s, p], mu[p], lam[p], tau_bar)


@ti.kernel
def record_substeps(
    # model
    mass: scalars, volume: scalars, mu: scalars, lam: scalars, law: flags, role: flags,
    clamp_lo: ti.types.vector(3, ti.i32), clamp: nodes, offset: vec3, dx: ti.f64, dt: ti.f64,
    # force (1, N), states (substeps + 1, N): row 0 in, the others out
    acceleration: vectors, gradient: matrices, x: vectors, v: vectors, C: matrices, F: matrices,
    # scratch, and status (1, 4) as in `substep.run_substeps`
    grid: grids, status: statuses,
):  # fmt: skip
    """The forward substeps of an elastic model once more, each state kept."""
    for r in range(1):
        code = RUNNING
        while status[0, 2] < x.shape[0] - 1 and code == RUNNING:
            s = status[0, 2] + 1
            lo, dims = window(s - 1, x, role, offset, dx)
            wanted = ti.cast(dims[0], ti.i64) * dims[1] * dims[2]
            if wanted > grid.shape[1]:
                code = GRID_FULL
                status[0, 3] = ti.cast(wanted, ti.i32)
            else:
                for p in range(x.shape[1]):
                    x[s, p], v[s, p], C[s, p], F[s, p] = x[s - 1, p], v[s - 1, p], C[s - 1, p], F[s - 1, p]
                clear(grid, r, dims)
                particles_to_grid(
                    False, s, r, mass, volume, mu, lam, law, role, x, v, C, F, 0, acceleration, gradient, offset, dx, dt, lo, dims, grid
                )
                momentum_to_velocity(lo, dims, clamp_lo, clamp, grid, r)
                code, status[0, 1], lo, dims = grid_to_particles(
                    False, s, r, mu, mu, mu, law, role, x, v, C, F, offset, dx, dt, lo, dims, grid
                )
                if code == RUNNING:
                    status[0, 2] = s
        status[0, 0] = code


@ti.kernel
def run_substeps_adjoint(
    # model
    mass: scalars, volume: scalars, mu: scalars, lam: scalars, law: flags, role: flags,
    clamp_lo: ti.types.vector(3, ti.i32), clamp: nodes, offset: vec3, dx: ti.f64, dt: ti.f64,
    # which substeps, backwards from `last` - 1 to `first`
    first: ti.i32, last: ti.i32,
    # force (1, N) and the stored states (substeps + 1, N)
    acceleration: vectors, gradient: matrices, x: vectors, v: vectors, C: matrices, F: matrices,
    # derivatives (1, N), in: at `last`, out: at `first`; those of the force are added up
    x_bar: vectors, v_bar: vectors, C_bar: matrices, F_bar: matrices, acceleration_bar: vectors, gradient_bar: matrices,
    # scratch
    grid: grids, grid_bar: grids,
):  # fmt: skip
    """One copy, one thread: see `substep`."""
    for r in range(1):
        for back in range(last - first):
            s = last - 1 - back
            lo, dims = window(s, x, role, offset, dx)
            clear(grid, r, dims)
            clear(grid_bar, r, dims)
            particles_to_grid(
                False, s, r, mass, volume, mu, lam, law, role, x, v, C, F, 0, acceleration, gradient, offset, dx, dt, lo, dims, grid
            )
            momentum_to_velocity(lo, dims, clamp_lo, clamp, grid, r)
            grid_to_particles_adjoint(s, r, role, x, F, C, x_bar, v_bar, C_bar, F_bar, offset, dx, dt, lo, dims, grid, grid_bar)
            momentum_to_velocity_adjoint(lo, dims, clamp_lo, clamp, grid, grid_bar, r)
            particles_to_grid_adjoint(
                s, r, mass, volume, mu, lam, law, role, x, v, C, F, acceleration, gradient,
                x_bar, v_bar, C_bar, F_bar, acceleration_bar, gradient_bar, offset, dx, dt, lo, dims, grid_bar,
            )  # fmt: skip
