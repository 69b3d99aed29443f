"""MLS-MPM in Taichi as the usual examples write it: one grid, atomic adds, `ti.svd` for every law. The benchmark's baseline.

The pattern is that of Taichi's own mpm3d example and of PhysGaussian's and PAC-NeRF's solvers: a parallel loop over particles that
scatters with atomics, one over the nodes, one over the particles that gathers. Single precision and fast math, Taichi's defaults.
"""
# The compiler reads the annotations of kernels at run time.
# mypy: ignore-errors

import numpy as np

from seeing_wind.engine.mpm.compiler import ti
from seeing_wind.engine.mpm.compiler.settings import compiled_in, contracted

COROTATED, NEO_HOOKEAN, VON_MISES, VISCOPLASTIC = 0, 1, 2, 3
vec3 = ti.types.vector(3, ti.f32)
mat3 = ti.types.matrix(3, 3, ti.f32)


@ti.data_oriented
class NaiveTaichi:
    """Runs a `problem.Problem`."""

    name = "naive Taichi"

    def __init__(self, problem) -> None:
        n, g = len(problem.x), problem.grid
        self.n, self.g, self.law = n, g, problem.law
        self.dx, self.dt = problem.dx, problem.dt
        self.x, self.v = ti.Vector.field(3, ti.f32, n), ti.Vector.field(3, ti.f32, n)
        self.C, self.F = ti.Matrix.field(3, 3, ti.f32, n), ti.Matrix.field(3, 3, ti.f32, n)
        self.grid_v, self.grid_m = ti.Vector.field(3, ti.f32, (g, g, g)), ti.field(ti.f32, (g, g, g))
        self.mass, self.volume, self.mu, self.lam = problem.mass, problem.volume, problem.mu, problem.lam
        self.limit, self.viscosity = float(np.sqrt(2.0 / 3.0)) * problem.yield_stress, problem.viscosity
        self.gravity = vec3(problem.gravity)
        self.p = problem
        self.reset()

    def reset(self) -> None:
        """Back to the first state."""
        self.x.from_numpy(self.p.x.astype(np.float32))
        self.v.from_numpy(self.p.v.astype(np.float32))
        self.C.from_numpy(self.p.C.astype(np.float32))
        self.F.from_numpy(self.p.F.astype(np.float32))

    def run(self, substeps: int) -> None:
        """Advance by that many substeps."""
        with compiled_in(np.float32), contracted():
            for _ in range(substeps):
                self.clear()
                self.p2g()
                self.grid_op()
                self.g2p()
            ti.sync()

    def positions(self) -> np.ndarray:
        """(N, 3)."""
        return self.x.to_numpy()

    def deformations(self) -> np.ndarray:
        """(N, 3, 3)."""
        return self.F.to_numpy()

    @ti.kernel
    def clear(self):
        for i in ti.grouped(self.grid_m):
            self.grid_v[i] = ti.Vector.zero(ti.f32, 3)
            self.grid_m[i] = 0.0

    @ti.func
    def stress(self, F):
        """Kirchhoff stress by singular values."""
        U, S, V = ti.svd(F)
        tau = ti.Matrix.zero(ti.f32, 3, 3)
        J = S[0, 0] * S[1, 1] * S[2, 2]
        I = ti.Matrix.identity(ti.f32, 3)
        if ti.static(self.law == COROTATED):
            tau = 2.0 * self.mu * (F - U @ V.transpose()) @ F.transpose() + self.lam * J * (J - 1.0) * I
        elif ti.static(self.law == NEO_HOOKEAN):
            tau = U @ (self.mu * S @ S + (self.lam * ti.log(J) - self.mu) * I) @ U.transpose()
        else:
            e = ti.Matrix.zero(ti.f32, 3, 3)
            for d in ti.static(range(3)):
                e[d, d] = ti.log(S[d, d])
            tau = U @ (2.0 * self.mu * e + self.lam * e.trace() * I) @ U.transpose()
        return tau

    @ti.func
    def flow(self, F):
        """Return mapping by singular values."""
        flowed = F
        if ti.static(self.law >= VON_MISES):
            U, S, V = ti.svd(F)
            e = ti.Vector([ti.log(S[0, 0]), ti.log(S[1, 1]), ti.log(S[2, 2])])
            mean = e.sum() / 3.0
            deviator = e - mean
            trial = 2.0 * self.mu * deviator.norm()
            if trial > self.limit:
                stress = self.limit
                if ti.static(self.law == VISCOPLASTIC):
                    stress = (self.viscosity * trial + self.mu * self.dt * self.limit) / (self.viscosity + self.mu * self.dt)
                new = ti.exp(mean + deviator * (stress / trial))
                flowed = U @ ti.Matrix([[new[0], 0.0, 0.0], [0.0, new[1], 0.0], [0.0, 0.0, new[2]]]) @ V.transpose()
        return flowed

    @ti.kernel
    def p2g(self):
        for p in self.x:
            base = (self.x[p] / self.dx - 0.5).cast(int)
            fx = self.x[p] / self.dx - base.cast(ti.f32)
            w = [0.5 * (1.5 - fx) ** 2, 0.75 - (fx - 1.0) ** 2, 0.5 * (fx - 0.5) ** 2]
            affine = self.mass * self.C[p] - (self.dt * self.volume * 4.0 / self.dx**2) * self.stress(self.F[p])
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                offset = ti.Vector([i, j, k])
                dpos = (offset.cast(ti.f32) - fx) * self.dx
                weight = w[i][0] * w[j][1] * w[k][2]
                self.grid_v[base + offset] += weight * (self.mass * (self.v[p] + self.dt * self.gravity) + affine @ dpos)
                self.grid_m[base + offset] += weight * self.mass

    @ti.kernel
    def grid_op(self):
        for i in ti.grouped(self.grid_m):
            if self.grid_m[i] > 0.0:
                self.grid_v[i] /= self.grid_m[i]

    @ti.kernel
    def g2p(self):
        for p in self.x:
            base = (self.x[p] / self.dx - 0.5).cast(int)
            fx = self.x[p] / self.dx - base.cast(ti.f32)
            w = [0.5 * (1.5 - fx) ** 2, 0.75 - (fx - 1.0) ** 2, 0.5 * (fx - 0.5) ** 2]
            new_v, new_C = ti.Vector.zero(ti.f32, 3), ti.Matrix.zero(ti.f32, 3, 3)
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                dpos = ti.Vector([i, j, k]).cast(ti.f32) - fx
                g_v = self.grid_v[base + ti.Vector([i, j, k])]
                weight = w[i][0] * w[j][1] * w[k][2]
                new_v += weight * g_v
                new_C += 4.0 / self.dx * weight * g_v.outer_product(dpos)
            self.v[p], self.C[p] = new_v, new_C
            self.x[p] += self.dt * new_v
            self.F[p] = self.flow((ti.Matrix.identity(ti.f32, 3) + self.dt * new_C) @ self.F[p])
