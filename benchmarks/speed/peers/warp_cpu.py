"""MLS-MPM in NVIDIA Warp as its examples and warp-mpm write it: one grid, atomic adds, `wp.svd3` for every law."""

from __future__ import annotations

import numpy as np
import warp as wp

COROTATED, NEO_HOOKEAN, VON_MISES, VISCOPLASTIC = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)


@wp.struct
class Constants:
    """Of one run."""

    law: int
    mass: float
    volume: float
    mu: float
    lam: float
    limit: float
    viscosity: float
    dx: float
    dt: float
    gravity: wp.vec3


@wp.func
def kirchhoff(c: Constants, F: wp.mat33):
    """Kirchhoff stress by singular values."""
    U = wp.mat33()
    V = wp.mat33()
    s = wp.vec3()
    wp.svd3(F, U, s, V)
    J = s[0] * s[1] * s[2]
    one = wp.identity(n=3, dtype=float)
    tau = wp.mat33()
    if c.law == COROTATED:
        tau = 2.0 * c.mu * (F - U * wp.transpose(V)) * wp.transpose(F) + c.lam * J * (J - 1.0) * one
    elif c.law == NEO_HOOKEAN:
        d = wp.vec3(c.mu * s[0] * s[0], c.mu * s[1] * s[1], c.mu * s[2] * s[2])
        tau = U * wp.diag(d) * wp.transpose(U) + (c.lam * wp.log(J) - c.mu) * one
    else:
        e = wp.vec3(wp.log(s[0]), wp.log(s[1]), wp.log(s[2]))
        trace = c.lam * (e[0] + e[1] + e[2])
        d = 2.0 * c.mu * e + wp.vec3(trace, trace, trace)
        tau = U * wp.diag(d) * wp.transpose(U)
    return tau


@wp.func
def flow(c: Constants, F: wp.mat33):
    """Return mapping by singular values."""
    if c.law < VON_MISES:
        return F
    U = wp.mat33()
    V = wp.mat33()
    s = wp.vec3()
    wp.svd3(F, U, s, V)
    e = wp.vec3(wp.log(s[0]), wp.log(s[1]), wp.log(s[2]))
    mean = (e[0] + e[1] + e[2]) / 3.0
    deviator = e - wp.vec3(mean, mean, mean)
    trial = 2.0 * c.mu * wp.length(deviator)
    if trial <= c.limit:
        return F
    stress = c.limit
    if c.law == VISCOPLASTIC:
        stress = (c.viscosity * trial + c.mu * c.dt * c.limit) / (c.viscosity + c.mu * c.dt)
    k = stress / trial
    new = wp.vec3(wp.exp(mean + k * deviator[0]), wp.exp(mean + k * deviator[1]), wp.exp(mean + k * deviator[2]))
    return U * wp.diag(new) * wp.transpose(V)


@wp.kernel
def p2g(
    c: Constants, x: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), C: wp.array(dtype=wp.mat33), F: wp.array(dtype=wp.mat33),
    grid_v: wp.array(dtype=wp.vec3, ndim=3), grid_m: wp.array(dtype=float, ndim=3),
):  # fmt: skip
    """Particles to grid."""
    p = wp.tid()
    at = x[p] / c.dx
    bx, by, bz = int(at[0] - 0.5), int(at[1] - 0.5), int(at[2] - 0.5)
    fx = at - wp.vec3(float(bx), float(by), float(bz))
    wa = wp.vec3(1.5) - fx
    wb = fx - wp.vec3(1.0)
    wc = fx - wp.vec3(0.5)
    w = wp.matrix_from_cols(wp.cw_mul(wa, wa) * 0.5, wp.vec3(0.75) - wp.cw_mul(wb, wb), wp.cw_mul(wc, wc) * 0.5)
    affine = c.mass * C[p] - (c.dt * c.volume * 4.0 / (c.dx * c.dx)) * kirchhoff(c, F[p])
    momentum = c.mass * (v[p] + c.dt * c.gravity)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                dpos = (wp.vec3(float(i), float(j), float(k)) - fx) * c.dx
                weight = w[0, i] * w[1, j] * w[2, k]
                wp.atomic_add(grid_v, bx + i, by + j, bz + k, weight * (momentum + affine * dpos))
                wp.atomic_add(grid_m, bx + i, by + j, bz + k, weight * c.mass)


