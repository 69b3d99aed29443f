"""The parts of a substep of one large body on all cores: p2g, the nodes' velocities, g2p.

Particles are sorted by cell and divided into `tasks` runs of equal length, so that a task's particles fill a slab of the grid. Every task
adds to its own grid, as large as its slab, without atomics; the grids are summed where the slabs overlap. The bounds of the nodes in use
follow from `boxes`, which each g2p updates.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from .crew import share
from .packed import (
    MOST_NODES,
    MOST_NODES_ACROSS,
    MOST_PARTICLES,
    base_of,
    bounded,
    bounds_of,
    lattice_of,
    node_count,
    rows_of,
    spread,
)
from .substep import RUNNING, grid_to_particle, node_velocity, particle_to_grid

CAPACITY, ROOM, DONE, STOPPED, BOUNDS = 12, 13, 14, 15, 16
"""Places in the array `bounds`, after its rows of three: how many nodes there is room for within the bounds, and in the tasks' own grids
together; the substeps done; whether the run had to stop after one of them; the array's length. See `Body`."""
ORIGIN, BOX = 6, 7
"""Columns of `boxes`, after the first and the last of the particles' first nodes: what to add to the number of a node in the bounds to get
its number in the task's own grid; the number of columns."""


@ti.func
def summed(node, tasks, i, boxes: ti.template(), grid: ti.template()):
    """The sum of the tasks' contributions to a node in plane i of the lattice."""
    g = ti.Vector.zero(float, 4)
    for task in range(tasks):
        if boxes[task, 0] <= i and i <= boxes[task, 3] + 2:
            g = g + grid[bounded(boxes[task, ORIGIN] + node, MOST_NODES)]
    return g


@ti.func
def node_to_velocity(
    node, tasks, bounds: ti.template(), boxes: ti.template(), grid: ti.template(), momentum: ti.template(), velocity: ti.template(),
    offset, dx, clamp: ti.template(), clamp_velocity: ti.template(), planes: ti.template(), solid: ti.template(),
):  # fmt: skip
    """Sum the tasks' contributions to a node, and find its velocity."""
    lo, dims = bounds_of(bounds)
    g = summed(node, tasks, lo[0] + node // (dims[1] * dims[2]), boxes, grid)
    momentum[node] = g
    velocity[node] = node_velocity(node, g, lo, dims, bounds, offset, dx, clamp, clamp_velocity, planes, solid)


@ti.func
def clear(task, bounds: ti.template(), boxes: ti.template(), grid: ti.template()):
    """Clear a task's own grid; returns the number in it that the first node of the bounds has, or would have."""
    lo, dims = bounds_of(bounds)
    first_node, plane = boxes[task, ORIGIN], dims[1] * dims[2]
    for node in range((boxes[task, 0] - lo[0]) * plane, (boxes[task, 3] + 3 - lo[0]) * plane):
        grid[bounded(first_node + node, MOST_NODES)] = ti.Vector.zero(float, 4)
    return first_node


@ti.func
def task_to_grid(
    task, plastic: ti.template(), first: ti.template(), particle: ti.template(), state: ti.template(), force: ti.template(),
    lattice: ti.template(), bounds: ti.template(), boxes: ti.template(), grid: ti.template(),
):  # fmt: skip
    """p2g of a task's particles into its own grid."""
    offset, dx, dt = lattice_of(lattice)
    lo, dims = bounds_of(bounds)
    first_node = clear(task, bounds, boxes, grid)
    for index in range(first[task], first[task + 1]):
        p = bounded(index, MOST_PARTICLES)
        row, push, own = rows_of(p)
        particle_to_grid(plastic, row, push, own, first_node, particle, state, force, offset, dx, dt, lo, dims, grid)


@ti.func
def grid_to_task(
    task, plastic: ti.template(), first: ti.template(), particle: ti.template(), state: ti.template(), state_out: ti.template(),
    pin_velocity: ti.template(), lattice: ti.template(), bounds: ti.template(), boxes: ti.template(), status: ti.template(),
    velocity: ti.template(),
):  # fmt: skip
    """g2p of a task's particles; updates the task's row of `boxes` for the next substep."""
    offset, dx, dt = lattice_of(lattice)
    lo, dims = bounds_of(bounds)
    low, high = ti.Vector([1e30, 1e30, 1e30]), ti.Vector([-1e30, -1e30, -1e30])
    for index in range(first[task], first[task + 1]):
        p = bounded(index, MOST_PARTICLES)
        row, _push, own = rows_of(p)
        code, x = grid_to_particle(
            plastic, p, row, own, row, 0, particle, state, state_out, pin_velocity, offset, dx, dt, lo, dims, velocity
        )
        if code != RUNNING:
            status[task, 0], status[task, 1] = code, p
        spread(low, high, x)
    # Rounding preserves order, so these are the first and the last of the particles' first nodes.
    low_base, high_base = base_of(low, offset, 1.0 / dx), base_of(high, offset, 1.0 / dx)
    for a in ti.static(range(3)):
        boxes[task, a], boxes[task, 3 + a] = low_base[a], high_base[a]


@ti.func
def nodes_of_task(
    task, tasks, bounds: ti.template(), boxes: ti.template(), grid: ti.template(), momentum: ti.template(), velocity: ti.template(),
    lattice: ti.template(), clamp: ti.template(), clamp_velocity: ti.template(), planes: ti.template(), solid: ti.template(),
):  # fmt: skip
    """Velocities of the nodes in a task's share of all nodes."""
    offset, dx, _dt = lattice_of(lattice)
    begin, end = share(task, tasks, node_count(bounds))
    for index in range(begin, end):
        node_to_velocity(
            bounded(index, MOST_NODES), tasks, bounds, boxes, grid, momentum, velocity, offset, dx,
            clamp, clamp_velocity, planes, solid,
        )  # fmt: skip


@ti.func
def move_bounds(tasks, bounds: ti.template(), boxes: ti.template(), status: ti.template()):
    """Move the bounds to the box of nodes that the particles touch; stop if a particle failed or the grids are too small for the box."""
    lo, last = ti.Vector([2**30, 2**30, 2**30]), ti.Vector([-(2**30), -(2**30), -(2**30)])
    planes, whole = ti.cast(0, ti.i64), True
    for task in range(tasks):
        whole = whole and status[task, 0] == RUNNING
        planes += boxes[task, 3] - boxes[task, 0] + 3
        for a in ti.static(range(3)):
            lo[a] = ti.min(lo[a], boxes[task, a])
            last[a] = ti.max(last[a], boxes[task, 3 + a])
    dims = last - lo + 3
    # Nothing overflows: no particle that has not failed has moved more than a cell out of bounds that fitted.
    plane = ti.cast(dims[1], ti.i64) * dims[2]
    small = dims[0] * plane <= bounds[CAPACITY] and planes * plane <= bounds[ROOM]
    if whole and small and dims[1] <= MOST_NODES_ACROSS and dims[2] <= MOST_NODES_ACROSS:
        for a in ti.static(range(3)):
            bounds[a], bounds[3 + a] = lo[a], dims[a]
        planes_before = 0
        for task in range(tasks):
            boxes[task, ORIGIN] = (planes_before - (boxes[task, 0] - lo[0])) * dims[1] * dims[2]
            planes_before += boxes[task, 3] - boxes[task, 0] + 3
    else:
        bounds[STOPPED] = 1
    bounds[DONE] += 1
