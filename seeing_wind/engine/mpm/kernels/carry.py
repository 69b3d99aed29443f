"""How small changes of the force move one body: many changes, carried through a frame's linearised substeps at once.

This is the exact derivative of the substep, used for a body with a plastic law (`linearise` explains the names):

    p2g    d(m_i v_i) = sum w (dq + dB (x_i - x_p) - B dx) + (dx . grad w) (q + B (x_i - x_p)),  dm_i = sum (dx . grad w) m
           dq = m (dv + dt da),  dB = m (dC + dt dG) - (4 dt V / dx²) dtau
    nodes  dv_i = (d(m_i v_i) - v_i dm_i) / m_i, zero where a node is clamped
    g2p    dv = sum w dv_i + turn dx,  dC = 4/dx² sum w dv_i (x_i - x_p)^T + swirl dx
           dF <- (1 + dt C) dF + dt dC F, then, where it flows, (d flow / d F) dF;  dx += dt dv

The changes of an elastic body take half the time, in coordinates that move with them: the nodes move with the changed particles, so that
the weights stay the same, and with L = dF F^-1 and D = dC + C L, the velocity gradient of the change in the unchanged body,

    p2g    dq as above,  dB = m (D + dt dG) - (4 dt V / dx²) (dtau - tau L^T)
    g2p    dv = sum w dv_i,  D = 4/dx² sum w dv_i (x_i - x_p)^T,  dF += dt D F,  dx += dt dv

The error of moving the nodes is of the order of the discretisation's own: 0.2 % for a plate of 14 cells, 10 % for a block of 2 by 2 by 3
cells. In a body that flows it would be half of the change, because the strain of its nodes is never undone.

Changes that are carried together share all their coefficients; each is one lane of a vector.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..lattice.boundary import FREE
from .linearise import FLOAT, FLOW, GROWTH, PLACE, PULL, SLOPES, STRESS, SWIRL, TURN, WEIGHTS, masses, singles, width_of
from .packed import integers, table
from .substep import STRIDE

WIDTHS = (8, 16)
"""Numbers of changes that may be carried together: one or two vector registers in single precision, or one of the wide registers."""
STATE = 24
"""Numbers per particle of a change's state: dv 0..2, dC or D 3..11, dF 12..20, dx 21..23, matrices row by row."""
SOURCE = 12
"""Numbers per particle of a change's source: dt m da 0..2, dt m dx dG 3..11 (here dx is the cell size), dG column by column."""


