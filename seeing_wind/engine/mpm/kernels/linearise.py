"""A frame's substeps linearised: the coefficients with which `carry` multiplies small changes of one body's motion.

They are computed from the states, the boxes and the grids of every substep, as `copies_forward` keeps them.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..lattice.conditions import in_box
from ..laws.constitutive import kirchhoff, kirchhoff_adjoint
from ..laws.eigen import from_columns, left_cauchy_green, product, relative_deviator
from ..laws.plasticity import VON_MISES, certainly_elastic, flow_terms, hencky_adjoint, hencky_terms, through_flow
from ..laws.viscous import doubled_rate, is_damped, viscous
from .packed import (
    LAM,
    LAW,
    MU,
    VISCOSITY,
    VOLUME,
    YIELD_STRESS,
    bounded,
    constants,
    corner_of,
    flags,
    forces,
    fourths,
    integers,
    lattice_of,
    lattice_rows,
    nodes,
    numbers,
    rows,
    rows_of,
    spline,
    spline_slope,
    states,
    table,
    triple,
)
from .packed import MOST_NODES as MOST_INDEXED
from .substep import CLAMP_LO, node_terms, node_velocity, place

WEIGHTS, PLACE, STRESS, PULL, SLOPES, FLOAT, TURN, SWIRL, GROWTH = 0, 9, 12, 93, 102, 111, 123, 132, 159
"""Where the coefficients of a particle begin in its record:

    WEIGHTS  3 i + a: weight of the i-th node along axis a           PLACE   f, the distance to its first node [cells]
    STRESS   derivative by dF of -(4 dt V / dx) (dtau - tau L^T),    PULL    dt F
             row 3 a + b for entry ab

and in a body with a plastic law, where STRESS is without tau L^T,

    SLOPES   3 i + a: derivative of the weight [1/m]       TURN    derivative of v by x, 3 c + e
    GROWTH   I + dt C                                      SWIRL   derivative of C by x, 9 c + 3 d + e
    FLOAT    S X Y Z of `substep.node_terms`, three numbers each: the particle adds S + i X + j Y + k Z to node (i, j, k)
"""
RECORD, PLASTIC_RECORD = 102, 168
"""Numbers in the record of a particle in an elastic body, and in one with a plastic law."""
FLOW = 81
"""Numbers of the derivative of plastic flow: row 3 i + j has the derivative of F_ij after the flow by the nine entries of F before it."""



def width_of(plastic: bool) -> int:
    """`RECORD` or `PLASTIC_RECORD`; a compile-time constant of the kernel."""
    return PLASTIC_RECORD if plastic else RECORD


singles = ti.types.ndarray(dtype=ti.f32, ndim=1)
masses = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.kernel
def node_motion(
    begin: ti.i32, end: ti.i32, capacity: ti.i32, least_mass: ti.f64, boxes: table, momentum: nodes,
    clamp: flags, clamp_velocity: lattice_rows, planes: rows, solid: lattice_rows, lattice: numbers, bounds: integers,
    inverse_mass: masses, velocity: singles,
):  # fmt: skip
    """Out, for substeps `begin` to `end`: inverse_mass (S, nodes), zero for nodes that are clamped or have at most least_mass [kg], and the
    nodes' velocity (S nodes 3,). `momentum` has `capacity` nodes for each substep."""
    for s, node in ti.ndrange((begin, end), inverse_mass.shape[1]):
        offset, dx, dt = lattice_of(lattice)
        lo, dims = ti.Vector([boxes[s, a] for a in range(3)]), ti.Vector([boxes[s, 3 + a] for a in range(3)])
        if node < dims[0] * dims[1] * dims[2]:
            g, c = momentum[bounded(s * capacity + node, MOST_INDEXED)], place(node, lo, dims) - triple(bounds, CLAMP_LO)
            stands = False
            if in_box(c, clamp):
                stands = clamp[c[0], c[1], c[2]] != 0
            inverse = 0.0
            if g[3] > least_mass and not stands:
                inverse = 1.0 / g[3]
            inverse_mass[s, node] = ti.cast(inverse, ti.f32)
            v = node_velocity(node, g, lo, dims, bounds, offset, dx, clamp, clamp_velocity, planes, solid)
            for a in ti.static(range(3)):
                velocity[3 * (s * inverse_mass.shape[1] + node) + a] = ti.cast(v[a], ti.f32)


