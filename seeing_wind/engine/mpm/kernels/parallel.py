"""The parts of a substep of one large body on all cores: p2g, the nodes' velocities, g2p.

Particles are sorted by cell and dealt out to `tasks` in runs of equal length, so that a task's particles fill a slab of the grid. Every
task adds to a grid of its own, as large as its slab, with plain adds; only the slabs' overlaps are summed.
The bounds of the nodes in use are found from `boxes`, which each g2p leaves behind.
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
"""Places in the array `bounds`, after its rows of three, of the nodes that there is room for within the bounds, and in the tasks' own grids
together, of the substeps done, and of whether one of them was the last that could be; length. See `Body`."""
ORIGIN, BOX = 6, 7
"""In a task's row of `boxes`, after the first and the last of its particles' first nodes: what to add to the number of a node in the
bounds for that in the task's own grid; length."""


@ti.func
def summed(node, tasks, i, boxes: ti.template(), grid: ti.template()):
    """The tasks' parts of a node in plane i of the lattice."""
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
    """Sums the tasks' parts of a node."""
    lo, dims = bounds_of(bounds)
    g = summed(node, tasks, lo[0] + node // (dims[1] * dims[2]), boxes, grid)
    momentum[node] = g
    velocity[node] = node_velocity(node, g, lo, dims, bounds, offset, dx, clamp, clamp_velocity, planes, solid)


@ti.func
def clear(task, bounds: ti.template(), boxes: ti.template(), grid: ti.template()):
    """Clears a task's own grid; returns the number that the first node of the bounds has, or would have, in it."""
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
    """g2p of a task's particles; its row of `boxes` becomes the next substep's."""
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
    # Rounding keeps order: these are the first and the last of the particles' own.
    low_base, high_base = base_of(low, offset, 1.0 / dx), base_of(high, offset, 1.0 / dx)
    for a in ti.static(range(3)):
        boxes[task, a], boxes[task, 3 + a] = low_base[a], high_base[a]


@ti.func
def nodes_of_task(
    task, tasks, bounds: ti.template(), boxes: ti.template(), grid: ti.template(), momentum: ti.template(), velocity: ti.template(),
    lattice: ti.template(), clamp: ti.template(), clamp_velocity: ti.template(), planes: ti.template(), solid: ti.template(),
):  # fmt: skip
    """Velocities of a task's share of all nodes."""
    offset, dx, _dt = lattice_of(lattice)
    begin, end = share(task, tasks, node_count(bounds))
    for index in range(begin, end):
        node_to_velocity(
            bounded(index, MOST_NODES), tasks, bounds, boxes, grid, momentum, velocity, offset, dx,
            clamp, clamp_velocity, planes, solid,
        )  # fmt: skip


@ti.func
def move_bounds(tasks, bounds: ti.template(), boxes: ti.template(), status: ti.template()):
    """Moves the bounds to the box of nodes that all particles touch; stops where a particle broke or the grids are too small for it."""
    lo, last = ti.Vector([2**30, 2**30, 2**30]), ti.Vector([-(2**30), -(2**30), -(2**30)])
    planes, whole = ti.cast(0, ti.i64), True
    for task in range(tasks):
        whole = whole and status[task, 0] == RUNNING
        planes += boxes[task, 3] - boxes[task, 0] + 3
        for a in ti.static(range(3)):
            lo[a] = ti.min(lo[a], boxes[task, a])
            last[a] = ti.max(last[a], boxes[task, 3 + a])
    dims = last - lo + 3
    # Nothing overflows: no particle that is whole has moved further than a cell from bounds that fitted.
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
