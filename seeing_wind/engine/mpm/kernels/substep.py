"""The substep of MLS-MPM, for single particles and nodes: p2g of a particle, the velocity of a node, g2p of a particle.

Hu et al. 2018, "A moving least squares material point method"; Jiang et al. 2015, "The affine particle-in-cell method". The lattice has
nodes at offset + dx (i, j, k) for all integers; `lo` and `dims` give the box of nodes in use, so a body may travel arbitrarily far.

The external acceleration a_p, constant over a frame, is added to the particle's velocity before p2g, as in the paper (arXiv 2512.00762);
its gradient is added to the affine momentum. Otherwise the torque and strain that a field causes within one kernel would be lost.

Everything that runs substeps is built from these functions: one body on all cores (`parallel`), and many copies of a body, each on a core,
or one body with every substep kept (`copies_forward`).
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
"""Status of a body. GRID_FULL is not a failure: the caller provides more nodes and calls again."""
STRIDE = 1024
"""Iterations of a kernel's outer loop for each worker, all but one of them empty: the compiler runs loops of fewer than about a thousand
iterations on one thread."""
CLAMP_LO, SOLID_LO = 2, 3
"""Rows of three in the array of integers `bounds`: first nodes of the boxes of clamped and of solid nodes."""


@ti.func
def node_terms(tau, row, push, own, f, particle: ti.template(), state: ti.template(), force: ti.template(), dx, dt):
    """S, X, Y, Z, each (4,): a particle at distance f [cells] from its first node, with the stress tau, adds w (S + i X + j Y + k Z) to the
    momentum and mass of its node (i, j, k).

    The momentum is m (v + dt a) + A (x_i - x_p), with the affine momentum A of the MLS-MPM transfer; X, Y, Z are the columns of dx A.
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
    """p2g of one particle, whose state, force and constants begin at row, push and own: adds to momentum and mass of its 27 nodes."""
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
    """g2p of particle p, from `state` at row to `state_out` at row_out; returns its status and its new position (4,)."""
    F0, F1, F2 = state[row], state[row + 1], state[row + 2]
    x = fourths(F0, F1, F2, 0.0)
    free, prescribed = 1.0, 0.0 * F0
    if ti.cast(particle[own + ROLE], ti.i32) != FREE:
        pin = ti.min(p, pin_velocity.shape[0] - 1)  # one row for all particles if the pins stand still
        free, prescribed = 0.0, ti.Vector([pin_velocity[pin, 0], pin_velocity[pin, 1], pin_velocity[pin, 2], 0.0])
    at, f = corner_of(x, offset, 1.0 / dx, lo, dims, first_node)
    v, Mx, My, Mz = gather(f, at, dims, velocity)
    k = 4.0 / dx
    Cx, Cy, Cz = k * (Mx - f[0] * v), k * (My - f[1] * v), k * (Mz - f[2] * v)
    x = x + dt * (free * v + prescribed)
    F0, F1, F2 = F0 + dt * times_columns(Cx, Cy, Cz, F0), F1 + dt * times_columns(Cx, Cy, Cz, F1), F2 + dt * times_columns(Cx, Cy, Cz, F2)
    F = from_columns(F0, F1, F2)
    status, speed_sqr, J = RUNNING, v[0] * v[0] + v[1] * v[1] + v[2] * v[2], F.determinant()
    # Written so that NaN fails, too. If C is not finite, neither is F.
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
    """A node's velocity under its boundary conditions, and its mass (4,), from its momentum and mass g (4,)."""
    v = ti.Vector.zero(float, 3)
    if g[3] > 0.0:
        v = boundary_velocity(
            place(node, lo, dims), ti.Vector([g[0], g[1], g[2]]) / g[3], offset, dx,
            triple(bounds, CLAMP_LO), clamp, clamp_velocity, planes, triple(bounds, SOLID_LO), solid,
        )  # fmt: skip
    return ti.Vector([v[0], v[1], v[2], g[3]])
