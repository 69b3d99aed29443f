"""The adjoint of one substep of one large body, on all cores: derivatives by its start, force and material from those by its end.

Each function is the adjoint of its namesake in `substep` or `parallel`, called in reverse order. A name with `_bar` is the
derivative of the loss by the name.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..lattice.boundary import FREE
from ..lattice.conditions import boundary_jacobian
from ..laws.constitutive import kirchhoff_both_ways
from ..laws.eigen import from_columns, times_columns
from ..laws.plasticity import VON_MISES, plastic_flow_adjoint
from ..laws.viscous import is_damped, viscous, viscous_adjoint
from .crew import await_all, counters, finish, share, take
from .packed import (
    LAM,
    LAW,
    MASS,
    MOST_NODES,
    MOST_PARTICLES,
    MU,
    ROLE,
    VISCOSITY,
    VOLUME,
    YIELD_STRESS,
    bounded,
    bounds_of,
    constants,
    corner_of,
    flags,
    forces,
    fourths,
    gather,
    integers,
    lattice_of,
    lattice_rows,
    node_count,
    nodes,
    numbers,
    rows,
    rows_of,
    scatter,
    spline_pull,
    states,
    table,
    triple,
    with_fourth,
)
from .parallel import clear, summed
from .substep import CLAMP_LO, SOLID_LO, STRIDE, node_terms, node_velocity, place

PHASES = 4
"""Phases of a substep: the nodes' velocities, adjoint of g2p, adjoint of the nodes' velocities, adjoint of p2g."""


@ti.func
def plastic_flow_back(
    material, own, particle: ti.template(), C0, C1, C2, F0, F1, F2, F0_bar, F1_bar, F2_bar, dt, particle_bar: ti.template()
):
    """Columns of F_bar before the plastic flow, from those after it.

    C0..C2: columns of C at the substep's end; F0..F2: columns of F at its start.
    """
    columns = [F0_bar, F1_bar, F2_bar]
    law = ti.cast(particle[own + LAW], ti.i32)
    if law >= VON_MISES:
        trial = from_columns(
            F0 + dt * times_columns(C0, C1, C2, F0),
            F1 + dt * times_columns(C0, C1, C2, F1),
            F2 + dt * times_columns(C0, C1, C2, F2),
        )
        through, mu_bar, yield_bar, viscosity_bar = plastic_flow_adjoint(
            law, trial, particle[own + MU], particle[own + YIELD_STRESS], particle[own + VISCOSITY], dt,
            from_columns(F0_bar, F1_bar, F2_bar),
        )  # fmt: skip
        for j in ti.static(range(3)):
            columns[j] = ti.Vector([through[0, j], through[1, j], through[2, j], columns[j][3]])
        if material != 0:
            particle_bar[own + MU] = particle_bar[own + MU] + mu_bar
            particle_bar[own + YIELD_STRESS] = particle_bar[own + YIELD_STRESS] + yield_bar
            particle_bar[own + VISCOSITY] = particle_bar[own + VISCOSITY] + viscosity_bar
    return columns[0], columns[1], columns[2]


@ti.func
def grid_to_particle_adjoint(
    plastic: ti.template(), material, p, first_node, particle: ti.template(), state: ti.template(),
    state_next: ti.template(), bar: ti.template(), particle_bar: ti.template(), offset, dx, dt, lo, dims,
    grid_bar: ti.template(),
):  # fmt: skip
    """Adjoint of g2p: adds to the nodes' v_bar; `bar` goes in as that of the next state and comes out as that of this one, as far as g2p
    alone contributes."""
    row, _push, own = rows_of(p)
    F0, F1, F2 = state[row], state[row + 1], state[row + 2]
    C0, C1, C2 = state_next[row + 3], state_next[row + 4], state_next[row + 5]
    F0_bar, F1_bar, F2_bar = bar[row], bar[row + 1], bar[row + 2]
    C0_bar, C1_bar, C2_bar = bar[row + 3], bar[row + 4], bar[row + 5]
    x_bar, v_bar = fourths(F0_bar, F1_bar, F2_bar, 0.0), fourths(C0_bar, C1_bar, C2_bar, 0.0)
    if ti.static(plastic):
        F0_bar, F1_bar, F2_bar = plastic_flow_back(
            material, own, particle, C0, C1, C2, F0, F1, F2, F0_bar, F1_bar, F2_bar, dt, particle_bar
        )
    if ti.cast(particle[own + ROLE], ti.i32) == FREE:
        v_bar = v_bar + dt * x_bar
    k = 4.0 / dx
    X = with_fourth(k * (C0_bar + dt * (F0[0] * F0_bar + F1[0] * F1_bar + F2[0] * F2_bar)), 0.0)
    Y = with_fourth(k * (C1_bar + dt * (F0[1] * F0_bar + F1[1] * F1_bar + F2[1] * F2_bar)), 0.0)
    Z = with_fourth(k * (C2_bar + dt * (F0[2] * F0_bar + F1[2] * F1_bar + F2[2] * F2_bar)), 0.0)
    at, f = corner_of(fourths(F0, F1, F2, 0.0), offset, 1.0 / dx, lo, dims, 0)
    S = v_bar - times_columns(X, Y, Z, f)
    scatter(f, S, X, Y, Z, bounded(first_node + at, MOST_NODES), dims, grid_bar)
    # The rows of C are the columns of C^T, for the product C^T F_bar.
    R0, R1, R2 = [ti.Vector([C0[i], C1[i], C2[i], 0.0]) for i in ti.static(range(3))]
    bar[row] = with_fourth(F0_bar + dt * times_columns(R0, R1, R2, F0_bar), x_bar[0])
    bar[row + 1] = with_fourth(F1_bar + dt * times_columns(R0, R1, R2, F1_bar), x_bar[1])
    bar[row + 2] = with_fourth(F2_bar + dt * times_columns(R0, R1, R2, F2_bar), x_bar[2])
    # For the derivative through the weights, which `particle_to_grid_adjoint` computes for both grids at once.
    bar[row + 3], bar[row + 4], bar[row + 5] = with_fourth(X, v_bar[0]), with_fourth(Y, v_bar[1]), with_fourth(Z, v_bar[2])


@ti.func
def sums(a, b, c):
    """The sums of the numbers of a, b and c, each (4,), and 0, as a vector (4,)."""
    return ti.Vector([a[0] + a[1] + a[2] + a[3], b[0] + b[1] + b[2] + b[3], c[0] + c[1] + c[2] + c[3], 0.0])


@ti.func
def node_to_velocity_adjoint(
    node, tasks, bounds: ti.template(), boxes: ti.template(), grid_bar: ti.template(), momentum: ti.template(),
    momentum_bar: ti.template(), offset, dx, clamp: ti.template(), planes: ti.template(), solid: ti.template(),
):  # fmt: skip
    """Adjoint of v = boundary(q / m): q_bar and m_bar of a node from its v_bar."""
    lo, dims = bounds_of(bounds)
    s = summed(node, tasks, lo[0] + node // (dims[1] * dims[2]), boxes, grid_bar)
    g = momentum[node]
    q_bar, m_bar = ti.Vector.zero(float, 3), g[3] * 0.0
    if g[3] > 0.0:
        v = ti.Vector([g[0], g[1], g[2]]) / g[3]
        J = boundary_jacobian(
            place(node, lo, dims), v, offset, dx,
            triple(bounds, CLAMP_LO), clamp, planes, triple(bounds, SOLID_LO), solid,
        )  # fmt: skip
        q_bar = J.transpose() @ ti.Vector([s[0], s[1], s[2]]) / g[3]
        m_bar = -q_bar.dot(v)
    momentum_bar[node] = ti.Vector([q_bar[0], q_bar[1], q_bar[2], m_bar])


@ti.func
def particle_to_grid_adjoint(
    plastic: ti.template(), material, p, particle: ti.template(), state: ti.template(), state_next: ti.template(),
    force: ti.template(), bar: ti.template(), force_bar: ti.template(), particle_bar: ti.template(), offset, dx, dt, lo, dims,
    velocity: ti.template(), momentum_bar: ti.template(),
):  # fmt: skip
    """Adjoint of p2g, and of g2p through the particle's position: completes `bar`, and adds to the derivatives by force and constants."""
    row, push, own = rows_of(p)
    F0, F1, F2 = state[row], state[row + 1], state[row + 2]
    F = from_columns(F0, F1, F2)
    at, f = corner_of(fourths(F0, F1, F2, 0.0), offset, 1.0 / dx, lo, dims, 0)
    law = ti.cast(particle[own + LAW], ti.i32)
    q_bar, Mx, My, Mz = gather(f, at, dims, momentum_bar)
    # Derivatives by the columns of m (C + dt G), each with the derivative by m (v_j + dt a_j) beside it.
    A0_bar = with_fourth(dx * (Mx - f[0] * q_bar), q_bar[0])
    A1_bar = with_fourth(dx * (My - f[1] * q_bar), q_bar[1])
    A2_bar = with_fourth(dx * (Mz - f[2] * q_bar), q_bar[2])
    tau_bar = ((-4.0 * dt / (dx * dx)) * particle[own + VOLUME]) * from_columns(A0_bar, A1_bar, A2_bar)
    mu, lam, viscosity = particle[own + MU], particle[own + LAM], particle[own + VISCOSITY]
    tau, F_bar, mu_bar, lam_bar = kirchhoff_both_ways(plastic, law, F, mu, lam, tau_bar)
    C_bar, viscosity_bar = ti.Matrix.zero(float, 3, 3), 0.0
    if is_damped(law, viscosity):
        C = from_columns(state[row + 3], state[row + 4], state[row + 5])
        tau += viscous(C, mu, lam, viscosity)
        C_bar, by_mu, by_lam, viscosity_bar = viscous_adjoint(C, mu, lam, viscosity, tau_bar)
        mu_bar, lam_bar = mu_bar + by_mu, lam_bar + by_lam
    S, X, Y, Z = node_terms(tau, row, push, own, f, particle, state, force, dx, dt)
    D0, D1, D2 = bar[row + 3], bar[row + 4], bar[row + 5]
    U, V, W = with_fourth(D0, 0.0), with_fourth(D1, 0.0), with_fourth(D2, 0.0)
    T = fourths(D0, D1, D2, 0.0) - times_columns(U, V, W, f)
    pull_x, pull_y, pull_z = spline_pull(f, S, X, Y, Z, at, dims, momentum_bar, T, U, V, W, velocity)
    v_next = fourths(state_next[row + 3], state_next[row + 4], state_next[row + 5], 0.0)
    pull = (1.0 / dx) * sums(pull_x - X * q_bar - U * v_next, pull_y - Y * q_bar - V * v_next, pull_z - Z * q_bar - W * v_next)
    mass, mass_bar = particle[own + MASS], q_bar[3]
    A_bar = [A0_bar, A1_bar, A2_bar]
    for j in ti.static(range(3)):
        bar[row + j] = bar[row + j] + ti.Vector([F_bar[0, j], F_bar[1, j], F_bar[2, j], pull[j]])
        moving_bar = mass * A_bar[j]
        bar[row + 3 + j] = moving_bar + ti.Vector([C_bar[0, j], C_bar[1, j], C_bar[2, j], 0.0])
        force_bar[push + j] = force_bar[push + j] + dt * moving_bar
    if material != 0:
        for j in ti.static(range(3)):
            along = A_bar[j] * (state[row + 3 + j] + dt * force[push + j])
            mass_bar += along[0] + along[1] + along[2] + along[3]
        particle_bar[own + MASS] = particle_bar[own + MASS] + mass_bar
        particle_bar[own + MU] = particle_bar[own + MU] + mu_bar
        particle_bar[own + LAM] = particle_bar[own + LAM] + lam_bar
        particle_bar[own + VISCOSITY] = particle_bar[own + VISCOSITY] + viscosity_bar