@wp.kernel
def grid_op(grid_v: wp.array(dtype=wp.vec3, ndim=3), grid_m: wp.array(dtype=float, ndim=3)):
    """Momentum to velocity."""
    i, j, k = wp.tid()
    if grid_m[i, j, k] > 0.0:
        grid_v[i, j, k] = grid_v[i, j, k] / grid_m[i, j, k]


@wp.kernel
def g2p(
    c: Constants, x: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), C: wp.array(dtype=wp.mat33), F: wp.array(dtype=wp.mat33),
    grid_v: wp.array(dtype=wp.vec3, ndim=3),
):  # fmt: skip
    """Grid to particles."""
    p = wp.tid()
    at = x[p] / c.dx
    bx, by, bz = int(at[0] - 0.5), int(at[1] - 0.5), int(at[2] - 0.5)
    fx = at - wp.vec3(float(bx), float(by), float(bz))
    wa = wp.vec3(1.5) - fx
    wb = fx - wp.vec3(1.0)
    wc = fx - wp.vec3(0.5)
    w = wp.matrix_from_cols(wp.cw_mul(wa, wa) * 0.5, wp.vec3(0.75) - wp.cw_mul(wb, wb), wp.cw_mul(wc, wc) * 0.5)
    new_v = wp.vec3()
    new_C = wp.mat33()
    for i in range(3):
        for j in range(3):
            for k in range(3):
                dpos = wp.vec3(float(i), float(j), float(k)) - fx
                weight = w[0, i] * w[1, j] * w[2, k]
                g = grid_v[bx + i, by + j, bz + k]
                new_v = new_v + weight * g
                new_C = new_C + (4.0 / c.dx * weight) * wp.outer(g, dpos)
    v[p] = new_v
    C[p] = new_C
    x[p] = x[p] + c.dt * new_v
    F[p] = flow(c, (wp.identity(n=3, dtype=float) + c.dt * new_C) * F[p])


class WarpCpu:
    """Runs a `problem.Problem`."""

    name = "Warp"

    def __init__(self, problem) -> None:
        wp.config.quiet = True
        wp.init()
        g = problem.grid
        self.c = Constants()
        for field in ("law", "mass", "volume", "mu", "lam", "viscosity", "dx", "dt"):
            setattr(self.c, field, getattr(problem, field))
        self.c.limit = float(np.sqrt(2.0 / 3.0)) * problem.yield_stress
        self.c.gravity = wp.vec3(*problem.gravity)
        self.grid_v = wp.zeros((g, g, g), dtype=wp.vec3, device="cpu")
        self.grid_m = wp.zeros((g, g, g), dtype=float, device="cpu")
        self.p = problem
        self.reset()

    def reset(self) -> None:
        """Back to the first state."""
        self.x, self.v = (wp.array(a.astype(np.float32), dtype=wp.vec3, device="cpu") for a in (self.p.x, self.p.v))
        self.C, self.F = (wp.array(a.astype(np.float32), dtype=wp.mat33, device="cpu") for a in (self.p.C, self.p.F))

    def run(self, substeps: int) -> None:
        """Advance by that many substeps."""
        n, particles = len(self.x), (self.x, self.v, self.C, self.F)
        for _ in range(substeps):
            self.grid_v.zero_()
            self.grid_m.zero_()
            wp.launch(p2g, dim=n, inputs=[self.c, *particles, self.grid_v, self.grid_m], device="cpu")
            wp.launch(grid_op, dim=self.grid_m.shape, inputs=[self.grid_v, self.grid_m], device="cpu")
            wp.launch(g2p, dim=n, inputs=[self.c, *particles, self.grid_v], device="cpu")

    def positions(self) -> np.ndarray:
        """(N, 3)."""
        return self.x.numpy()

    def deformations(self) -> np.ndarray:
        """(N, 3, 3)."""
        return self.F.numpy()
