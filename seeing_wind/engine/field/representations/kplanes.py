"""K-Planes (Fridovich-Keil et al., CVPR 2023) as a force field: six planes over space and time, multiplied. A comparison, Table 2."""

from __future__ import annotations

from typing import Any

import torch

from .neural import ForceFieldNeural, NeuralModule
from .planes import Planes, Stencil, decoder

KPLANES_AXES = [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3)]
"""Axis 3 is time."""


class KPlanes(NeuralModule):
    """f(x, t) = D(product of six planes' features); arguments as for `CausalTriPlane`, with one resolution level.

    Planes start near one, so that a plane over time that has not learned anything has no effect.
    """

    def __init__(self, frames: int, nodes: tuple[int, int, int], features: int = 32, width: int = 128, hidden: int = 1, degree: int = 2):
        super().__init__({"nodes": nodes, "features": features, "width": width, "hidden": hidden, "degree": degree})
        self.frames = frames
        along = (*nodes, max(frames, 3))
        self.planes = Planes(KPLANES_AXES, [(along[a], along[b]) for a, b in KPLANES_AXES], features, degree, start=1.0, spread=0.2)
        self.decoder = decoder(features, width, hidden)

    def stencil(self, s: torch.Tensor, frame: torch.Tensor) -> Stencil:
        time = frame.to(s.dtype)[:, None] / max(self.frames - 1, 1)
        return self.planes.stencil(torch.cat([s, time], dim=1))

    def latent(self, stencil: Stencil, frame: torch.Tensor) -> torch.Tensor:
        return self.planes.multiplied(stencil)

    def roughness(self) -> tuple[torch.Tensor, torch.Tensor]:
        # the total variation covers time, too
        return self.planes.total_variation(), self.planes.table.new_zeros(())

    def rates(self) -> list[dict[str, Any]]:
        return [{"params": self.planes.parameters(), "lr": 3e-2}, {"params": self.decoder.parameters(), "lr": 1e-2}]


class ForceFieldKPlanes(ForceFieldNeural):
    """K-Planes as a force field."""

    representation = "kplanes"
    module_class = KPlanes