@ti.func
def grid_to_task_adjoint(
    task, plastic: ti.template(), material, first: ti.template(), particle: ti.template(), state: ti.template(),
    state_next: ti.template(), bar: ti.template(), particle_bar: ti.template(), lattice: ti.template(), bounds: ti.template(),
    boxes: ti.template(), grid_bar: ti.template(),
):  # fmt: skip
    """`grid_to_particle_adjoint` of a task's particles, into the task's own grid."""
    offset, dx, dt = lattice_of(lattice)
    lo, dims = bounds_of(bounds)
    first_node = clear(task, bounds, boxes, grid_bar)
    for index in range(first[task], first[task + 1]):
        p = bounded(index, MOST_PARTICLES)
        grid_to_particle_adjoint(
            plastic, material, p, first_node, particle, state, state_next, bar, particle_bar, offset, dx, dt, lo, dims, grid_bar
        )


@ti.func
def particles_to_task_adjoint(
    task, plastic: ti.template(), material, first: ti.template(), particle: ti.template(), state: ti.template(),
    state_next: ti.template(), force: ti.template(), bar: ti.template(), force_bar: ti.template(), particle_bar: ti.template(),
    lattice: ti.template(), bounds: ti.template(), velocity: ti.template(), momentum_bar: ti.template(),
):  # fmt: skip
    """`particle_to_grid_adjoint` of a task's particles."""
    offset, dx, dt = lattice_of(lattice)
    lo, dims = bounds_of(bounds)
    for index in range(first[task], first[task + 1]):
        particle_to_grid_adjoint(
            plastic, material, bounded(index, MOST_PARTICLES), particle, state, state_next, force, bar, force_bar, particle_bar,
            offset, dx, dt, lo, dims, velocity, momentum_bar,
        )  # fmt: skip


