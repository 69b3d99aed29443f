"""One substep of one large body backwards, on all cores: derivatives by its start, force and material from those by its end.

Each function is the adjoint of its namesake in `parallel`, called in reverse order. A name with `_bar` is the derivative of the loss
by the name.
"""
# Taichi reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import taichi as ti

from .boundary import FREE
from .conditions import boundary_velocity_adjoint
from .constitutive import kirchhoff_adjoint
from .eigen import product
from .packed import (
    MOST_NODES,
    MOST_PARTICLES,
    bounded,
    constants,
    corner_of,
    forces,
    gather,
    integers,
    lattice_of,
    linear,
    nodes,
    numbers,
    packed,
    packed_force,
    scatter,
    spline_pull,
    states,
    times,
    transposed_times,
    triple,
    unpacked,
    unpacked_force,
    window_of,
)
from .parallel import (
    CAPACITY,
    CLAMP_LO,
    PUSH_LO,
    SOLID_LO,
    affine,
    box_rows,
    flags,
    lattice_rows,
    node_velocity,
    place,
    pushed,
    rows,
    share,
    slab,
    summed,
)
from .plasticity import VON_MISES, plastic_flow_adjoint
from .substep import STRIDE


@ti.func
def grid_to_particle_adjoint(
    atomic: ti.template(), plastic: ti.template(), material, p, task, first_node, particle: ti.template(),
    state: ti.template(), state_next: ti.template(), bar: ti.template(), particle_bar: ti.template(), offset, dx, dt, lo, dims,
    velocity: ti.template(), grid_bar: ti.template(), scratch: ti.template(), each,
):  # fmt: skip
    """g2p backwards: adds to the nodes' v_bar; `bar` turns from the next state's into this one's, as far as it goes through g2p."""
    x, _v, _C, F = unpacked(state[p])
    _x, v_next, C_next, _F = unpacked(state_next[p])
    x_bar, v_bar, C_bar, F_bar = unpacked(bar[p])
    c = particle[p]
    if ti.static(plastic):
        law = ti.cast(c[6], ti.i32)
        if law >= VON_MISES:
            trial = F + dt * product(C_next, F)
            through, mu_bar, yield_bar, viscosity_bar = plastic_flow_adjoint(law, trial, c[2], c[4], c[5], dt, F_bar)
            F_bar = through
            if material != 0:
                particle_bar[p] = particle_bar[p] + ti.Vector([0.0, 0.0, mu_bar, 0.0, yield_bar, viscosity_bar, 0.0, 0.0])
    if ti.cast(c[7], ti.i32) == FREE:
        v_bar += dt * x_bar
    D_bar = (4.0 / dx) * (C_bar + dt * product(F_bar, F.transpose()))
    at, f = corner_of(x, offset, 1.0 / dx, lo, dims, 0)
    S, X, Y, Z = linear(D_bar, v_bar - times(D_bar, f), 0.0, scratch, task, each)
    scatter(atomic, f, S, X, Y, Z, bounded(first_node + at, MOST_NODES), dims, grid_bar)
    pull = spline_pull(f, S, X, Y, Z, at, dims, velocity, scratch, task, each)
    x_bar += (1.0 / dx) * (pull - transposed_times(D_bar, v_next))
    bar[p] = packed(x_bar, ti.Vector.zero(float, 3), ti.Matrix.zero(float, 3, 3), F_bar + dt * product(C_next.transpose(), F_bar))


