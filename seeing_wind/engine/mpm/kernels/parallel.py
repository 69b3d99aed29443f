"""The parts of a substep of one large body on all cores: p2g, the nodes' velocities, g2p.

Particles are sorted by cell and dealt out to `tasks` in runs of equal length, so that a task's particles fill a slab of the grid. Every
task adds to a grid of its own, as large as its slab, with plain adds; only the slabs' overlaps are summed.
The window of nodes in use is found from `boxes`, which each g2p leaves behind.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..lattice.boundary import FREE
from ..lattice.conditions import boundary_velocity, in_box
from ..laws.constitutive import kirchhoff
from ..laws.plasticity import VON_MISES, plastic_flow
from ..laws.viscous import is_damped, viscous
from .crew import share
from .packed import (
    LAM,
    LAW,
    MASS,
    MOST_NODES,
    MOST_NODES_ACROSS,
    MOST_PARTICLES,
    MU,
    ROLE,
    VISCOSITY,
    VOLUME,
    YIELD_STRESS,
    bounded,
    combined,
    corner_of,
    fourths,
    gather,
    lattice_of,
    matrix,
    node_count,
    rows_of,
    scatter,
    triple,
    window_of,
    with_fourth,
)
from .substep import INVERTED, NOT_FINITE, RUNNING, TOO_FAST
from .transfer import base_of

box_rows = ti.types.ndarray(dtype=ti.i32, ndim=2)
flags = ti.types.ndarray(dtype=ti.i32, ndim=3)
rows = ti.types.ndarray(ndim=2)
lattice_rows = ti.types.ndarray(ndim=4)

CLAMP_LO, SOLID_LO, PUSH_LO, CAPACITY, ROOM, DONE, STOPPED, WINDOW = 2, 3, 4, 15, 16, 17, 18, 19
"""Rows of three in the array `window`, after lo and dims; places of the nodes that there is room for in the window, and in the tasks' own
grids together, of the substeps done, and of whether one of them was the last that could be; length. See `Body`."""
ORIGIN, BOX = 6, 7
"""In a task's row of `boxes`, after the first and the last of its particles' first nodes: what to add to the number of a node in the
window for that in the task's own grid; length."""


@ti.func
def brought(tau, row, push, own, f, particle: ti.template(), state: ti.template(), force: ti.template(), dx, dt):
    """What a particle at f from its first node brings to its nodes under the stress tau, S + i X + j Y + k Z: momentum and mass.

    It is m (v + dt a) + A (x_i - x_p) with A of the MLS-MPM transfer (Hu et al. 2018, and as `transfer.scatter`); B = dx A.
    """
    k = (4.0 * dt / dx) * particle[own + VOLUME]
    scale = particle[own + MASS] * dx
    # Beside a column of C stands v_j: the fourth number of `moving` is dx times the momentum.
    moving = [scale * (state[row + 3 + j] + dt * force[push + j]) for j in ti.static(range(3))]
    columns = [moving[j] - k * ti.Vector([tau[0, j], tau[1, j], tau[2, j], 0.0]) for j in ti.static(range(3))]
    X, Y, Z = [with_fourth(columns[j], 0.0) for j in ti.static(range(3))]
    S = (1.0 / dx) * fourths(columns[0], columns[1], columns[2], scale) - combined(X, Y, Z, f)
    return S, X, Y, Z


@ti.func
def particle_to_grid(
    plastic: ti.template(), p, first_node, particle: ti.template(), state: ti.template(),
    force: ti.template(), offset, dx, dt, lo, dims, grid: ti.template(),
):  # fmt: skip
    """p2g of particle p: adds its momentum and mass to the 27 nodes round it."""
    row, push, own = rows_of(p)
    F0, F1, F2 = state[row], state[row + 1], state[row + 2]
    at, f = corner_of(fourths(F0, F1, F2, 0.0), offset, 1.0 / dx, lo, dims, first_node)
    law = ti.cast(particle[own + LAW], ti.i32)
    mu, lam, viscosity = particle[own + MU], particle[own + LAM], particle[own + VISCOSITY]
    tau, _known = kirchhoff(plastic, law, matrix(F0, F1, F2), mu, lam)
    if is_damped(law, viscosity):
        tau += viscous(matrix(state[row + 3], state[row + 4], state[row + 5]), mu, lam, viscosity)
    S, X, Y, Z = brought(tau, row, push, own, f, particle, state, force, dx, dt)
    scatter(f, S, X, Y, Z, at, dims, grid)


