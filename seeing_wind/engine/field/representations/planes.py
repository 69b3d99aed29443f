"""Feature planes with B-spline interpolation: the building block of tri-planes and K-Planes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from scipy.sparse import csr_array
from torch import nn

Stencil = tuple[torch.Tensor, torch.Tensor]
"""Table rows (S, P, Q) int64 and weights (S, P, Q) of S points in P planes."""


def spline_weights(s: torch.Tensor, nodes: int, degree: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Nodes and weights of B-spline interpolation on `nodes` uniform nodes over 0..1.

    Args:
        s: (S,) coordinates, clamped to 0..1.
        nodes: at least degree + 1.
        degree: 1 (linear, as in EG3D) or 2 (quadratic, as on the simulator's grid; its gradient is continuous).

    Returns:
        index (S, degree + 1) int64 and weight (S, degree + 1), rows summing to one.
    """
    s = s.clamp(0.0, 1.0)
    if degree == 1:
        u = s * (nodes - 1)
        first = u.detach().floor().long().clamp(0, nodes - 2)
        fraction = u - first
        weight = torch.stack([1 - fraction, fraction], dim=-1)
    else:
        u = 0.5 + s * (nodes - 2)
        first = (u.detach() - 0.5).floor().long().clamp(0, nodes - 3)
        fraction = u - first
        weight = torch.stack([0.5 * (1.5 - fraction) ** 2, 0.75 - (fraction - 1) ** 2, 0.5 * (fraction - 0.5) ** 2], dim=-1)
    return first[:, None] + torch.arange(degree + 1), weight


class _Gathered(torch.autograd.Function):
    """Rows of a table (nodes, features), weighted and summed for each of S points: `torch.nn.functional.embedding_bag` with a faster
    backward pass. Its own sorts all rows of every batch, which took a third of a fit's time."""

    @staticmethod
    def forward(ctx: Any, table: torch.Tensor, rows: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
        """table (nodes, features), rows (S, Q) int64 and weights (S, Q) -> (S, features)."""
        ctx.save_for_backward(table, rows, weights)
        return nn.functional.embedding_bag(rows, table, mode="sum", per_sample_weights=weights)

    @staticmethod
    def backward(ctx: Any, *slopes: torch.Tensor) -> tuple[torch.Tensor | None, None, torch.Tensor | None]:
        """d loss / d output (S, features) -> d loss / d table and d loss / d weights, where needed. The output is A table, with the sparse
        matrix A (S, nodes) of weights, so the former is A^T d loss / d output."""
        table, rows, weights = ctx.saved_tensors
        (slope,) = slopes
        of_table = of_weights = None
        if ctx.needs_input_grad[0]:
            first = np.arange(0, rows.numel() + 1, rows.shape[1])
            gather = csr_array((weights.detach().flatten().numpy(), rows.flatten().numpy(), first), shape=(len(rows), len(table)))
            of_table = torch.from_numpy(gather.T @ slope.numpy())
        if ctx.needs_input_grad[2]:
            of_weights = (table[rows] @ slope[:, :, None])[..., 0]
        return of_table, None, of_weights


def _gathered(table: torch.Tensor, rows: torch.Tensor, weights: torch.Tensor) -> torch.Tensor:
    found: torch.Tensor = _Gathered.apply(table, rows, weights)
    return found


class Planes(nn.Module):
    """Feature planes over pairs of axes, stacked in one table so that a look-up is one gather.

    Args:
        axes: the pair of axes of each plane, for example (0, 1).
        nodes: for each plane, the node count along its two axes.
        features: length of a node's feature vector.
        degree: of the splines; see `spline_weights`.
        start, spread: features are initialised as start + spread * normal noise.
    """

    def __init__(
        self, axes: list[tuple[int, int]], nodes: list[tuple[int, int]], features: int, degree: int, start: float = 0.0, spread: float = 0.1
    ) -> None:
        super().__init__()
        self.axes, self.nodes, self.degree = axes, nodes, degree
        sizes = [math.prod(pair) for pair in nodes]
        self.offset = [sum(sizes[:plane]) for plane in range(len(sizes) + 1)]
        self.table = nn.Parameter(start + spread * torch.randn(self.offset[-1], features))

    def stencil(self, s: torch.Tensor) -> Stencil:
        """Coordinates (S, A) in 0..1 -> the nodes that each point depends on, Q = (degree + 1)² per plane, and their weights."""
        rows, weights = [], []
        for (a, b), (nodes_a, nodes_b), offset in zip(self.axes, self.nodes, self.offset):
            index_a, weight_a = spline_weights(s[:, a], nodes_a, self.degree)
            index_b, weight_b = spline_weights(s[:, b], nodes_b, self.degree)
            rows.append((offset + index_a[:, :, None] * nodes_b + index_b[:, None, :]).flatten(1))
            weights.append((weight_a[:, :, None] * weight_b[:, None, :]).flatten(1))
        return torch.stack(rows, dim=1), torch.stack(weights, dim=1)

    def summed(self, stencil: Stencil) -> torch.Tensor:
        """Features (S, features), summed over the planes as in EG3D."""
        rows, weights = stencil
        return _gathered(self.table, rows.flatten(1), weights.flatten(1))

    def multiplied(self, stencil: Stencil) -> torch.Tensor:
        """Features (S, features), multiplied over the planes as in K-Planes."""
        rows, weights = stencil
        count = rows.shape[1]
        bags = _gathered(self.table, rows.flatten(0, 1), weights.flatten(0, 1))
        return bags.view(len(rows), count, -1).prod(dim=1)

    def total_variation(self) -> torch.Tensor:
        """Mean squared difference of neighbouring nodes, summed over planes (L_space of Eq. (14), after K-Planes)."""
        total = self.table.new_zeros(())
        for plane, (nodes_a, nodes_b) in enumerate(self.nodes):
            values = self.table[self.offset[plane] : self.offset[plane + 1]].view(nodes_a, nodes_b, -1)
            total = total + values.diff(dim=0).square().mean() + values.diff(dim=1).square().mean()
        return total


def decoder(features: int, width: int, hidden: int) -> nn.Sequential:
    """MLP features -> `hidden` layers of `width` -> 3 with smooth activations; the last layer starts at zero, and with it the force."""
    layers: list[nn.Module] = []
    for layer in range(hidden):
        layers += [nn.Linear(features if layer == 0 else width, width), nn.SiLU()]
    last = nn.Linear(width, 3)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(*layers, last)