def _carry(width: int):
    lanes = ti.types.ndarray(element_shape=(width,), ndim=1)

    @ti.kernel
    def carry(
        plastic: ti.template(), first: ti.i32, mass: singles, damping: singles, role: integers, dx: ti.f32, dt: ti.f32,
        boxes: table, corner: table, record: singles, flows: table, flow: singles, inverse_mass: masses, velocity: singles,
        source: lanes, state: lanes, grid: lanes,
    ):  # fmt: skip
        """Carry state (groups M STATE,) through a frame under source (groups M SOURCE,), for the groups from `first` on.

        damping (2 M,): for each particle -(4 dt V / dx) eta, and the same times lam / mu; see `viscous`. grid (groups 4 nodes,): scratch.
        """
        ti.loop_config(block_dim=STRIDE)
        for turn in range(grid.shape[0] // (4 * inverse_mass.shape[1]) * STRIDE):
            if turn % STRIDE == 0:
                g, count, most = turn // STRIDE, mass.shape[0], inverse_mass.shape[1]
                own = g * 4 * most
                for s in range(boxes.shape[0]):
                    to_nodes(plastic, s, first + g, count, own, mass, damping, dx, boxes, corner, record, source, state, grid)
                    for node in range(boxes[s, 3] * boxes[s, 4] * boxes[s, 5]):
                        inverse, at, to = inverse_mass[s, node], 3 * (s * most + node), own + 4 * node
                        for a in ti.static(range(3)):
                            if ti.static(plastic):
                                grid[to + a] = grid[to + a] - velocity[at + a] * grid[to + 3]
                            grid[to + a] = inverse * grid[to + a]
                    from_nodes(plastic, s, first + g, count, own, role, dx, dt, boxes, corner, record, flows, flow, state, grid)

    return carry


@ti.func
def to_nodes(
    plastic: ti.template(), s, group, count, own, mass: ti.template(), damping: ti.template(), dx, boxes: ti.template(),
    corner: ti.template(), record: ti.template(), source: ti.template(), state: ti.template(), grid: ti.template(),
):  # fmt: skip
    """p2g of the changes of all particles; a node has the change of its momentum, then that of its mass."""
    nil = 0.0 * state[0]
    stride_y = boxes[s, 5]
    stride_x = boxes[s, 4] * stride_y
    for node in range(4 * boxes[s, 3] * stride_x):
        grid[own + node] = nil
    for p in range(count):
        at, row, given = (s * count + p) * ti.static(width_of(plastic)), (group * count + p) * STATE, (group * count + p) * SOURCE
        node = own + 4 * corner[s, p]
        for c in range(3):
            B = [source[given + 3 + 3 * k + c] + (mass[p] * dx) * state[row + 3 + 3 * c + k] for k in ti.static(range(3))]
            # Not unrolled, here and below: it would be no faster, and take four times as long to compile.
            for k in range(9):
                F = state[row + 12 + k]
                for d in ti.static(range(3)):
                    B[d] = B[d] + record[at + STRESS + 9 * (3 * c + d) + k] * F
            if damping[2 * p] != 0.0:
                swell = damping[2 * p + 1] * (state[row + 3] + state[row + 7] + state[row + 11])
                for d in ti.static(range(3)):
                    B[d] = B[d] + damping[2 * p] * (state[row + 3 + 3 * c + d] + state[row + 3 + 3 * d + c])
                    B[d] = B[d] + ti.cast(c == d, ti.f32) * swell
            value = source[given + c] + mass[p] * state[row + c]
            for d in ti.static(range(3)):
                value = value - record[at + PLACE + d] * B[d]
            for i in range(3):
                line = value
                for j in ti.static(range(3)):
                    w = record[at + WEIGHTS + 3 * i] * record[at + WEIGHTS + 3 * j + 1]
                    to = node + 4 * (i * stride_x + j * stride_y) + c
                    grid[to] = grid[to] + (w * record[at + WEIGHTS + 2]) * line
                    grid[to + 4] = grid[to + 4] + (w * record[at + WEIGHTS + 5]) * (line + B[2])
                    grid[to + 8] = grid[to + 8] + (w * record[at + WEIGHTS + 8]) * (line + B[2] + B[2])
                    line = line + B[1]
                value = value + B[0]
        if ti.static(plastic):
            shifted_to_nodes(at, row, node, mass[p], dx, stride_x, stride_y, record, state, grid)


@ti.func
def shifted_to_nodes(at, row, node, mass, dx, stride_x, stride_y, record: ti.template(), state: ti.template(), grid: ti.template()):
    """The contribution of a particle's displacement alone to fixed nodes, through its changed weights and distances."""
    dx_0, dx_1, dx_2 = state[row + 21], state[row + 22], state[row + 23]
    away = [
        (1.0 / dx) * (record[at + FLOAT + 3 + c] * dx_0 + record[at + FLOAT + 6 + c] * dx_1 + record[at + FLOAT + 9 + c] * dx_2)
        for c in ti.static(range(3))
    ]
    for i in range(3):
        for j in range(3):
            w_x, w_y = record[at + WEIGHTS + 3 * i], record[at + WEIGHTS + 3 * j + 1]
            aside = (record[at + SLOPES + 3 * i] * w_y) * dx_0 + (w_x * record[at + SLOPES + 3 * j + 1]) * dx_1
            for k in ti.static(range(3)):
                w_z, to = record[at + WEIGHTS + 3 * k + 2], node + 4 * (i * stride_x + j * stride_y + k)
                shift = w_z * aside + (w_x * w_y * record[at + SLOPES + 3 * k + 2]) * dx_2
                for c in ti.static(range(3)):
                    brought = record[at + FLOAT + c] + i * record[at + FLOAT + 3 + c]
                    brought = brought + j * record[at + FLOAT + 6 + c] + k * record[at + FLOAT + 9 + c]
                    grid[to + c] = grid[to + c] + brought * shift - (w_x * w_y * w_z) * away[c]
                grid[to + 3] = grid[to + 3] + mass * shift


@ti.func
def from_nodes(
    plastic: ti.template(), s, group, count, own, role: ti.template(), dx, dt, boxes: ti.template(), corner: ti.template(),
    record: ti.template(), flows: ti.template(), flow: ti.template(), state: ti.template(), grid: ti.template(),
):  # fmt: skip
    """g2p of the changes of all particles."""
    stride_y = boxes[s, 5]
    stride_x = boxes[s, 4] * stride_y
    for p in range(count):
        at, row = (s * count + p) * ti.static(width_of(plastic)), (group * count + p) * STATE
        node = own + 4 * corner[s, p]
        before = [state[row + 12 + k] for k in ti.static(range(9))]
        shift = [state[row + 21 + k] for k in ti.static(range(3))]
        for c in range(3):
            nil = 0.0 * state[row]
            v, M = nil, [nil, nil, nil]
            for i in range(3):
                plane, plane_y, plane_z = nil, nil, nil
                for j in ti.static(range(3)):
                    to = node + 4 * (i * stride_x + j * stride_y) + c
                    middle, last = record[at + WEIGHTS + 5] * grid[to + 4], record[at + WEIGHTS + 8] * grid[to + 8]
                    line = record[at + WEIGHTS + 2] * grid[to] + middle + last
                    w = record[at + WEIGHTS + 3 * j + 1]
                    plane = plane + w * line
                    plane_z = plane_z + w * (middle + last + last)
                    if ti.static(j > 0):
                        plane_y = plane_y + (j * w) * line
                w = record[at + WEIGHTS + 3 * i]
                v = v + w * plane
                M[1] = M[1] + w * plane_y
                M[2] = M[2] + w * plane_z
                M[0] = M[0] + (i * w) * plane
            D = [(4.0 / dx) * (M[d] - record[at + PLACE + d] * v) for d in ti.static(range(3))]
            grown = [state[row + 12 + 3 * c + d] for d in ti.static(range(3))]
            if ti.static(plastic):
                growth = at + GROWTH + 3 * c
                for d in ti.static(range(3)):
                    grown[d] = record[growth] * before[d] + record[growth + 1] * before[3 + d] + record[growth + 2] * before[6 + d]
                    v = v + record[at + TURN + 3 * c + d] * shift[d]
                    for e in ti.static(range(3)):
                        D[d] = D[d] + record[at + SWIRL + 9 * c + 3 * d + e] * shift[e]
            for d in ti.static(range(3)):
                state[row + 3 + 3 * c + d] = D[d]
                pulled = record[at + PULL + d] * D[0] + record[at + PULL + 3 + d] * D[1] + record[at + PULL + 6 + d] * D[2]
                state[row + 12 + 3 * c + d] = grown[d] + pulled
            state[row + c] = v
            if role[p] == FREE:
                state[row + 21 + c] = state[row + 21 + c] + dt * v
        if ti.static(plastic):
            if flows[s, p] != 0:
                flow_on(row + 12, (s * count + p) * FLOW, flow, state)


@ti.func
def flow_on(row, at, flow: ti.template(), state: ti.template()):
    """Carry the changes' dF, in nine rows of `state` from `row` on, through plastic flow, whose derivative is in `flow` from `at` on."""
    before = [state[row + k] for k in ti.static(range(9))]
    for i in range(9):
        total = flow[at + 9 * i] * before[0]
        for k in ti.static(range(1, 9)):
            total = total + flow[at + 9 * i + k] * before[k]
        state[row + i] = total


carry = {width: _carry(width) for width in WIDTHS}
"""The kernel for each number of lanes."""
