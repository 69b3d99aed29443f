"""One substep of one large body on all cores.

Particles are sorted by cell and dealt out to `tasks` in runs of equal length, so that a task's particles fill a slab of the grid. Every
task adds to a grid of its own, with plain adds; only the slabs' overlaps are summed. On a GPU there is one task, whose loops run over
particles and add atomically. The window `lo`, `dims` of nodes in use is found by the host from `boxes`, which each g2p leaves behind.
"""
# Taichi reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import taichi as ti

from .boundary import FREE
from .conditions import boundary_velocity
from .constitutive import kirchhoff
from .eigen import product
from .packed import (
    constants,
    corner_of,
    forces,
    gather,
    linear,
    nodes,
    packed,
    scatter,
    states,
    times,
    unpacked,
    unpacked_force,
)
from .plasticity import VON_MISES, plastic_flow
from .substep import INVERTED, NOT_FINITE, RUNNING, STRIDE, TOO_FAST
from .transfer import base_of

integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
box_rows = ti.types.ndarray(dtype=ti.i32, ndim=2)
flags = ti.types.ndarray(dtype=ti.i32, ndim=3)
rows = ti.types.ndarray(ndim=2)
lattice_rows = ti.types.ndarray(ndim=4)
ivec3 = ti.types.vector(3, ti.i32)
vec3 = ti.types.vector(3, ti.f64)


@ti.func
def affine(plastic: ti.template(), c, v, C, F, a, G, dt, dx):
    """What a particle brings to its nodes: momentum m (v + dt a), B = dx A with A of the MLS-MPM transfer."""
    tau = kirchhoff(plastic, ti.cast(c[6], ti.i32), F, c[2], c[3])
    return c[0] * (v + dt * a), (c[0] * dx) * (C + dt * G) - ((4.0 * dt / dx) * c[1]) * tau


@ti.func
def particle_to_grid(
    atomic: ti.template(), plastic: ti.template(), p, first_node, particle: ti.template(), state: ti.template(), force: ti.template(),
    offset, dx, dt, lo, dims, grid: ti.template(),
):  # fmt: skip
    """p2g of particle p: adds its momentum and mass to the 27 nodes round it (Hu et al. 2018, as `transfer.scatter`)."""
    x, v, C, F = unpacked(state[p])
    a, G = unpacked_force(force[p])
    c = particle[p]
    momentum, B = affine(plastic, c, v, C, F, a, G, dt, dx)
    at, f = corner_of(x, offset, 1.0 / dx, lo, dims)
    S, X, Y, Z = linear(B, momentum - times(B, f), c[0])
    scatter(atomic, f, S, X, Y, Z, first_node + at, dims, grid)


@ti.func
def grid_to_particle(
    plastic: ti.template(), p, task, particle: ti.template(), state: ti.template(), state_out: ti.template(), pin_velocity: ti.template(),
    offset, dx, dt, lo, dims, velocity: ti.template(), scratch: ti.template(), each,
):  # fmt: skip
    """g2p of one particle: returns its status and the first of its nodes."""
    x, _v, _C, F = unpacked(state[p])
    c = particle[p]
    at, f = corner_of(x, offset, 1.0 / dx, lo, dims)
    v, moment, _mass = gather(f, at, dims, velocity, scratch, task, each)
    C = (4.0 / dx) * (moment - v.outer_product(f))
    F += dt * product(C, F)
    if ti.cast(c[7], ti.i32) == FREE:
        x += dt * v
    else:
        x += dt * ti.Vector([pin_velocity[p, 0], pin_velocity[p, 1], pin_velocity[p, 2]])
    status = RUNNING
    if not (v.norm_sqr() + C.norm_sqr() < 1e30):  # also when it is NaN
        status = NOT_FINITE
    elif dt * dt * v.norm_sqr() > dx * dx:
        status = TOO_FAST
    elif not (F.determinant() > 0.0):
        status = INVERTED
    elif ti.static(plastic):
        law = ti.cast(c[6], ti.i32)
        if law >= VON_MISES:
            F = plastic_flow(law, F, c[2], c[4], c[5], dt)
    state_out[p] = packed(x, v, C, F)
    return status, base_of(x, offset, 1.0 / dx)


