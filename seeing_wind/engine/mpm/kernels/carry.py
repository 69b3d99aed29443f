"""How small changes of the force move one body: many changes carried through a frame's linearised substeps at once.

A change is carried in coordinates that move with it: the nodes go along with the changed particles, so that weights stay and

    p2g   q = m (dv + dt da),  B = dx m (D + dt dG) - (4 dt V / dx) (dtau - tau L^T),  L = dF F^-1,  dC = D - C L
    g2p   dv = sum w dv_i,  D = 4/dx² sum w dv_i (x_i - x_p)^T,  dF += dt D F,  dx += dt dv

Where a plastic law lets F forget, dF F^-1 is no longer L, the gradient of the change of place. It is carried by itself, G:

    p2g   dtau - tau G^T;   g2p   dF += dt D F + dt C (dF - G F), then dF <- (d flow / d F) dF;   G += dt (D - G C)

with D the change's velocity gradient in the unchanged body. It is the substep of `substep` with stress and flow exchanged for their
derivatives (`linearise`). What the moving nodes neglect is of the order of the discretisation's own error: for a plate of
14 cells 0.2 %, for a block of 2 by 2 by 3 cells 10 %.

Changes that are carried together share weights and stress derivative; they are the lanes of a vector.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..lattice.boundary import FREE
from .linearise import FLOW, RATE, RECORD, STRESS, masses, singles
from .packed import integers, table
from .substep import STRIDE

WIDTHS = (8, 16)
"""Changes that may be carried together: one or two vector registers of single precision, or one of the wide ones."""
STATE, PLASTIC_STATE = 24, 33
"""Numbers of a change per particle: dv 0..2, D 3..11, dF 12..20, dx 21..23; with plastic laws G 24..32; matrices row by row."""
SOURCE = 12
"""dt m da 0..2, dt m dx dG 3..11, dG column by column."""


def _carry(width: int):
    lanes = ti.types.ndarray(element_shape=(width,), ndim=1)

    @ti.kernel
    def carry(
        plastic: ti.template(), first: ti.i32, mass: singles, damping: singles, role: integers, dx: ti.f32, dt: ti.f32,
        boxes: table, corner: table, record: singles, flows: table, flow: singles, inverse_mass: masses,
        source: lanes, state: lanes, grid: lanes,
    ):  # fmt: skip
        """Brings state (groups M STATE,), or PLASTIC_STATE, of the groups from `first` on through a frame under source (groups M SOURCE,).

        damping (2 M,): for each particle -(4 dt V / dx) eta, and that times lam / mu; see `viscous`. grid (groups 3 nodes,).
        """
        ti.loop_config(block_dim=STRIDE)
        for turn in range(grid.shape[0] // (3 * inverse_mass.shape[1]) * STRIDE):
            if turn % STRIDE == 0:
                g = turn // STRIDE
                own = g * 3 * inverse_mass.shape[1]
                count = mass.shape[0]
                for s in range(boxes.shape[0]):
                    to_nodes(
                        plastic, s, first + g, count, own, mass, damping, dx, boxes, corner, record, flow, source, state, grid
                    )  # fmt: skip
                    for node in range(boxes[s, 3] * boxes[s, 4] * boxes[s, 5]):
                        inverse = inverse_mass[s, node]
                        for a in ti.static(range(3)):
                            grid[own + 3 * node + a] = inverse * grid[own + 3 * node + a]
                    from_nodes(plastic, s, first + g, count, own, role, dx, dt, boxes, corner, record, flows, flow, state, grid)

    return carry


@ti.func
def to_nodes(
    plastic: ti.template(), s, group, count, own, mass: ti.template(), damping: ti.template(), dx, boxes: ti.template(),
    corner: ti.template(), record: ti.template(), flow: ti.template(), source: ti.template(), state: ti.template(), grid: ti.template(),
):  # fmt: skip
    """p2g of all particles' changes."""
    nil = 0.0 * state[0]
    stride_y = boxes[s, 5]
    stride_x = boxes[s, 4] * stride_y
    for node in range(3 * boxes[s, 3] * stride_x):
        grid[own + node] = nil
    for p in range(count):
        at, given = (s * count + p) * RECORD, (group * count + p) * SOURCE
        row = (group * count + p) * ti.static(PLASTIC_STATE if plastic else STATE)
        node = own + 3 * corner[s, p]
        for c in range(3):
            B = [source[given + 3 + 3 * k + c] + (mass[p] * dx) * state[row + 3 + 3 * c + k] for k in ti.static(range(3))]
            for k in ti.static(range(9)):
                F = state[row + 12 + k]
                for d in ti.static(range(3)):
                    B[d] = B[d] + record[at + 12 + 9 * (3 * c + d) + k] * F
            if ti.static(plastic):
                stress = (s * count + p) * FLOW + STRESS + 3 * c
                for d, k in ti.static(ti.ndrange(3, 3)):
                    B[d] = B[d] - flow[stress + k] * state[row + 24 + 3 * d + k]
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
    plastic: ti.template(), s, group, count, own, role: ti.template(), dx, dt, boxes: ti.template(), corner: ti.template(),
    record: ti.template(), flows: ti.template(), flow: ti.template(), state: ti.template(), grid: ti.template(),
):  # fmt: skip
    """g2p of all particles' changes."""
    stride_y = boxes[s, 5]
    stride_x = boxes[s, 4] * stride_y
    for p in range(count):
        at, row = (s * count + p) * RECORD, (group * count + p) * ti.static(PLASTIC_STATE if plastic else STATE)
        node = own + 3 * corner[s, p]
        if ti.static(plastic):
            stray(row, at, (s * count + p) * FLOW + RATE, dt, record, flow, state)
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
        if ti.static(plastic):
            for k in ti.static(range(9)):
                state[row + 24 + k] = state[row + 24 + k] + dt * state[row + 3 + k]
            if flows[s, p] != 0:
                flow_on(row + 12, (s * count + p) * FLOW, flow, state)


@ti.func
def stray(row, at, rate, dt, record: ti.template(), flow: ti.template(), state: ti.template()):
    """Adds to a change what the body's own velocity gradient C makes of it: dt C (dF - G F) to dF, -dt G C to G."""
    G = [state[row + 24 + k] for k in ti.static(range(9))]
    E = [
        dt * state[row + 12 + 3 * i + j]
        - (G[3 * i] * record[at + 93 + j] + G[3 * i + 1] * record[at + 96 + j] + G[3 * i + 2] * record[at + 99 + j])
        for i in ti.static(range(3))
        for j in ti.static(range(3))
    ]
    for i, j in ti.static(ti.ndrange(3, 3)):
        for k in ti.static(range(3)):
            state[row + 12 + 3 * i + j] = state[row + 12 + 3 * i + j] + flow[rate + 3 * i + k] * E[3 * k + j]
            state[row + 24 + 3 * i + j] = state[row + 24 + 3 * i + j] - dt * flow[rate + 3 * k + j] * G[3 * i + k]


@ti.func
def flow_on(row, at, flow: ti.template(), state: ti.template()):
    """The changes' dF in nine rows of `state` from `row` on, through plastic flow of the derivative in `flow` from `at` on."""
    before = [state[row + k] for k in ti.static(range(9))]
    for i in range(9):
        total = flow[at + 9 * i] * before[0]
        for k in ti.static(range(1, 9)):
            total = total + flow[at + 9 * i + k] * before[k]
        state[row + i] = total


carry = {width: _carry(width) for width in WIDTHS}
"""By the number of lanes."""