@ti.func
def grid_to_particle(
    plastic: ti.template(), p, particle: ti.template(), state: ti.template(), state_out: ti.template(), pin_velocity: ti.template(),
    offset, dx, dt, lo, dims, velocity: ti.template(),
):  # fmt: skip
    """g2p of one particle: returns its status and its new place (4,)."""
    row, _push, own = rows_of(p)
    F0, F1, F2 = state[row], state[row + 1], state[row + 2]
    x = fourths(F0, F1, F2, 0.0)
    free, prescribed = 1.0, 0.0 * F0
    if ti.cast(particle[own + ROLE], ti.i32) != FREE:
        pin = ti.min(p, pin_velocity.shape[0] - 1)  # one row for all where they stand still
        free, prescribed = 0.0, ti.Vector([pin_velocity[pin, 0], pin_velocity[pin, 1], pin_velocity[pin, 2], 0.0])
    at, f = corner_of(x, offset, 1.0 / dx, lo, dims, 0)
    v, Mx, My, Mz = gather(f, at, dims, velocity)
    k = 4.0 / dx
    Cx, Cy, Cz = k * (Mx - f[0] * v), k * (My - f[1] * v), k * (Mz - f[2] * v)
    x = x + dt * (free * v + prescribed)
    F0, F1, F2 = F0 + dt * combined(Cx, Cy, Cz, F0), F1 + dt * combined(Cx, Cy, Cz, F1), F2 + dt * combined(Cx, Cy, Cz, F2)
    F = matrix(F0, F1, F2)
    status, speed_sqr, J = RUNNING, v[0] * v[0] + v[1] * v[1] + v[2] * v[2], F.determinant()
    # Also when one is NaN. What is not finite in C is not in F.
    if not (speed_sqr < 1e30 and ti.abs(J) < 1e30):
        status = NOT_FINITE
    elif dt * dt * speed_sqr > dx * dx:
        status = TOO_FAST
    elif not (J > 0.0):
        status = INVERTED
    elif ti.static(plastic):
        law = ti.cast(particle[own + LAW], ti.i32)
        if law >= VON_MISES:
            F = plastic_flow(law, F, particle[own + MU], particle[own + YIELD_STRESS], particle[own + VISCOSITY], dt)
            for i in ti.static(range(3)):
                F0[i], F1[i], F2[i] = F[i, 0], F[i, 1], F[i, 2]
    state_out[row], state_out[row + 1], state_out[row + 2] = with_fourth(F0, x[0]), with_fourth(F1, x[1]), with_fourth(F2, x[2])
    state_out[row + 3], state_out[row + 4], state_out[row + 5] = with_fourth(Cx, v[0]), with_fourth(Cy, v[1]), with_fourth(Cz, v[2])
    return status, x


@ti.func
def summed(node, tasks, i, boxes: ti.template(), grid: ti.template()):
    """The tasks' parts of a node in plane i of the lattice."""
    g = ti.Vector.zero(float, 4)
    for task in range(tasks):
        if boxes[task, 0] <= i and i <= boxes[task, 3] + 2:
            g = g + grid[bounded(boxes[task, ORIGIN] + node, MOST_NODES)]
    return g


@ti.func
def place(node, lo, dims):
    """Lattice index (3,) of a node."""
    i = node // (dims[1] * dims[2])
    j = node // dims[2] - i * dims[1]
    return lo + ti.Vector([i, j, node - (i * dims[1] + j) * dims[2]])


@ti.func
def pushed(at, v, dt, push_lo, push: ti.template()):
    """v after the acceleration prescribed at the lattice's node `at`."""
    c = at - push_lo
    pushed_v = v
    if in_box(c, push):
        pushed_v = v + dt * ti.Vector([push[c[0], c[1], c[2], a] for a in ti.static(range(3))])
    return pushed_v


@ti.func
def node_velocity(
    node, g, window: ti.template(), offset, dx, dt, clamp: ti.template(), clamp_velocity: ti.template(), planes: ti.template(),
    solid: ti.template(), push: ti.template(),
):  # fmt: skip
    """Momentum over mass, the push of the grid's own force, and what the boundary makes of it, with the mass."""
    v = ti.Vector.zero(float, 3)
    if g[3] > 0.0:
        lo, dims = window_of(window)
        at = place(node, lo, dims)
        v = pushed(at, ti.Vector([g[0], g[1], g[2]]) / g[3], dt, triple(window, PUSH_LO), push)
        v = boundary_velocity(at, v, offset, dx, triple(window, CLAMP_LO), clamp, clamp_velocity, planes, triple(window, SOLID_LO), solid)
    return ti.Vector([v[0], v[1], v[2], g[3]])


