"""The paper's representation: a causal tri-plane f(x, t) = D(gamma(x) + phi(t; phi(t-1))), Eq. (3) of arXiv 2512.00762."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from .neural import ForceFieldNeural, NeuralModule
from .planes import Planes, Stencil, decoder

TRIPLANE_AXES = [(0, 1), (0, 2), (1, 2)]


WIDTH = 16
"""Width of the hidden layer of the time encoder."""


class CausalTimeEncoder(nn.Module):
    """phi: a small MLP from time to a feature vector, with its own weights in every frame.

    The weights of frame t are stored as a step from those of frame t - 1: theta_t = theta_(t-1) + step_t. Steps start at zero, so every
    frame starts from what its predecessor has learned, and inherits what the predecessor learns later: the paper's recursion, for all
    frames at once.
    """

    def __init__(self, frames: int, features: int) -> None:
        super().__init__()
        self.frames, self.features = frames, features
        first = torch.cat([0.5 * torch.randn(2 * WIDTH), torch.randn(features * WIDTH) / WIDTH**0.5, torch.zeros(features)])
        self.first = nn.Parameter(first)
        self.step = nn.Parameter(torch.zeros(frames - 1, len(first)))

    def codes(self) -> torch.Tensor:
        """phi of every frame, (T, features)."""
        theta = self.first + torch.cat([torch.zeros_like(self.first)[None], self.step.cumsum(dim=0)])
        slope, offset, out, bias = theta.split([WIDTH, WIDTH, self.features * WIDTH, self.features], dim=1)
        time = torch.linspace(-1, 1, self.frames, dtype=theta.dtype)[:, None] if self.frames > 1 else theta.new_zeros(1, 1)
        hidden = torch.tanh(slope * time + offset)
        return torch.einsum("tfw,tw->tf", out.view(self.frames, self.features, WIDTH), hidden) + bias

    def variation(self) -> torch.Tensor:
        """L_time = |theta_t - theta_(t-1)|, Eq. (15), as a mean square: the absolute value has a kink at zero, where the fit starts."""
        return self.step.square().sum(dim=1).mean() if self.frames > 1 else self.first.new_zeros(())


class CausalTriPlane(NeuralModule):
    """f(x, t) = D(gamma(x) + phi(t; phi(t-1))) in normalised coordinates and force.

    gamma sums three planes per resolution level, as EG3D does. EG3D interpolates linearly (degree 1); the default here is quadratic,
    because the simulator also applies the field's gradient, which jumps from cell to cell under linear interpolation.

    Args:
        frames: T.
        nodes: node count along x, y, z of each resolution level.
        features, width, hidden: length of a feature vector; width and number of the decoder's hidden layers.
        degree: of the interpolation, 1 or 2.
    """

    def __init__(
        self, frames: int, nodes: list[tuple[int, int, int]], features: int = 32, width: int = 128, hidden: int = 1, degree: int = 2
    ) -> None:
        super().__init__({"nodes": nodes, "features": features, "width": width, "hidden": hidden, "degree": degree})
        sizes = [(level[a], level[b]) for level in nodes for a, b in TRIPLANE_AXES]
        self.planes = Planes(TRIPLANE_AXES * len(nodes), sizes, features, degree)
        self.time = CausalTimeEncoder(frames, features)
        self.decoder = decoder(features, width, hidden)

    def stencil(self, s: torch.Tensor, frame: torch.Tensor) -> Stencil:
        return self.planes.stencil(s)

    def latent(self, stencil: Stencil, frame: torch.Tensor) -> torch.Tensor:
        return self.planes.summed(stencil) + self.time.codes()[frame]

    def roughness(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self.planes.total_variation(), self.time.variation()

    def rates(self) -> list[dict[str, Any]]:
        # a frame's weights are a sum of up to T steps, so the steps get a learning rate T times smaller than single weights could have
        return [
            {"params": self.planes.parameters(), "lr": 3e-2},
            {"params": self.time.parameters(), "lr": 0.35 / max(self.time.frames, 24)},
            {"params": self.decoder.parameters(), "lr": 1e-2},
        ]


class ForceFieldTriPlane(ForceFieldNeural):
    """The causal tri-plane as a force field."""

    representation = "causal_triplane"
    module_class = CausalTriPlane