@ti.func
def node_to_velocity_adjoint(
    node, tasks, window: ti.template(), boxes: ti.template(), grid_bar: ti.template(), momentum: ti.template(),
    momentum_bar: ti.template(), offset, dx, dt, clamp: ti.template(), clamp_velocity: ti.template(), planes: ti.template(),
    solid: ti.template(), push: ti.template(),
):  # fmt: skip
    """v = boundary(q / m + dt a): turns the nodes' v_bar into q_bar and m_bar."""
    lo, dims = window_of(window)
    s = summed(node, tasks, lo[0] + node // (dims[1] * dims[2]), boxes, window[CAPACITY], grid_bar)
    g = momentum[node]
    q_bar, m_bar = ti.Vector.zero(float, 3), g[3] * 0.0
    if g[3] > 0.0:
        at = place(node, lo, dims)
        v = ti.Vector([g[0], g[1], g[2]]) / g[3]
        v_bar = boundary_velocity_adjoint(
            at, pushed(at, v, dt, triple(window, PUSH_LO), push), ti.Vector([s[0], s[1], s[2]]), offset, dx,
            triple(window, CLAMP_LO), clamp, clamp_velocity, planes, triple(window, SOLID_LO), solid,
        )  # fmt: skip
        q_bar = v_bar / g[3]
        m_bar = -q_bar.dot(v)
    momentum_bar[node] = ti.Vector([q_bar[0], q_bar[1], q_bar[2], m_bar])


@ti.func
def particle_to_grid_adjoint(
    plastic: ti.template(), material, p, task, particle: ti.template(), state: ti.template(), force: ti.template(),
    bar: ti.template(), force_bar: ti.template(), particle_bar: ti.template(), offset, dx, dt, lo, dims, momentum_bar: ti.template(),
    scratch: ti.template(), each,
):  # fmt: skip
    """p2g backwards: completes `bar`, adds to the derivatives by force and constants."""
    x, v, C, F = unpacked(state[p])
    a, G = unpacked_force(force[p])
    c = particle[p]
    momentum, B = affine(plastic, c, v, C, F, a, G, dt, dx)
    at, f = corner_of(x, offset, 1.0 / dx, lo, dims, 0)
    S, X, Y, Z = linear(B, momentum - times(B, f), c[0], scratch, task, each)
    q_bar, moment, mass_bar = gather(f, at, dims, momentum_bar, scratch, task, each)
    A_bar = dx * (moment - q_bar.outer_product(f))
    pull = spline_pull(f, S, X, Y, Z, at, dims, momentum_bar, scratch, task, each)
    x_bar, _v_bar, _C_bar, F_bar = unpacked(bar[p])
    x_bar += (1.0 / dx) * (pull - transposed_times(B, q_bar))
    tau_bar = ((-4.0 * dt / (dx * dx)) * c[1]) * A_bar
    through, mu_bar, lam_bar = kirchhoff_adjoint(plastic, ti.cast(c[6], ti.i32), F, c[2], c[3], tau_bar)
    bar[p] = packed(x_bar, c[0] * q_bar, c[0] * A_bar, F_bar + through)
    force_bar[p] = force_bar[p] + packed_force((dt * c[0]) * q_bar, (dt * c[0]) * A_bar)
    if material != 0:
        mass_bar += q_bar.dot(v + dt * a) + (A_bar * (C + dt * G)).sum()
        particle_bar[p] = particle_bar[p] + ti.Vector([mass_bar, 0.0, mu_bar, lam_bar, 0.0, 0.0, 0.0, 0.0])


@ti.kernel
def substep_adjoint(
    gpu: ti.template(), plastic: ti.template(),
    material: ti.i32,  # whether derivatives by the particles' constants are wanted
    # body at the substep's start and end; momentum as `substep` leaves it
    first: integers, particle: constants, state: states, state_next: states, force: forces,
    # derivatives, in: by the next state, out: by this one; those by force and constants are added up
    bar: states, force_bar: forces, particle_bar: constants,
    clamp: flags, clamp_velocity: lattice_rows, planes: rows, solid: lattice_rows, push: lattice_rows,
    lattice: numbers, window: integers, boxes: box_rows,
    grid_bar: nodes, momentum: nodes, velocity: nodes, momentum_bar: nodes, scratch: nodes, each: ti.i32,
):  # fmt: skip
    """g2p and p2g backwards."""
    if ti.static(gpu):
        for node in range(window[3] * window[4] * window[5]):
            offset, dx, dt = lattice_of(lattice)
            grid_bar[node] = ti.Vector.zero(float, 4)
            velocity[node] = node_velocity(node, momentum[node], window, offset, dx, dt, clamp, clamp_velocity, planes, solid, push)
        for p in range(state.shape[0]):
            offset, dx, dt = lattice_of(lattice)
            lo, dims = window_of(window)
            grid_to_particle_adjoint(
                True, plastic, material, p, p, 0, particle, state, state_next, bar, particle_bar, offset, dx, dt, lo, dims,
                velocity, grid_bar, scratch, each,
            )  # fmt: skip
        for node in range(window[3] * window[4] * window[5]):
            offset, dx, dt = lattice_of(lattice)
            node_to_velocity_adjoint(
                node, 1, window, boxes, grid_bar, momentum, momentum_bar, offset, dx, dt, clamp, clamp_velocity, planes, solid, push
            )
        for p in range(state.shape[0]):
            offset, dx, dt = lattice_of(lattice)
            lo, dims = window_of(window)
            particle_to_grid_adjoint(
                plastic, material, p, p, particle, state, force, bar, force_bar, particle_bar, offset, dx, dt, lo, dims,
                momentum_bar, scratch, each,
            )  # fmt: skip
    else:
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                offset, dx, dt = lattice_of(lattice)
                begin, end = share(turn // STRIDE, first.shape[0] - 1, window[3] * window[4] * window[5])
                for index in range(begin, end):
                    node = bounded(index, MOST_NODES)
                    velocity[node] = node_velocity(
                        node, momentum[node], window, offset, dx, dt, clamp, clamp_velocity, planes, solid, push
                    )
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                task = turn // STRIDE
                offset, dx, dt = lattice_of(lattice)
                lo, dims = window_of(window)
                begin, end = slab(task, lo, dims, boxes)
                first_node = task * window[CAPACITY]
                for node in range(begin, end):
                    grid_bar[bounded(first_node + node, MOST_NODES)] = ti.Vector.zero(float, 4)
                for index in range(first[task], first[task + 1]):
                    p = bounded(index, MOST_PARTICLES)
                    grid_to_particle_adjoint(
                        False, plastic, material, p, task, first_node, particle, state, state_next, bar, particle_bar, offset, dx, dt,
                        lo, dims, velocity, grid_bar, scratch, each,
                    )  # fmt: skip
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                offset, dx, dt = lattice_of(lattice)
                tasks = first.shape[0] - 1
                begin, end = share(turn // STRIDE, tasks, window[3] * window[4] * window[5])
                for index in range(begin, end):
                    node = bounded(index, MOST_NODES)
                    node_to_velocity_adjoint(
                        node, tasks, window, boxes, grid_bar, momentum, momentum_bar, offset, dx, dt,
                        clamp, clamp_velocity, planes, solid, push,
                    )  # fmt: skip
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                task = turn // STRIDE
                offset, dx, dt = lattice_of(lattice)
                lo, dims = window_of(window)
                for index in range(first[task], first[task + 1]):
                    p = bounded(index, MOST_PARTICLES)
                    particle_to_grid_adjoint(
                        plastic, material, p, task, particle, state, force, bar, force_bar, particle_bar, offset, dx, dt, lo, dims,
                        momentum_bar, scratch, each,
                    )  # fmt: skip