@ti.func
def stress_derivative(plastic: ti.template(), at, own, dx, dt, particle: ti.template(), F, C, record: ti.template()):
    """Write the STRESS coefficients into `record` from `at` on; returns tau, viscous part included."""
    law, mu, lam = ti.cast(particle[own + LAW], ti.i32), particle[own + MU], particle[own + LAM]
    viscosity, scale = particle[own + VISCOSITY], -4.0 * dt / dx * particle[own + VOLUME]
    tau, known = kirchhoff(plastic, law, F, mu, lam)
    inverse, damped = F.inverse().transpose(), is_damped(law, viscosity)
    whole = tau
    if damped:
        whole += viscous(C, mu, lam, viscosity)
    turn = scale * product(whole, inverse)
    m, U, x, e, slopes = 0.0, ti.Matrix.zero(float, 3, 3), ti.Vector.zero(float, 3), ti.Vector.zero(float, 3), ti.Vector.zero(float, 3)
    if ti.static(plastic):
        if law >= VON_MISES:
            m, U, x, e, slopes = hencky_terms(F)
    for a in range(3):
        for b in range(a, 3):
            bar = ti.Matrix.zero(float, 3, 3)
            bar[a, b] = scale
            F_bar, _mu_bar, _lam_bar = kirchhoff_adjoint(law, F, mu, lam, known, bar)
            if ti.static(plastic):
                if law >= VON_MISES:
                    F_bar, _mu_bar, _lam_bar = hencky_adjoint(F, mu, lam, m, U, x, e, slopes, bar)
            elif damped:
                F_bar -= product(product(C.transpose(), viscosity * doubled_rate(bar, lam / mu)), inverse)
            for i, d in ti.static(ti.ndrange(3, 3)):
                first, second = F_bar[i, d], F_bar[i, d]
                if ti.static(not plastic):
                    first -= turn[a, d] if i == b else 0.0
                    second -= turn[b, d] if i == a else 0.0
                record[at + 9 * (3 * a + b) + 3 * i + d] = ti.cast(first, ti.f32)
                record[at + 9 * (3 * b + a) + 3 * i + d] = ti.cast(second, ti.f32)
    return whole


@ti.func
def advection(at, corner, f, dx, v_p, velocity: ti.template(), stride_x, stride_y, record: ti.template()):
    """Write TURN and SWIRL: the derivatives of g2p's v and C by the particle's place among fixed nodes, `velocity` from node `corner` on.

    TURN is the sum over nodes of v grad w; SWIRL is the sum of v (i, j, k) grad w less the place f times TURN. Both are summed along z,
    then y, then x, which takes a fifth of the time of summing node by node. Weights and slopes are taken from `record`. The loops are not
    unrolled, because they would take minutes to compile.
    """
    for c in range(3):
        turn, swirl = ti.Vector.zero(float, 3), ti.Matrix.zero(float, 3, 3)
        for i in range(3):
            level, sloped = ti.Vector.zero(float, 6), ti.Vector.zero(float, 3)  # a plane's sums, with weights and with slopes along y
            for j in range(3):
                z, first = at + 2, 3 * (corner + i * stride_x + j * stride_y) + c
                near, middle, far = velocity[first], velocity[first + 3], velocity[first + 6]
                middle_w, far_w = record[WEIGHTS + z + 3] * middle, record[WEIGHTS + z + 6] * far
                middle_s, far_s = record[SLOPES + z + 3] * middle, record[SLOPES + z + 6] * far
                line, line_z = record[WEIGHTS + z] * near + middle_w + far_w, middle_w + 2.0 * far_w
                rise, rise_z = record[SLOPES + z] * near + middle_s + far_s, middle_s + 2.0 * far_s
                w, slope = record[WEIGHTS + at + 3 * j + 1], record[SLOPES + at + 3 * j + 1]
                level += w * ti.Vector([line, rise, line_z, rise_z, j * line, j * rise])
                sloped += slope * ti.Vector([line, line_z, j * line])
            w, slope = record[WEIGHTS + at + 3 * i], record[SLOPES + at + 3 * i]
            along = ti.Vector([slope * level[0], w * sloped[0], w * level[1]])
            turn += along
            swirl += ti.Matrix.rows(
                [
                    i * along,
                    ti.Vector([slope * level[4], w * sloped[2], w * level[5]]),
                    ti.Vector([slope * level[2], w * sloped[1], w * level[3]]),
                ]
            )
        for e in ti.static(range(3)):
            record[at + TURN + 3 * c + e] = ti.cast(turn[e], ti.f32)
            for d in ti.static(range(3)):
                own = v_p[c] / dx if ti.static(d == e) else 0.0
                record[at + SWIRL + 9 * c + 3 * d + e] = ti.cast(4.0 / dx * (swirl[d, e] - f[d] * turn[e] - own), ti.f32)


