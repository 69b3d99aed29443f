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
    constants,
    corner_of,
    forces,
    gather,
    linear,
    nodes,
    packed,
    packed_force,
    scatter,
    spline_pull,
    states,
    times,
    transposed_times,
    unpacked,
    unpacked_force,
)
from .parallel import affine, box_rows, flags, integers, ivec3, lattice_rows, node_velocity, place, rows, share, slab, summed, vec3
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
    at, f = corner_of(x, offset, 1.0 / dx, lo, dims)
    S, X, Y, Z = linear(D_bar, v_bar - times(D_bar, f), 0.0)
    scatter(atomic, f, S, X, Y, Z, first_node + at, dims, grid_bar)
    pull = spline_pull(f, S, X, Y, Z, at, dims, velocity, scratch, task, each)
    x_bar += (1.0 / dx) * (pull - transposed_times(D_bar, v_next))
    bar[p] = packed(x_bar, ti.Vector.zero(float, 3), ti.Matrix.zero(float, 3, 3), F_bar + dt * product(C_next.transpose(), F_bar))


@ti.func
def node_to_velocity_adjoint(
    node, tasks, boxes: ti.template(), capacity, grid_bar: ti.template(), momentum: ti.template(),
    momentum_bar: ti.template(), lo, dims, offset, dx, clamp_lo, clamp: ti.template(), clamp_velocity: ti.template(),
    planes: ti.template(), solid_lo, solid: ti.template(),
):  # fmt: skip
    """v = boundary(q / m): turns the nodes' v_bar into q_bar and m_bar."""
    s = summed(node, tasks, lo[0] + node // (dims[1] * dims[2]), boxes, capacity, grid_bar)
    g = momentum[node]
    q_bar, m_bar = ti.Vector.zero(float, 3), g[3] * 0.0
    if g[3] > 0.0:
        v = ti.Vector([g[0], g[1], g[2]]) / g[3]
        v_bar = ti.Vector([s[0], s[1], s[2]])
        v_bar = boundary_velocity_adjoint(
            place(node, lo, dims), v, v_bar, offset, dx, clamp_lo, clamp, clamp_velocity, planes, solid_lo, solid
        )
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
    at, f = corner_of(x, offset, 1.0 / dx, lo, dims)
    S, X, Y, Z = linear(B, momentum - times(B, f), c[0])
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
    # body at the substep's start and end; momentum as `to_grid` leaves it
    first: integers, particle: constants, state: states, state_next: states, force: forces,
    # derivatives, in: by the next state, out: by this one; those by force and constants are added up
    bar: states, force_bar: forces, particle_bar: constants,
    clamp_lo: ivec3, clamp: flags, clamp_velocity: lattice_rows, planes: rows, solid_lo: ivec3, solid: lattice_rows,
    offset_m: vec3, dx_m: ti.f64, dt_s: ti.f64, lo: ivec3, dims: ivec3, boxes: box_rows,
    capacity: ti.i32, grid_bar: nodes, momentum: nodes, velocity: nodes, momentum_bar: nodes, scratch: nodes, each: ti.i32,
):  # fmt: skip
    """g2p and p2g backwards."""
    if ti.static(gpu):
        offset, dx, dt = ti.cast(offset_m, float), ti.cast(dx_m, float), ti.cast(dt_s, float)
        for node in range(dims[0] * dims[1] * dims[2]):
            grid_bar[node] = ti.Vector.zero(float, 4)
            velocity[node] = node_velocity(
                node, momentum[node], lo, dims, offset, dx, clamp_lo, clamp, clamp_velocity,
                planes, solid_lo, solid,
            )  # fmt: skip
        for p in range(state.shape[0]):
            grid_to_particle_adjoint(
                True, plastic, material, p, p, 0, particle, state, state_next, bar, particle_bar, offset, dx,
                dt, lo, dims, velocity, grid_bar, scratch, each,
            )  # fmt: skip
        for node in range(dims[0] * dims[1] * dims[2]):
            node_to_velocity_adjoint(
                node, 1, boxes, capacity, grid_bar, momentum, momentum_bar, lo, dims, offset,
                dx, clamp_lo, clamp, clamp_velocity, planes, solid_lo, solid,
            )  # fmt: skip
        for p in range(state.shape[0]):
            particle_to_grid_adjoint(
                plastic, material, p, p, particle, state, force, bar, force_bar, particle_bar, offset, dx,
                dt, lo, dims, momentum_bar, scratch, each,
            )  # fmt: skip
    else:
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                offset, dx, dt = ti.cast(offset_m, float), ti.cast(dx_m, float), ti.cast(dt_s, float)
                begin, end = share(turn // STRIDE, first.shape[0] - 1, dims[0] * dims[1] * dims[2])
                for node in range(begin, end):
                    velocity[node] = node_velocity(
                        node, momentum[node], lo, dims, offset, dx, clamp_lo, clamp,
                        clamp_velocity, planes, solid_lo, solid,
                    )  # fmt: skip
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                offset, dx, dt = ti.cast(offset_m, float), ti.cast(dx_m, float), ti.cast(dt_s, float)
                task = turn // STRIDE
                begin, end = slab(task, lo, dims, boxes)
                for node in range(task * capacity + begin, task * capacity + end):
                    grid_bar[node] = ti.Vector.zero(float, 4)
                for p in range(first[task], first[task + 1]):
                    grid_to_particle_adjoint(
                        False, plastic, material, p, task, task * capacity, particle, state, state_next, bar, particle_bar, offset,
                        dx, dt, lo, dims, velocity, grid_bar, scratch, each,
                    )  # fmt: skip
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                offset, dx, dt = ti.cast(offset_m, float), ti.cast(dx_m, float), ti.cast(dt_s, float)
                tasks = first.shape[0] - 1
                begin, end = share(turn // STRIDE, tasks, dims[0] * dims[1] * dims[2])
                for node in range(begin, end):
                    node_to_velocity_adjoint(
                        node, tasks, boxes, capacity, grid_bar, momentum, momentum_bar, lo, dims, offset,
                        dx, clamp_lo, clamp, clamp_velocity, planes, solid_lo, solid,
                    )  # fmt: skip
        ti.loop_config(block_dim=STRIDE)
        for turn in range((first.shape[0] - 1) * STRIDE):
            if turn % STRIDE == 0:
                offset, dx, dt = ti.cast(offset_m, float), ti.cast(dx_m, float), ti.cast(dt_s, float)
                task = turn // STRIDE
                for p in range(first[task], first[task + 1]):
                    particle_to_grid_adjoint(
                        plastic, material, p, task, particle, state, force, bar, force_bar, particle_bar, offset,
                        dx, dt, lo, dims, momentum_bar, scratch, each,
                    )  # fmt: skip