@ti.func
def summed(node, tasks, i, boxes: ti.template(), capacity, grid: ti.template()):
    """The tasks' parts of a node in plane i of the lattice."""
    g = ti.Vector.zero(float, 4)
    for task in range(tasks):
        if boxes[task, 0] <= i and i <= boxes[task, 3] + 2:
            g += grid[task * capacity + node]
    return g


@ti.func
def place(node, lo, dims):
    """Lattice index (3,) of a node."""
    i = node // (dims[1] * dims[2])
    j = node // dims[2] - i * dims[1]
    return lo + ti.Vector([i, j, node - (i * dims[1] + j) * dims[2]])


@ti.func
def node_velocity(
    node, g, lo, dims, offset, dx, clamp_lo, clamp: ti.template(), clamp_velocity: ti.template(),
    planes: ti.template(), solid_lo, solid: ti.template(),
):  # fmt: skip
    """Momentum over mass, and what the boundary makes of it, with the mass."""
    v = ti.Vector.zero(float, 3)
    if g[3] > 0.0:
        v = ti.Vector([g[0], g[1], g[2]]) / g[3]
        v = boundary_velocity(place(node, lo, dims), v, offset, dx, clamp_lo, clamp, clamp_velocity, planes, solid_lo, solid)
    return ti.Vector([v[0], v[1], v[2], g[3]])