@ti.func
def flow_derivative(at, own, dt, particle: ti.template(), trial, flow: ti.template()):
    """Write the derivative of the plastic flow that follows the trial deformation; returns whether the particle may flow."""
    law, mu, yield_stress = ti.cast(particle[own + LAW], ti.i32), particle[own + MU], particle[own + YIELD_STRESS]
    m, X, size = relative_deviator(left_cauchy_green(trial))
    flows = 0
    if law >= VON_MISES and not certainly_elastic(size, mu, yield_stress):
        flows = 1
        U, x, e, s, kept, M, shear, _trial, _limit, _w = flow_terms(law, mu, yield_stress, particle[own + VISCOSITY], dt, X, size)
        for row in range(9):
            bar = ti.Matrix.zero(float, 3, 3)
            bar[row // 3, row % 3] = 1.0
            F_bar, _s_bar = through_flow(trial, m, U, x, e, s, kept, M, shear, bar)
            for i, d in ti.static(ti.ndrange(3, 3)):
                flow[at + 9 * row + 3 * i + d] = ti.cast(F_bar[i, d], ti.f32)
    return flows


@ti.kernel
def linearise(
    plastic: ti.template(), begin: ti.i32, end: ti.i32, most: ti.i32, particle: constants, state: states, force: forces,
    lattice: numbers, boxes: table, velocity: singles, corner: table, record: singles, flows: table, flow: singles,
):  # fmt: skip
    """The coefficients of all particles in substeps `begin` to `end`; `velocity` has `most` nodes for each substep.

    Out: corner (S, M), record (S M `width_of`,); with plastic laws also flows (S, M) and flow (S M FLOW,).
    """
    for s, p in ti.ndrange((begin, end), particle.shape[0] // 8):
        offset, dx, dt = lattice_of(lattice)
        lo, dims = ti.Vector([boxes[s, a] for a in range(3)]), ti.Vector([boxes[s, 3 + a] for a in range(3)])
        count = particle.shape[0] // 8
        row, after, at = rows_of(s * count + p)[0], rows_of((s + 1) * count + p)[0], (s * count + p) * ti.static(width_of(plastic))
        push, own = rows_of(p)[1], rows_of(p)[2]
        F0, F1, F2 = state[row], state[row + 1], state[row + 2]
        node, f = corner_of(fourths(F0, F1, F2, 0.0), offset, 1.0 / dx, lo, dims, 0)
        corner[s, p] = node
        w, F, C = spline(f), from_columns(F0, F1, F2), from_columns(state[row + 3], state[row + 4], state[row + 5])
        for i, a in ti.static(ti.ndrange(3, 3)):
            record[at + WEIGHTS + 3 * i + a] = ti.cast(w[i][a], ti.f32)
            record[at + PULL + 3 * i + a] = ti.cast(dt * F[i, a], ti.f32)
        for a in ti.static(range(3)):
            record[at + PLACE + a] = ti.cast(f[a], ti.f32)
        tau = stress_derivative(plastic, at + STRESS, own, dx, dt, particle, F, C, record)
        if ti.static(plastic):
            slope, rate = spline_slope(f), from_columns(state[after + 3], state[after + 4], state[after + 5])
            S, X, Y, Z = node_terms(tau, row, push, own, f, particle, state, force, dx, dt)
            for i, a in ti.static(ti.ndrange(3, 3)):
                record[at + SLOPES + 3 * i + a] = ti.cast(slope[i][a] / dx, ti.f32)
                record[at + GROWTH + 3 * i + a] = ti.cast(dt * rate[i, a] + (1.0 if ti.static(i == a) else 0.0), ti.f32)
            for a in ti.static(range(3)):
                record[at + FLOAT + a], record[at + FLOAT + 3 + a] = ti.cast(S[a], ti.f32), ti.cast(X[a], ti.f32)
                record[at + FLOAT + 6 + a], record[at + FLOAT + 9 + a] = ti.cast(Y[a], ti.f32), ti.cast(Z[a], ti.f32)
            v = ti.Vector([state[after + 3][3], state[after + 4][3], state[after + 5][3]])
            advection(at, s * most + node, f, dx, v, velocity, dims[1] * dims[2], dims[2], record)
            flows[s, p] = flow_derivative((s * count + p) * FLOW, own, dt, particle, F + dt * product(rate, F), flow)
