"""The substep of MLS-MPM: what one particle brings to its nodes, what a node's momentum becomes, what one particle takes home.

Hu et al. 2018, "A moving least squares material point method"; Jiang et al. 2015, "The affine particle-in-cell method". The lattice's nodes
are at offset + dx (i, j, k) for all integers; `lo` and `dims` name the box of it that is in use, so a body may travel as far as it likes.

The external acceleration a_p, held over a frame, is added to the particle's velocity before p2g, as in the paper (arXiv 2512.00762); its
gradient goes into the affine momentum. Without that the torque and the strain that a field has over one kernel are lost.

All that runs substeps is made of these functions: one body on all cores (`parallel`), many copies of one, each on a core, and a body whose
every substep is kept (`copies_forward`).
"""
# The compiler reads the annotations of functions at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from ..lattice.boundary import FREE
from ..lattice.conditions import boundary_velocity
from ..laws.constitutive import kirchhoff
from ..laws.eigen import from_columns, times_columns
from ..laws.plasticity import VON_MISES, plastic_flow
from ..laws.viscous import is_damped, viscous
from .packed import (
    LAM,
    LAW,
    MASS,
    MU,
    ROLE,
    VISCOSITY,
    VOLUME,
    YIELD_STRESS,
    corner_of,
    fourths,
    gather,
    scatter,
    triple,
    with_fourth,
)

RUNNING, NOT_FINITE, TOO_FAST, INVERTED, GRID_FULL, BURST = 0, 1, 2, 3, 4, 5
"""Status of a body. GRID_FULL is no failure: the caller gives more nodes and calls again."""
STRIDE = 1024
"""Turns of a kernel's outer loop for each worker, all but one of them empty: the compiler runs loops of less than about a thousand turns on
one thread."""
CLAMP_LO, SOLID_LO = 2, 3
"""Rows of three in an array of integers that kernels call `bounds`: first nodes of the boxes of clamped and solid nodes."""


@ti.func
def node_terms(tau, row, push, own, f, particle: ti.template(), state: ti.template(), force: ti.template(), dx, dt):
    """What a particle at f from its first node brings to its nodes under the stress tau, S + i X + j Y + k Z: momentum and mass.

    It is m (v + dt a) + A (x_i - x_p) with A of the MLS-MPM transfer; B = dx A.
    """
    k = (4.0 * dt / dx) * particle[own + VOLUME]
    scale = particle[own + MASS] * dx
    # Beside a column of C stands v_j: the fourth number of `moving` is dx times the momentum.
    moving = [scale * (state[row + 3 + j] + dt * force[push + j]) for j in ti.static(range(3))]
    columns = [moving[j] - k * ti.Vector([tau[0, j], tau[1, j], tau[2, j], 0.0]) for j in ti.static(range(3))]
    X, Y, Z = [with_fourth(columns[j], 0.0) for j in ti.static(range(3))]
    S = (1.0 / dx) * fourths(columns[0], columns[1], columns[2], scale) - times_columns(X, Y, Z, f)
    return S, X, Y, Z


@ti.func
def particle_to_grid(
    plastic: ti.template(), row, push, own, first_node, particle: ti.template(), state: ti.template(),
    force: ti.template(), offset, dx, dt, lo, dims, grid: ti.template(),
):  # fmt: skip
    """p2g of one particle, whose state, force and numbers begin at row, push and own: adds momentum and mass to the 27 nodes round it."""
    F0, F1, F2 = state[row], state[row + 1], state[row + 2]
    at, f = corner_of(fourths(F0, F1, F2, 0.0), offset, 1.0 / dx, lo, dims, first_node)
    law = ti.cast(particle[own + LAW], ti.i32)
    mu, lam, viscosity = particle[own + MU], particle[own + LAM], particle[own + VISCOSITY]
    tau, _known = kirchhoff(plastic, law, from_columns(F0, F1, F2), mu, lam)
    if is_damped(law, viscosity):
        tau += viscous(from_columns(state[row + 3], state[row + 4], state[row + 5]), mu, lam, viscosity)
    S, X, Y, Z = node_terms(tau, row, push, own, f, particle, state, force, dx, dt)
    scatter(f, S, X, Y, Z, at, dims, grid)


@ti.func
def grid_to_particle(
    plastic: ti.template(), p, row, own, row_out, first_node, particle: ti.template(), state: ti.template(), state_out: ti.template(),
    pin_velocity: ti.template(), offset, dx, dt, lo, dims, velocity: ti.template(),
):  # fmt: skip
    """g2p of particle p, from `state` at row to `state_out` at row_out: returns its status and its new place (4,)."""
    F0, F1, F2 = state[row], state[row + 1], state[row + 2]
    x = fourths(F0, F1, F2, 0.0)
    free, prescribed = 1.0, 0.0 * F0
    if ti.cast(particle[own + ROLE], ti.i32) != FREE:
        pin = ti.min(p, pin_velocity.shape[0] - 1)  # one row for all where they stand still
        free, prescribed = 0.0, ti.Vector([pin_velocity[pin, 0], pin_velocity[pin, 1], pin_velocity[pin, 2], 0.0])
    at, f = corner_of(x, offset, 1.0 / dx, lo, dims, first_node)
    v, Mx, My, Mz = gather(f, at, dims, velocity)
    k = 4.0 / dx
    Cx, Cy, Cz = k * (Mx - f[0] * v), k * (My - f[1] * v), k * (Mz - f[2] * v)
    x = x + dt * (free * v + prescribed)
    F0, F1, F2 = F0 + dt * times_columns(Cx, Cy, Cz, F0), F1 + dt * times_columns(Cx, Cy, Cz, F1), F2 + dt * times_columns(Cx, Cy, Cz, F2)
    F = from_columns(F0, F1, F2)
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
    state_out[row_out], state_out[row_out + 1], state_out[row_out + 2] = with_fourth(F0, x[0]), with_fourth(F1, x[1]), with_fourth(F2, x[2])
    state_out[row_out + 3], state_out[row_out + 4] = with_fourth(Cx, v[0]), with_fourth(Cy, v[1])
    state_out[row_out + 5] = with_fourth(Cz, v[2])
    return status, x


@ti.func
def place(node, lo, dims):
    """Lattice index (3,) of a node."""
    i = node // (dims[1] * dims[2])
    j = node // dims[2] - i * dims[1]
    return lo + ti.Vector([i, j, node - (i * dims[1] + j) * dims[2]])


@ti.func
def node_velocity(
    node, g, lo, dims, bounds: ti.template(), offset, dx, clamp: ti.template(), clamp_velocity: ti.template(), planes: ti.template(),
    solid: ti.template(),
):  # fmt: skip
    """Momentum over mass, and what the boundary makes of it, with the mass."""
    v = ti.Vector.zero(float, 3)
    if g[3] > 0.0:
        v = boundary_velocity(
            place(node, lo, dims), ti.Vector([g[0], g[1], g[2]]) / g[3], offset, dx,
            triple(bounds, CLAMP_LO), clamp, clamp_velocity, planes, triple(bounds, SOLID_LO), solid,
        )  # fmt: skip
    return ti.Vector([v[0], v[1], v[2], g[3]])
