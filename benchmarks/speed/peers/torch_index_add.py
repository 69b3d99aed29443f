"""MLS-MPM in torch: `index_add_` for the scatter, indexing for the gather, `torch.linalg.svd` for every law."""

from __future__ import annotations

import math

import numpy as np
import torch

from .problem import LAWS, Problem


class TorchIndexAdd:
    """Runs a `problem.Problem`."""

    name = "torch"

    def __init__(self, problem: Problem) -> None:
        self.p = problem
        steps = torch.arange(3)
        self.corners = torch.stack(torch.meshgrid(steps, steps, steps, indexing="ij"), -1).reshape(27, 3)
        self.reset()

    def reset(self) -> None:
        """Back to the first state."""
        self.x, self.v, self.C, self.F = (torch.tensor(a, dtype=torch.float32) for a in (self.p.x, self.p.v, self.p.C, self.p.F))

    def positions(self) -> np.ndarray:
        """(N, 3)."""
        return self.x.numpy()

    def deformations(self) -> np.ndarray:
        """(N, 3, 3)."""
        return self.F.numpy()

    def stress(self, F: torch.Tensor) -> torch.Tensor:
        """Kirchhoff stress by singular values."""
        p, one = self.p, torch.eye(3)
        U, s, Vt = torch.linalg.svd(F)
        J = s.prod(-1)[:, None, None]
        if p.law_name == "corotated":
            return 2.0 * p.mu * (F - U @ Vt) @ F.mT + p.lam * J * (J - 1.0) * one
        if p.law_name == "neo_hookean":
            return U @ torch.diag_embed(p.mu * s * s) @ U.mT + (p.lam * J.log() - p.mu) * one
        e = s.log()
        return U @ torch.diag_embed(2.0 * p.mu * e + p.lam * e.sum(-1, keepdim=True)) @ U.mT

    def flow(self, F: torch.Tensor) -> torch.Tensor:
        """Return mapping by singular values."""
        p = self.p
        if p.law < LAWS.index("von_mises"):
            return F
        U, s, Vt = torch.linalg.svd(F)
        e = s.log()
        mean = e.mean(-1, keepdim=True)
        deviator = e - mean
        trial = 2.0 * p.mu * deviator.norm(dim=-1, keepdim=True)
        limit = math.sqrt(2.0 / 3.0) * p.yield_stress
        viscosity = p.viscosity if p.law_name == "viscoplastic" else 0.0
        stress = (viscosity * trial + p.mu * p.dt * limit) / (viscosity + p.mu * p.dt)
        share = torch.where(trial > limit, stress / trial, torch.ones_like(trial))
        return U @ torch.diag_embed(torch.exp(mean + share * deviator)) @ Vt

    def run(self, substeps: int) -> None:
        """Advance by that many substeps."""
        p, g = self.p, self.p.grid
        gravity = torch.tensor(p.gravity)
        for _ in range(substeps):
            local = self.x / p.dx
            base = (local - 0.5).long()
            f = local - base
            w = torch.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2], 1)
            i, j, k = self.corners.T
            weight = w[:, i, 0] * w[:, j, 1] * w[:, k, 2]
            at = base[:, None] + self.corners
            node = ((at[..., 0] * g + at[..., 1]) * g + at[..., 2]).reshape(-1)
            distance = (self.corners - f[:, None]) * p.dx
            affine = p.mass * self.C - (p.dt * p.volume * 4.0 / p.dx**2) * self.stress(self.F)
            momentum = p.mass * (self.v + p.dt * gravity)[:, None] + torch.einsum("nij,ncj->nci", affine, distance)
            grid = torch.zeros(g**3, 4)
            brought = torch.cat([momentum, torch.full((*momentum.shape[:2], 1), p.mass)], -1)
            grid.index_add_(0, node, (weight[..., None] * brought).reshape(-1, 4))
            velocity = grid[:, :3] / grid[:, 3:].clamp(min=1e-30)
            v_i = velocity[node].reshape(-1, 27, 3)
            self.v = (weight[..., None] * v_i).sum(1)
            self.C = 4.0 / p.dx**2 * torch.einsum("nci,ncj->nij", weight[..., None] * v_i, distance)
            self.x = self.x + p.dt * self.v
            self.F = self.flow(self.F + p.dt * self.C @ self.F)