@ti.kernel
def substep_adjoint(
    plastic: ti.template(),
    material: ti.i32,  # whether derivatives by the particles' constants are wanted
    workers: ti.i32, roster: counters,  # see `crew`
    # body at the substep's start and end; `momentum` below as `parallel_forward.substeps` leaves it
    first: integers, particle: constants, state: states, state_next: states, force: forces,
    # derivatives: `bar` goes in by the next state and comes out by this one; those by force and constants are added to
    bar: states, force_bar: forces, particle_bar: constants,
    clamp: flags, clamp_velocity: lattice_rows, planes: rows, solid: lattice_rows,
    lattice: numbers, bounds: integers, boxes: table,
    grid_bar: nodes, momentum: nodes, velocity: nodes, momentum_bar: nodes,
):  # fmt: skip
    """The adjoint of a substep."""
    ti.loop_config(block_dim=STRIDE)
    for turn in range(workers * STRIDE):
        if turn % STRIDE == 0:
            offset, dx, _dt = lattice_of(lattice)
            lo, dims = bounds_of(bounds)
            worker, tasks = turn // STRIDE, first.shape[0] - 1
            task = take(roster, 0, worker, workers, tasks)
            while task < tasks:
                begin, end = share(task, tasks, node_count(bounds))
                for index in range(begin, end):
                    node = bounded(index, MOST_NODES)
                    velocity[node] = node_velocity(
                        node, momentum[node], lo, dims, bounds, offset, dx, clamp, clamp_velocity, planes, solid
                    )
                finish(roster, 0)
                task = take(roster, 0, worker, workers, tasks)
            # No `await_all` here: these velocities are not read before the last phase.
            task = take(roster, 1, worker, workers, tasks)
            while task < tasks:
                grid_to_task_adjoint(
                    task, plastic, material, first, particle, state, state_next, bar, particle_bar, lattice, bounds, boxes, grid_bar
                )
                finish(roster, 1)
                task = take(roster, 1, worker, workers, tasks)
            await_all(roster, 1, tasks)
            task = take(roster, 2, worker, workers, tasks)
            while task < tasks:
                begin, end = share(task, tasks, node_count(bounds))
                for index in range(begin, end):
                    node_to_velocity_adjoint(
                        bounded(index, MOST_NODES), tasks, bounds, boxes, grid_bar, momentum, momentum_bar, offset, dx,
                        clamp, planes, solid,
                    )  # fmt: skip
                finish(roster, 2)
                task = take(roster, 2, worker, workers, tasks)
            await_all(roster, 0, tasks)
            await_all(roster, 2, tasks)
            task = take(roster, 3, worker, workers, tasks)
            while task < tasks:
                particles_to_task_adjoint(
                    task, plastic, material, first, particle, state, state_next, force, bar, force_bar, particle_bar, lattice,
                    bounds, velocity, momentum_bar,
                )  # fmt: skip
                task = take(roster, 3, worker, workers, tasks)
