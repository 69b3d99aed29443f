"""MLS-MPM in Taichi as the usual examples write it: one grid, atomic adds, `ti.svd` for every law. The benchmark's baseline.

The pattern is that of Taichi's own mpm3d example and of PhysGaussian's and PAC-NeRF's solvers: a parallel loop over particles that
scatters with atomics, one over the nodes, one over the particles that gathers. Single precision and fast math, Taichi's defaults.
"""
# The compiler reads the annotations of kernels at run time.
# mypy: ignore-errors

from types import SimpleNamespace

import numpy as np

from seeing_wind.engine.mpm.compiler import ti
from seeing_wind.engine.mpm.compiler.settings import compiled_in, contracted

COROTATED, NEO_HOOKEAN, VON_MISES, VISCOPLASTIC = 0, 1, 2, 3
vec3 = ti.types.vector(3, ti.f32)
mat3 = ti.types.matrix(3, 3, ti.f32)


class NaiveTaichi:
    """Runs a `problem.Problem`."""

    name = "naive Taichi"

    def __init__(self, problem) -> None:
        n, g = len(problem.x), problem.grid
        self.x, self.v = ti.Vector.field(3, ti.f32, n), ti.Vector.field(3, ti.f32, n)
        self.C, self.F = ti.Matrix.field(3, 3, ti.f32, n), ti.Matrix.field(3, 3, ti.f32, n)
        self.problem = problem
        self.kernels = _kernels(problem, self.x, self.v, self.C, self.F, ti.Vector.field(3, ti.f32, (g, g, g)), ti.field(ti.f32, (g, g, g)))
        self.reset()

    def reset(self) -> None:
        """Back to the first state."""
        for field, values in ((self.x, self.problem.x), (self.v, self.problem.v), (self.C, self.problem.C), (self.F, self.problem.F)):
            field.from_numpy(values.astype(np.float32))

    def run(self, substeps: int) -> None:
        """Advance by that many substeps."""
        with compiled_in(np.float32), contracted():
            for _ in range(substeps):
                self.kernels.clear()
                self.kernels.p2g()
                self.kernels.grid_op()
                self.kernels.g2p()
            ti.sync()

    def positions(self) -> np.ndarray:
        """(N, 3)."""
        return self.x.to_numpy()

    def deformations(self) -> np.ndarray:
        """(N, 3, 3)."""
        return self.F.to_numpy()


def _laws(problem) -> tuple:
    """Stress and return mapping of the problem's law. They and the kernels are no methods: `compiler.tracing` knows of no class."""
    law, dt, mu, lam = problem.law, problem.dt, problem.mu, problem.lam
    limit, viscosity = float(np.sqrt(2.0 / 3.0)) * problem.yield_stress, problem.viscosity

    @ti.func
    def stress(f):
        """Kirchhoff stress by singular values."""
        U, S, V = ti.svd(f)
        tau = ti.Matrix.zero(ti.f32, 3, 3)
        J = S[0, 0] * S[1, 1] * S[2, 2]
        I = ti.Matrix.identity(ti.f32, 3)
        if ti.static(law == COROTATED):
            tau = 2.0 * mu * (f - U @ V.transpose()) @ f.transpose() + lam * J * (J - 1.0) * I
        elif ti.static(law == NEO_HOOKEAN):
            tau = U @ (mu * S @ S + (lam * ti.log(J) - mu) * I) @ U.transpose()
        else:
            e = ti.Matrix.zero(ti.f32, 3, 3)
            for d in ti.static(range(3)):
                e[d, d] = ti.log(S[d, d])
            tau = U @ (2.0 * mu * e + lam * e.trace() * I) @ U.transpose()
        return tau

    @ti.func
    def flow(f):
        """Return mapping by singular values."""
        flowed = f
        if ti.static(law >= VON_MISES):
            U, S, V = ti.svd(f)
            e = ti.Vector([ti.log(S[0, 0]), ti.log(S[1, 1]), ti.log(S[2, 2])])
            mean = e.sum() / 3.0
            deviator = e - mean
            trial = 2.0 * mu * deviator.norm()
            if trial > limit:
                reached = limit
                if ti.static(law == VISCOPLASTIC):
                    reached = (viscosity * trial + mu * dt * limit) / (viscosity + mu * dt)
                new = ti.exp(mean + deviator * (reached / trial))
                flowed = U @ ti.Matrix([[new[0], 0.0, 0.0], [0.0, new[1], 0.0], [0.0, 0.0, new[2]]]) @ V.transpose()
        return flowed

    return stress, flow


def _kernels(problem, x, v, C, F, grid_v, grid_m) -> SimpleNamespace:
    """Of one substep of a problem, with its numbers as constants."""
    dx, dt, mass, volume, gravity = problem.dx, problem.dt, problem.mass, problem.volume, vec3(problem.gravity)
    stress, flow = _laws(problem)

    @ti.kernel
    def clear():
        for i in ti.grouped(grid_m):
            grid_v[i] = ti.Vector.zero(ti.f32, 3)
            grid_m[i] = 0.0

    @ti.kernel
    def p2g():
        for p in x:
            base = (x[p] / dx - 0.5).cast(int)
            fx = x[p] / dx - base.cast(ti.f32)
            w = [0.5 * (1.5 - fx) ** 2, 0.75 - (fx - 1.0) ** 2, 0.5 * (fx - 0.5) ** 2]
            affine = mass * C[p] - (dt * volume * 4.0 / dx**2) * stress(F[p])
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                offset = ti.Vector([i, j, k])
                dpos = (offset.cast(ti.f32) - fx) * dx
                weight = w[i][0] * w[j][1] * w[k][2]
                grid_v[base + offset] += weight * (mass * (v[p] + dt * gravity) + affine @ dpos)
                grid_m[base + offset] += weight * mass

    @ti.kernel
    def grid_op():
        for i in ti.grouped(grid_m):
            if grid_m[i] > 0.0:
                grid_v[i] /= grid_m[i]

    @ti.kernel
    def g2p():
        for p in x:
            base = (x[p] / dx - 0.5).cast(int)
            fx = x[p] / dx - base.cast(ti.f32)
            w = [0.5 * (1.5 - fx) ** 2, 0.75 - (fx - 1.0) ** 2, 0.5 * (fx - 0.5) ** 2]
            new_v, new_C = ti.Vector.zero(ti.f32, 3), ti.Matrix.zero(ti.f32, 3, 3)
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                dpos = ti.Vector([i, j, k]).cast(ti.f32) - fx
                g_v = grid_v[base + ti.Vector([i, j, k])]
                weight = w[i][0] * w[j][1] * w[k][2]
                new_v += weight * g_v
                new_C += 4.0 / dx * weight * g_v.outer_product(dpos)
            v[p], C[p] = new_v, new_C
            x[p] += dt * new_v
            F[p] = flow((ti.Matrix.identity(ti.f32, 3) + dt * new_C) @ F[p])

    return SimpleNamespace(clear=clear, p2g=p2g, grid_op=grid_op, g2p=g2p)
