"""How a small change of the force moves one body: a frame's substeps linearised, and many changes carried through them at once.

A change is carried in coordinates that move with it: the nodes go along with the changed particles, so that weights stay and

    p2g   q = m (dv + dt da),  B = dx m (D + dt dG) - (4 dt V / dx) (dtau - tau L^T),  L = dF F^-1,  dC = D - C L
    g2p   dv = sum w dv_i,  D = 4/dx² sum w dv_i (x_i - x_p)^T,  dF += dt D F,  dx += dt dv

with D the change's velocity gradient in the unchanged body. It is the substep of `transfer` with the stress exchanged for its derivative,
that of the first Piola-Kirchhoff stress pushed forward (Bonet and Wood, "Nonlinear continuum mechanics", section 6.3). What the moving
nodes neglect is of the order of the discretisation's own error: for a plate of 14 cells 0.2 %, for a block of 2 by 2 by 3 cells 10 %.

Changes that are carried together share weights and stress derivative; they are the lanes of a vector.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..lattice.boundary import FREE, HELD
from ..laws.constitutive import kirchhoff, kirchhoff_adjoint
from ..laws.eigen import product
from ..laws.viscous import doubled_rate, is_damped, viscous
from .substep import GRID_FULL, RUNNING, STRIDE, grid_to_particles, grids, matrices, nodes, particles_to_grid, scalars, vectors, window
from .substep import flags as integers
from .transfer import base_of, clear, momentum_to_velocity, spline, vec3

WIDTHS = (8, 16)
"""Changes that may be carried together: one or two vector registers of single precision, or one of the wide ones."""
STATE = 24
"""Numbers of a change per particle: dv 0..2, D 3..11, dF 12..20, dx 21..23, matrices row by row."""
SOURCE = 12
"""dt m da 0..2, dt m dx dG 3..11, dG column by column."""
RECORD = 102
"""Numbers of a linearised particle: weights 0..8, place f in its cell 9..11, derivative of the stress 12..92, dt F 93..101."""

singles = records = ti.types.ndarray(dtype=ti.f32, ndim=1)
table = ti.types.ndarray(dtype=ti.i32, ndim=2)
inverse_masses = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.kernel
def record_frame(
    plastic: ti.template(), mass: scalars, volume: scalars, mu: scalars, lam: scalars, yield_stress: scalars, viscosity: scalars,
    law: integers, role: integers, clamp_lo: ti.types.vector(3, ti.i32), clamp: nodes, offset: vec3, dx: ti.f64, dt: ti.f64,
    acceleration: vectors, gradient: matrices, least_mass: ti.f64,
    # out: states (S+1, N), of which the first is given; boxes (S, 6): first node, node counts; inverse mass (S, nodes), zero if it stands
    # or has less than least_mass [kg]
    x: vectors, v: vectors, C: matrices, F: matrices, boxes: table, inverse_mass: inverse_masses,
    grid: grids, status: integers,
):  # fmt: skip
    """A frame of one body with all its substeps kept; status (4,): code, particle, substeps done, nodes wanted."""
    for _one in range(1):
        lo, dims = window(0, x, role, offset, dx)
        code, s = RUNNING, 0
        while s < boxes.shape[0] and code == RUNNING:
            # In 64 bits: the box of an exploding body overflows 32.
            wanted = ti.cast(dims[0], ti.i64) * dims[1] * dims[2]
            count = ti.cast(ti.min(wanted, 2**31 - 1), ti.i32)
            if wanted > grid.shape[1]:
                code, status[3] = GRID_FULL, count
            else:
                for a in ti.static(range(3)):
                    boxes[s, a], boxes[s, 3 + a] = lo[a], dims[a]
                clear(grid, 0, dims)
                particles_to_grid(
                    plastic, s, 0, mass, volume, mu, lam, viscosity, law, role, x, v, C, F, 0, acceleration, gradient,
                    offset, dx, dt, lo, dims, grid,
                )  # fmt: skip
                for node in range(count):
                    m = grid[0, node][3]
                    i, j, k = node // (dims[1] * dims[2]), node // dims[2] % dims[1], node % dims[2]
                    c = lo + ti.Vector([i, j, k]) - clamp_lo
                    stands = False
                    if 0 <= c[0] < clamp.shape[0] and 0 <= c[1] < clamp.shape[1] and 0 <= c[2] < clamp.shape[2]:
                        stands = clamp[c[0], c[1], c[2]] != 0
                    inverse = 0.0
                    if m > least_mass and not stands:
                        inverse = 1.0 / m
                    inverse_mass[s, node] = ti.cast(inverse, ti.f32)
                momentum_to_velocity(lo, dims, clamp_lo, clamp, grid, 0)
                for p in range(x.shape[1]):
                    x[s + 1, p], v[s + 1, p], C[s + 1, p], F[s + 1, p] = x[s, p], v[s, p], C[s, p], F[s, p]
                code, status[1], lo, dims = grid_to_particles(
                    plastic, s + 1, 0, mu, yield_stress, viscosity, law, role, x, v, C, F, offset, dx, dt, lo, dims, grid
                )
                if code == RUNNING:
                    s += 1
        status[0], status[2] = code, s


@ti.kernel
def linearise(
    volume: scalars, mu: scalars, lam: scalars, viscosity: scalars, law: integers, offset: vec3, dx: ti.f64, dt: ti.f64,
    x: vectors, C: matrices, F: matrices, boxes: table, corner: table, record: records,
):  # fmt: skip
    """Weights and stress derivatives of all substeps of a frame: corner (S, N), record (S N RECORD,)."""
    for s, p in ti.ndrange(boxes.shape[0], x.shape[1]):
        lo, dims = ti.Vector([boxes[s, a] for a in range(3)]), ti.Vector([boxes[s, 3 + a] for a in range(3)])
        base = base_of(x[s, p], offset, 1.0 / dx)
        c = base - lo
        corner[s, p] = (c[0] * dims[1] + c[1]) * dims[2] + c[2]
        f = (x[s, p] - offset) / dx - base
        w = spline(f)
        at = (s * x.shape[1] + p) * RECORD
        F_p = F[s, p]
        for i, a in ti.static(ti.ndrange(3, 3)):
            record[at + 3 * i + a] = ti.cast(w[i, a], ti.f32)
            record[at + 93 + 3 * i + a] = ti.cast(dt * F_p[i, a], ti.f32)
        for a in ti.static(range(3)):
            record[at + 9 + a] = ti.cast(f[a], ti.f32)
        scale = -4.0 * dt / dx * volume[p]
        tau, known = kirchhoff(False, law[p], F_p, mu[p], lam[p])
        inverse, damped = F_p.inverse().transpose(), is_damped(law[p], viscosity[p])
        if damped:
            tau += viscous(C[s, p], mu[p], lam[p], viscosity[p])
        turn = scale * product(tau, inverse)
        for a in range(3):
            for b in range(a, 3):
                bar = ti.Matrix.zero(ti.f64, 3, 3)
                bar[a, b] = scale
                F_bar, _mu_bar, _lam_bar = kirchhoff_adjoint(law[p], F_p, mu[p], lam[p], known, bar)
                if damped:
                    C_bar = viscosity[p] * doubled_rate(bar, lam[p] / mu[p])
                    F_bar -= product(product(C[s, p].transpose(), C_bar), inverse)
                for i, d in ti.static(ti.ndrange(3, 3)):
                    first, second = F_bar[i, d], F_bar[i, d]
                    if i == b:
                        first -= turn[a, d]
                    if i == a:
                        second -= turn[b, d]
                    record[at + 12 + 9 * (3 * a + b) + 3 * i + d] = ti.cast(first, ti.f32)
                    record[at + 12 + 9 * (3 * b + a) + 3 * i + d] = ti.cast(second, ti.f32)


def _carry(width: int):
    lanes = ti.types.ndarray(element_shape=(width,), ndim=1)

    @ti.kernel
    def carry(
        first: ti.i32, mass: singles, damping: singles, role: integers, dx: ti.f32, dt: ti.f32, boxes: table, corner: table,
        record: records, inverse_mass: inverse_masses, source: lanes, state: lanes, grid: lanes,
    ):  # fmt: skip
        """Brings state (groups N STATE,) of the groups from `first` on through a frame under source (groups N SOURCE,).

        damping (2 N,): for each particle -(4 dt V / dx) eta, and that times lam / mu; see `viscous`.
        """
        # The compiler runs loops of less than about a thousand turns on one thread: see `substep.run_substeps`.
        ti.loop_config(block_dim=STRIDE)
        for turn in range(grid.shape[0] // (3 * inverse_mass.shape[1]) * STRIDE):
            if turn % STRIDE == 0:
                g = turn // STRIDE
                own = g * 3 * inverse_mass.shape[1]
                count = mass.shape[0]
                for s in range(boxes.shape[0]):
                    to_nodes(s, first + g, count, own, mass, damping, role, dx, boxes, corner, record, source, state, grid)
                    for node in range(boxes[s, 3] * boxes[s, 4] * boxes[s, 5]):
                        inverse = inverse_mass[s, node]
                        for a in ti.static(range(3)):
                            grid[own + 3 * node + a] = inverse * grid[own + 3 * node + a]
                    from_nodes(s, first + g, count, own, role, dx, dt, boxes, corner, record, state, grid)

    return carry


@ti.func
def to_nodes(
    s, group, count, own, mass: ti.template(), damping: ti.template(), role: ti.template(), dx, boxes: ti.template(),
    corner: ti.template(), record: ti.template(), source: ti.template(), state: ti.template(), grid: ti.template(),
):  # fmt: skip
    """p2g of all particles' changes."""
    nil = 0.0 * state[0]
    stride_y = boxes[s, 5]
    stride_x = boxes[s, 4] * stride_y
    for node in range(3 * boxes[s, 3] * stride_x):
        grid[own + node] = nil
    for p in range(count):
        if role[p] != HELD:
            at, row, given = (s * count + p) * RECORD, (group * count + p) * STATE, (group * count + p) * SOURCE
            node = own + 3 * corner[s, p]
            for c in range(3):
                B = [source[given + 3 + 3 * k + c] + (mass[p] * dx) * state[row + 3 + 3 * c + k] for k in ti.static(range(3))]
                for k in ti.static(range(9)):
                    F = state[row + 12 + k]
                    for d in ti.static(range(3)):
                        B[d] = B[d] + record[at + 12 + 9 * (3 * c + d) + k] * F
                if damping[2 * p] != 0.0:
                    swell = damping[2 * p + 1] * (state[row + 3] + state[row + 7] + state[row + 11])
                    for d in ti.static(range(3)):
                        B[d] = B[d] + damping[2 * p] * (state[row + 3 + 3 * c + d] + state[row + 3 + 3 * d + c])
                        B[d] = B[d] + ti.cast(c == d, ti.f32) * swell
                value = source[given + c] + mass[p] * state[row + c]
                for d in ti.static(range(3)):
                    value = value - record[at + 9 + d] * B[d]
                for i in ti.static(range(3)):
                    line = value
                    for j in ti.static(range(3)):
                        w = record[at + 3 * i] * record[at + 3 * j + 1]
                        to = node + 3 * (i * stride_x + j * stride_y) + c
                        grid[to] = grid[to] + (w * record[at + 2]) * line
                        grid[to + 3] = grid[to + 3] + (w * record[at + 5]) * (line + B[2])
                        grid[to + 6] = grid[to + 6] + (w * record[at + 8]) * (line + B[2] + B[2])
                        line = line + B[1]
                    value = value + B[0]