@ti.func
def node_to_velocity(
    node, tasks, boxes: ti.template(), capacity, grid: ti.template(), momentum: ti.template(),
    velocity: ti.template(), lo, dims, offset, dx, clamp_lo, clamp: ti.template(), clamp_velocity: ti.template(), planes: ti.template(),
    solid_lo, solid: ti.template(),
):  # fmt: skip
    """Sums the tasks' parts of a node."""
    g = summed(node, tasks, lo[0] + node // (dims[1] * dims[2]), boxes, capacity, grid)
    momentum[node] = g
    velocity[node] = node_velocity(
        node, g, lo, dims, offset, dx, clamp_lo, clamp, clamp_velocity, planes, solid_lo, solid
    )


@ti.func
def slab(task, lo, dims, boxes: ti.template()):
    """First and last node (exclusive) of a task's slab."""
    plane = dims[1] * dims[2]
    return (boxes[task, 0] - lo[0]) * plane, (boxes[task, 3] + 3 - lo[0]) * plane


@ti.func
def share(task, tasks, count):
    """A task's part of `count` nodes."""
    each = (count + tasks - 1) // tasks
    return ti.min(task * each, count), ti.min((task + 1) * each, count)


@ti.kernel
def to_grid(
    gpu: ti.template(), plastic: ti.template(),
    # body: `first` particle of every task
    first: integers, particle: constants, state: states, force: forces,
    # boundary, see `conditions.boundary_velocity`
    clamp_lo: ivec3, clamp: flags, clamp_velocity: lattice_rows, planes: rows, solid_lo: ivec3, solid: lattice_rows,
    # lattice and time
    offset_m: vec3, dx_m: ti.f64, dt_s: ti.f64, lo: ivec3, dims: ivec3, boxes: box_rows,
    # grids: the tasks' own, one after the other, then momentum and velocity of all
    capacity: ti.i32, grid: nodes, momentum: nodes, velocity: nodes,
):  # fmt: skip
    """p2g and the nodes' velocities."""
    if ti.static(gpu):
        offset, dx, dt = ti.cast(offset_m, float), ti.cast(dx_m, float), ti.cast(dt_s, float)
        for node in range(dims[0] * dims[1] * dims[2]):
            grid[node] = ti.Vector.zero(float, 4)
        for p in range(state.shape[0]):
            particle_to_grid(
                True, plastic, p, 0, particle, state, force, offset, dx,
                dt, lo, dims, grid,
            )  # fmt: skip
        for node in range(dims[0] * dims[1] * dims[2]):
            node_to_velocity(
                node, 1, boxes, capacity, grid, momentum, velocity, lo, dims, offset, dx,
                clamp_lo, clamp, clamp_velocity, planes, solid_lo, solid,
            )  # fmt: skip
    else:
        # Taichi runs loops of less than about a thousand turns on one thread: a task is STRIDE turns, all but one of them empty.
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                task = turn // STRIDE
                offset, dx, dt = ti.cast(offset_m, float), ti.cast(dx_m, float), ti.cast(dt_s, float)
                begin, end = slab(task, lo, dims, boxes)
                for node in range(task * capacity + begin, task * capacity + end):
                    grid[node] = ti.Vector.zero(float, 4)
                for p in range(first[task], first[task + 1]):
                    particle_to_grid(False, plastic, p, task * capacity, particle, state, force, offset, dx, dt, lo, dims, grid)
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                offset, dx, dt = ti.cast(offset_m, float), ti.cast(dx_m, float), ti.cast(dt_s, float)
                tasks = first.shape[0] - 1
                begin, end = share(turn // STRIDE, tasks, dims[0] * dims[1] * dims[2])
                for node in range(begin, end):
                    node_to_velocity(
                        node, tasks, boxes, capacity, grid, momentum, velocity, lo, dims, offset,
                        dx, clamp_lo, clamp, clamp_velocity, planes, solid_lo, solid,
                    )  # fmt: skip


@ti.kernel
def to_particles(
    gpu: ti.template(), plastic: ti.template(),
    # body
    first: integers, particle: constants, state: states, state_out: states, pin_velocity: rows,
    # lattice and time; boxes (tasks, 6) out: first and last of the particles' first nodes; status (tasks, 2) out: code, particle
    offset_m: vec3, dx_m: ti.f64, dt_s: ti.f64, lo: ivec3, dims: ivec3, boxes: box_rows, status: box_rows,
    velocity: nodes, scratch: nodes, each: ti.i32,
):  # fmt: skip
    """g2p."""
    if ti.static(gpu):
        offset, dx, dt = ti.cast(offset_m, float), ti.cast(dx_m, float), ti.cast(dt_s, float)
        for _task in range(1):
            for a in ti.static(range(3)):
                boxes[0, a], boxes[0, 3 + a] = 2**30, -(2**30)
        for p in range(state.shape[0]):
            code, base = grid_to_particle(
                plastic, p, p, particle, state, state_out, pin_velocity, offset, dx,
                dt, lo, dims, velocity, scratch, each,
            )  # fmt: skip
            if code != RUNNING:
                status[0, 0], status[0, 1] = code, p
            for a in ti.static(range(3)):
                ti.atomic_min(boxes[0, a], base[a])
                ti.atomic_max(boxes[0, 3 + a], base[a])
    else:
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                task = turn // STRIDE
                offset, dx, dt = ti.cast(offset_m, float), ti.cast(dx_m, float), ti.cast(dt_s, float)
                low, high = ti.Vector([2**30, 2**30, 2**30]), ti.Vector([-(2**30), -(2**30), -(2**30)])
                for p in range(first[task], first[task + 1]):
                    code, base = grid_to_particle(
                        plastic, p, task, particle, state, state_out, pin_velocity, offset, dx, dt, lo, dims, velocity, scratch, each
                    )
                    if code != RUNNING:
                        status[task, 0], status[task, 1] = code, p
                    low = ti.min(low, base)
                    high = ti.max(high, base)
                for a in ti.static(range(3)):
                    boxes[task, a], boxes[task, 3 + a] = low[a], high[a]
