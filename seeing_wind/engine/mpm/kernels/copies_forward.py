"""Substeps of many copies of one body, each copy on one core; or of one body with every substep kept.

Copies are independent: the outer loop over them is the compiler's parallel loop, and all of a copy's work stays on one thread with a
private grid. That needs no atomics and no barriers, and a grid of a few thousand nodes stays in the core's cache.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from .packed import (
    MOST_NODES,
    MOST_NODES_ACROSS,
    MOST_PARTICLES,
    base_of,
    bounded,
    constants,
    flags,
    forces,
    integers,
    lattice_of,
    lattice_rows,
    nodes,
    numbers,
    rows,
    rows_of,
    spread,
    states,
    table,
)
from .substep import GRID_FULL, RUNNING, STRIDE, grid_to_particle, node_velocity, particle_to_grid

CODE, CULPRIT, DONE, WANTED, STATUS = 0, 1, 2, 3, 4
"""Columns of `status`, which has a row for each copy: its code, the particle that failed, the substeps done, the nodes its grid needs; the
number of columns."""
_FAR = 2**31 - 1


@ti.func
def box_of(low, high, offset, dx):
    """First node (3,) and node counts (3,) of the box that particles between the corners low and high touch."""
    lo = base_of(low, offset, 1.0 / dx)
    return lo, base_of(high, offset, 1.0 / dx) - lo + 3


@ti.func
def box_at(first, count, state: ti.template(), offset, dx):
    """`box_of` the `count` particles whose states begin with number `first`."""
    low, high = ti.Vector([1e30, 1e30, 1e30]), ti.Vector([-1e30, -1e30, -1e30])
    for p in range(count):
        row = rows_of(first + p)[0]
        spread(low, high, ti.Vector([state[row][3], state[row + 1][3], state[row + 2][3]]))
    return box_of(low, high, offset, dx)


@ti.func
def wanted_nodes(dims):
    """Nodes of the box; `_FAR` where no grid may be that wide, because the box of an exploding body overflows 32 bits."""
    found = ti.cast(dims[0], ti.i64) * dims[1] * dims[2]
    if dims[1] > MOST_NODES_ACROSS or dims[2] > MOST_NODES_ACROSS or dims.min() < 3:
        found = _FAR
    return ti.cast(ti.min(found, _FAR), ti.i32)


@ti.func
def copy_to_grid(
    plastic: ti.template(), now, force_of, count, nodes_in_use, at, particle: ti.template(), state: ti.template(), force: ti.template(),
    offset, dx, dt, lo, dims, grid: ti.template(),
):  # fmt: skip
    """p2g of a copy of `count` particles, whose states begin with number `now` and its forces with number `force_of`, into the grid from
    node `at` on."""
    for node in range(nodes_in_use):
        grid[bounded(at + node, MOST_NODES)] = ti.Vector.zero(float, 4)
    for index in range(count):
        p = bounded(index, MOST_PARTICLES)
        row, push, own = rows_of(now + p)[0], rows_of(force_of + p)[1], rows_of(p)[2]
        particle_to_grid(plastic, row, push, own, at, particle, state, force, offset, dx, dt, lo, dims, grid)


@ti.func
def grid_to_copy(
    plastic: ti.template(), now, after, count, at, particle: ti.template(), state: ti.template(), pin_velocity: ti.template(),
    offset, dx, dt, lo, dims, velocity: ti.template(),
):  # fmt: skip
    """g2p of a copy, from the states that begin with number `now` to those that begin with number `after`.

    Returns status, the particle that failed or -1, and the next box: first node and node counts.
    """
    code, culprit = RUNNING, -1
    low, high = ti.Vector([1e30, 1e30, 1e30]), ti.Vector([-1e30, -1e30, -1e30])
    for index in range(count):
        p = bounded(index, MOST_PARTICLES)
        row, own = rows_of(now + p)[0], rows_of(p)[2]
        found, x = grid_to_particle(
            plastic, p, row, own, rows_of(after + p)[0], at, particle, state, state, pin_velocity, offset, dx, dt, lo, dims, velocity
        )
        if found != RUNNING:
            code, culprit = found, p
        spread(low, high, x)
    next_lo, next_dims = box_of(low, high, offset, dx)
    return code, culprit, next_lo, next_dims


@ti.kernel
def substeps_of_copies(
    plastic: ti.template(), until: ti.i32, capacity: ti.i32,  # nodes of each copy's grid
    # `particle` of one copy; states and forces of all copies, one after the other
    particle: constants, state: states, force: forces, pin_velocity: rows,
    # at the nodes, see `conditions.boundary_velocity`
    clamp: flags, clamp_velocity: lattice_rows, planes: rows, solid: lattice_rows,
    lattice: numbers, bounds: integers,  # `lattice_of`; rows CLAMP_LO and SOLID_LO of `substep`
    # (S, 6) out, first node and node counts, or (0, 6). With it there is one copy, the states of all substeps lie one after the other, as
    # do the grids of momentum and mass; without it all is in place, and the velocities are in the grid
    boxes: table, grid: nodes, velocity: nodes,
    status: table,  # (copies, STATUS) in and out
):  # fmt: skip
    """Advance every running copy r from substep status[r, DONE] to `until`, or to the substep at which it fails."""
    ti.loop_config(block_dim=STRIDE)
    for turn in range(status.shape[0] * STRIDE):
        if turn % STRIDE == 0:
            r, count, kept = turn // STRIDE, particle.shape[0] // 8, ti.min(boxes.shape[0], 1)
            offset, dx, dt = lattice_of(lattice)
            code = status[r, CODE]
            lo, dims = box_at(r * count + kept * status[r, DONE] * count, count, state, offset, dx)
            while status[r, DONE] < until and code == RUNNING:
                s = status[r, DONE]
                wanted = wanted_nodes(dims)
                if wanted > capacity:
                    code, status[r, WANTED] = GRID_FULL, wanted
                else:
                    now, at, to = (r + kept * s) * count, (r + kept * s) * capacity, r * capacity
                    if kept != 0:
                        for a in ti.static(range(3)):
                            boxes[s, a], boxes[s, 3 + a] = lo[a], dims[a]
                    copy_to_grid(plastic, now, r * count, count, wanted, at, particle, state, force, offset, dx, dt, lo, dims, grid)
                    for node in range(wanted):
                        velocity[bounded(to + node, MOST_NODES)] = node_velocity(
                            node, grid[bounded(at + node, MOST_NODES)], lo, dims, bounds, offset, dx,
                            clamp, clamp_velocity, planes, solid,
                        )  # fmt: skip
                    code, status[r, CULPRIT], lo, dims = grid_to_copy(
                        plastic, now, now + kept * count, count, to, particle, state, pin_velocity, offset, dx, dt, lo, dims, velocity
                    )
                    if code == RUNNING:
                        status[r, DONE] += 1
            status[r, CODE] = code