@ti.func
def from_nodes(
    s, group, count, own, role: ti.template(), dx, dt, boxes: ti.template(), corner: ti.template(), record: ti.template(),
    state: ti.template(), grid: ti.template(),
):  # fmt: skip
    """g2p of all particles' changes."""
    stride_y = boxes[s, 5]
    stride_x = boxes[s, 4] * stride_y
    for p in range(count):
        if role[p] != HELD:
            at, row = (s * count + p) * RECORD, (group * count + p) * STATE
            node = own + 3 * corner[s, p]
            for c in range(3):
                nil = 0.0 * state[row]
                v, M = nil, [nil, nil, nil]
                for i in ti.static(range(3)):
                    plane, plane_y, plane_z = nil, nil, nil
                    for j in ti.static(range(3)):
                        to = node + 3 * (i * stride_x + j * stride_y) + c
                        middle, last = record[at + 5] * grid[to + 3], record[at + 8] * grid[to + 6]
                        line = record[at + 2] * grid[to] + middle + last
                        w = record[at + 3 * j + 1]
                        plane = plane + w * line
                        plane_z = plane_z + w * (middle + last + last)
                        if ti.static(j > 0):
                            plane_y = plane_y + (j * w) * line
                    w = record[at + 3 * i]
                    v = v + w * plane
                    M[1] = M[1] + w * plane_y
                    M[2] = M[2] + w * plane_z
                    if ti.static(i > 0):
                        M[0] = M[0] + (i * w) * plane
                D = [(4.0 / dx) * (M[d] - record[at + 9 + d] * v) for d in ti.static(range(3))]
                for d in ti.static(range(3)):
                    state[row + 3 + 3 * c + d] = D[d]
                for d in ti.static(range(3)):
                    turned = record[at + 93 + d] * D[0] + record[at + 96 + d] * D[1] + record[at + 99 + d] * D[2]
                    state[row + 12 + 3 * c + d] = state[row + 12 + 3 * c + d] + turned
                state[row + c] = v
                if role[p] == FREE:
                    state[row + 21 + c] = state[row + 21 + c] + dt * v


carry = {width: _carry(width) for width in WIDTHS}
"""By the number of lanes."""
