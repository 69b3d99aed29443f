"""A frame's substeps linearised: what small changes of one body's motion are multiplied with, see `carry`.

All comes from the states, the boxes and the grids of every substep, as `copies_forward` keeps them. The stress derivative is that of the
first Piola-Kirchhoff stress pushed forward (Bonet and Wood, "Nonlinear continuum mechanics", section 6.3).
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..lattice.conditions import in_box
from ..laws.constitutive import kirchhoff, kirchhoff_adjoint
from ..laws.eigen import left_cauchy_green, product, relative_deviator
from ..laws.plasticity import VON_MISES, certainly_elastic, hencky_both_ways, plastic_flow_adjoint
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
    fourths,
    integers,
    lattice_of,
    matrix,
    nodes,
    numbers,
    rows_of,
    spline,
    states,
    table,
    triple,
)
from .packed import MOST_NODES as MOST_INDEXED
from .substep import place

RECORD = 102
"""Numbers of a linearised particle: weights 0..8, place f in its cell 9..11, derivative of the stress 12..92, dt F 93..101."""

FLOW, STRESS, RATE = 99, 81, 90
"""Numbers that a particle has besides in a body with plastic laws: the derivative of the flow, row 3 i + j that of F_ij after it by the
nine of F before it; from STRESS on -(4 dt V / dx) tau, from RATE on C, both zero under an elastic law."""

singles = ti.types.ndarray(dtype=ti.f32, ndim=1)
masses = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.func
def stress_derivative(plastic: ti.template(), at, own, dx, dt, particle: ti.template(), F, C, record: ti.template()):
    """Writes -(4 dt V / dx) (dtau - tau L^T) by dF, L = dF F^-1, into `record` from `at` on: row 3 a + b is that of tau_ab.

    Under a plastic law without tau L^T. Returns -(4 dt V / dx) tau.
    """
    law, mu, lam = ti.cast(particle[own + LAW], ti.i32), particle[own + MU], particle[own + LAM]
    viscosity, scale = particle[own + VISCOSITY], -4.0 * dt / dx * particle[own + VOLUME]
    tau, known = kirchhoff(plastic, law, F, mu, lam)
    inverse, damped = F.inverse().transpose(), is_damped(law, viscosity)
    if damped:
        tau += viscous(C, mu, lam, viscosity)
    turn = scale * product(tau, inverse)
    if law >= VON_MISES:
        turn = ti.Matrix.zero(float, 3, 3)
    for a in range(3):
        for b in range(a, 3):
            bar = ti.Matrix.zero(float, 3, 3)
            bar[a, b] = scale
            F_bar, _mu_bar, _lam_bar = kirchhoff_adjoint(law, F, mu, lam, known, bar)
            if ti.static(plastic):
                if law >= VON_MISES:
                    _tau, F_bar, _mu_bar, _lam_bar = hencky_both_ways(F, mu, lam, bar)
            if damped:
                C_bar = viscosity * doubled_rate(bar, lam / mu)
                F_bar -= product(product(C.transpose(), C_bar), inverse)
            for i, d in ti.static(ti.ndrange(3, 3)):
                first, second = F_bar[i, d], F_bar[i, d]
                if i == b:
                    first -= turn[a, d]
                if i == a:
                    second -= turn[b, d]
                record[at + 9 * (3 * a + b) + 3 * i + d] = ti.cast(first, ti.f32)
                record[at + 9 * (3 * b + a) + 3 * i + d] = ti.cast(second, ti.f32)
    return scale * tau


@ti.func
def flow_derivative(at, own, dt, particle: ti.template(), trial, flow: ti.template()):
    """Writes the derivative of the plastic flow that follows the trial deformation; returns whether anything may flow."""
    law, mu, yield_stress = ti.cast(particle[own + LAW], ti.i32), particle[own + MU], particle[own + YIELD_STRESS]
    _m, _X, size = relative_deviator(left_cauchy_green(trial))
    flows = 0
    if law >= VON_MISES and not certainly_elastic(size, mu, yield_stress):
        flows = 1
        for row in range(9):
            bar = ti.Matrix.zero(float, 3, 3)
            bar[row // 3, row % 3] = 1.0
            F_bar, _mu, _yield, _viscosity = plastic_flow_adjoint(law, trial, mu, yield_stress, particle[own + VISCOSITY], dt, bar)
            for i, d in ti.static(ti.ndrange(3, 3)):
                flow[at + 9 * row + 3 * i + d] = ti.cast(F_bar[i, d], ti.f32)
    return flows


@ti.kernel
def linearise(
    plastic: ti.template(), begin: ti.i32, end: ti.i32, particle: constants, state: states, lattice: numbers, boxes: table,
    corner: table, record: singles, flows: table, flow: singles,
):  # fmt: skip
    """Weights, stress derivatives and those of the flow in substeps `begin` to `end` of a frame that `copies_forward` has kept.

    Out: corner (S, M), record (S M RECORD,); with plastic laws flows (S, M), flow (S M FLOW,).
    """
    for s, p in ti.ndrange((begin, end), particle.shape[0] // 8):
        offset, dx, dt = lattice_of(lattice)
        lo, dims = ti.Vector([boxes[s, a] for a in range(3)]), ti.Vector([boxes[s, 3 + a] for a in range(3)])
        count = particle.shape[0] // 8
        row, own, at = rows_of(s * count + p)[0], rows_of(p)[2], (s * count + p) * RECORD
        F0, F1, F2 = state[row], state[row + 1], state[row + 2]
        node, f = corner_of(fourths(F0, F1, F2, 0.0), offset, 1.0 / dx, lo, dims, 0)
        corner[s, p] = node
        w, F, C = spline(f), matrix(F0, F1, F2), matrix(state[row + 3], state[row + 4], state[row + 5])
        for i, a in ti.static(ti.ndrange(3, 3)):
            record[at + 3 * i + a] = ti.cast(w[i][a], ti.f32)
            record[at + 93 + 3 * i + a] = ti.cast(dt * F[i, a], ti.f32)
        for a in ti.static(range(3)):
            record[at + 9 + a] = ti.cast(f[a], ti.f32)
        stress = stress_derivative(plastic, at + 12, own, dx, dt, particle, F, C, record)
        if ti.static(plastic):
            after = rows_of((s + 1) * count + p)[0]
            rate = matrix(state[after + 3], state[after + 4], state[after + 5])
            more = (s * count + p) * FLOW
            flows[s, p] = flow_derivative(more, own, dt, particle, F + dt * product(rate, F), flow)
            kept = ti.select(ti.cast(particle[own + LAW], ti.i32) >= VON_MISES, 1.0, 0.0)
            for i, a in ti.static(ti.ndrange(3, 3)):
                flow[more + STRESS + 3 * i + a] = ti.cast(kept * stress[i, a], ti.f32)
                flow[more + RATE + 3 * i + a] = ti.cast(kept * rate[i, a], ti.f32)


@ti.kernel
def inverse_masses(
    begin: ti.i32, end: ti.i32, capacity: ti.i32, least_mass: ti.f64, boxes: table, momentum: nodes, clamp: flags, clamp_lo: integers,
    inverse_mass: masses,
):  # fmt: skip
    """Out, for substeps `begin` to `end`: inverse_mass (S, nodes), zero for nodes that are clamped or have less than least_mass [kg].

    `momentum` has `capacity` nodes for each substep; the box `clamp` begins at node clamp_lo (3,).
    """
    for s, node in ti.ndrange((begin, end), inverse_mass.shape[1]):
        lo, dims = ti.Vector([boxes[s, a] for a in range(3)]), ti.Vector([boxes[s, 3 + a] for a in range(3)])
        if node < dims[0] * dims[1] * dims[2]:
            mass, c = momentum[bounded(s * capacity + node, MOST_INDEXED)][3], place(node, lo, dims) - triple(clamp_lo, 0)
            stands = False
            if in_box(c, clamp):
                stands = clamp[c[0], c[1], c[2]] != 0
            inverse = 0.0
            if mass > least_mass and not stands:
                inverse = 1.0 / mass
            inverse_mass[s, node] = ti.cast(inverse, ti.f32)