@ti.func
def node_to_velocity(
    node, tasks, window: ti.template(), boxes: ti.template(), grid: ti.template(), momentum: ti.template(), velocity: ti.template(),
    offset, dx, dt, clamp: ti.template(), clamp_velocity: ti.template(), planes: ti.template(), solid: ti.template(),
    push: ti.template(),
):  # fmt: skip
    """Sums the tasks' parts of a node."""
    lo, dims = window_of(window)
    g = summed(node, tasks, lo[0] + node // (dims[1] * dims[2]), boxes, grid)
    momentum[node] = g
    velocity[node] = node_velocity(node, g, window, offset, dx, dt, clamp, clamp_velocity, planes, solid, push)


@ti.func
def cleared(task, window: ti.template(), boxes: ti.template(), grid: ti.template()):
    """Clears a task's own grid; returns the number that the window's first node has, or would have, in it."""
    lo, dims = window_of(window)
    first_node, plane = boxes[task, ORIGIN], dims[1] * dims[2]
    for node in range((boxes[task, 0] - lo[0]) * plane, (boxes[task, 3] + 3 - lo[0]) * plane):
        grid[bounded(first_node + node, MOST_NODES)] = ti.Vector.zero(float, 4)
    return first_node


@ti.func
def task_to_grid(
    task, plastic: ti.template(), first: ti.template(), particle: ti.template(), state: ti.template(), force: ti.template(),
    lattice: ti.template(), window: ti.template(), boxes: ti.template(), grid: ti.template(),
):  # fmt: skip
    """p2g of a task's particles into its own grid."""
    offset, dx, dt = lattice_of(lattice)
    lo, dims = window_of(window)
    first_node = cleared(task, window, boxes, grid)
    for index in range(first[task], first[task + 1]):
        p = bounded(index, MOST_PARTICLES)
        particle_to_grid(plastic, p, first_node, particle, state, force, offset, dx, dt, lo, dims, grid)


@ti.func
def grid_to_task(
    task, plastic: ti.template(), first: ti.template(), particle: ti.template(), state: ti.template(), state_out: ti.template(),
    pin_velocity: ti.template(), lattice: ti.template(), window: ti.template(), boxes: ti.template(), status: ti.template(),
    velocity: ti.template(),
):  # fmt: skip
    """g2p of a task's particles; its row of `boxes` becomes the next substep's."""
    offset, dx, dt = lattice_of(lattice)
    lo, dims = window_of(window)
    low, high = ti.Vector([1e30, 1e30, 1e30]), ti.Vector([-1e30, -1e30, -1e30])
    for index in range(first[task], first[task + 1]):
        p = bounded(index, MOST_PARTICLES)
        code, x = grid_to_particle(plastic, p, particle, state, state_out, pin_velocity, offset, dx, dt, lo, dims, velocity)
        if code != RUNNING:
            status[task, 0], status[task, 1] = code, p
        for a in ti.static(range(3)):
            low[a] = ti.select(x[a] < low[a], x[a], low[a])  # one instruction, min is three
            high[a] = ti.select(x[a] > high[a], x[a], high[a])
    # Rounding keeps order: these are the first and the last of the particles' own.
    low_base, high_base = base_of(low, offset, 1.0 / dx), base_of(high, offset, 1.0 / dx)
    for a in ti.static(range(3)):
        boxes[task, a], boxes[task, 3 + a] = low_base[a], high_base[a]


@ti.func
def nodes_of_task(
    task, tasks, window: ti.template(), boxes: ti.template(), grid: ti.template(), momentum: ti.template(), velocity: ti.template(),
    lattice: ti.template(), clamp: ti.template(), clamp_velocity: ti.template(), planes: ti.template(), solid: ti.template(),
    push: ti.template(),
):  # fmt: skip
    """Velocities of a task's share of all nodes."""
    offset, dx, dt = lattice_of(lattice)
    begin, end = share(task, tasks, node_count(window))
    for index in range(begin, end):
        node_to_velocity(
            bounded(index, MOST_NODES), tasks, window, boxes, grid, momentum, velocity, offset, dx, dt,
            clamp, clamp_velocity, planes, solid, push,
        )  # fmt: skip


@ti.func
def look(tasks, window: ti.template(), boxes: ti.template(), status: ti.template()):
    """Moves the window to the box of nodes that all particles touch; stops where a particle broke or the grids are too small for it."""
    lo, last = ti.Vector([2**30, 2**30, 2**30]), ti.Vector([-(2**30), -(2**30), -(2**30)])
    planes, whole = ti.cast(0, ti.i64), True
    for task in range(tasks):
        whole = whole and status[task, 0] == RUNNING
        planes += boxes[task, 3] - boxes[task, 0] + 3
        for a in ti.static(range(3)):
            lo[a] = ti.min(lo[a], boxes[task, a])
            last[a] = ti.max(last[a], boxes[task, 3 + a])
    dims = last - lo + 3
    # Nothing overflows: no particle that is whole has moved further than a cell from a window that fitted.
    plane = ti.cast(dims[1], ti.i64) * dims[2]
    small = dims[0] * plane <= window[CAPACITY] and planes * plane <= window[ROOM]
    if whole and small and dims[1] <= MOST_NODES_ACROSS and dims[2] <= MOST_NODES_ACROSS:
        for a in ti.static(range(3)):
            window[a], window[3 + a] = lo[a], dims[a]
        planes_before = 0
        for task in range(tasks):
            boxes[task, ORIGIN] = (planes_before - (boxes[task, 0] - lo[0])) * dims[1] * dims[2]
            planes_before += boxes[task, 3] - boxes[task, 0] + 3
    else:
        window[STOPPED] = 1
    window[DONE] += 1
