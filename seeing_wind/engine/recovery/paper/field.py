"""The force as gradient descent sees it: parameters in, acceleration on the particles and its gradient out, one frame at a time.

The three representations of the paper's Table 2. The paper gives no sizes: planes of 24 nodes and Adam at 1e-2 are those of the closest
published work (PhysDreamer, Zhang et al. 2024, with two authors in common). Its decoder of three layers of 64 took twice the iterations
to three times the error of one layer of 128, which is what the stored field has too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import nn

from ...field.representations.kplanes import KPlanes
from ...field.representations.neural import NeuralModule
from ...field.representations.planes import Stencil
from ...field.representations.triplane import CausalTriPlane

NODES = (24, 24, 24)
FEATURES, WIDTH, HIDDEN = 32, 128, 1
RATE = 1e-2
POINT_RATE = 0.1
"""Adam's rate for single vectors, which have no decoder to multiply a step."""
SPACE_WEIGHT, TIME_WEIGHT = 1e-3, 1e-2
"""lambda_1 and lambda_2 of Eq. (14), for a misfit that is one without any force."""
OFFSET = 0.25
"""Step of the difference quotient for the field's gradient, in particle spacings."""


class DescentField:
    """A representation over the swept box, normalised, with the part of it that one frame may change."""

    rate = RATE

    def begin(self, frame: int, x: np.ndarray) -> None:
        """Go on to `frame`, whose particles start at x (N, 3) [m]."""
        raise NotImplementedError

    def acceleration(self) -> tuple[torch.Tensor, torch.Tensor]:
        """(N, 3) [m/s²] and d a_i / d x_j (N, 3, 3) [1/s²] in the current frame, float64."""
        raise NotImplementedError

    def roughness(self) -> torch.Tensor:
        """lambda_1 L_space + lambda_2 L_time of Eq. (14) for the current frame."""
        raise NotImplementedError

    def parameters(self) -> list[nn.Parameter]:
        """What the current frame learns."""
        raise NotImplementedError

    def confine(self) -> None:
        """After a backward sweep: forget derivatives by what belongs to other frames."""


class PlaneField(DescentField):
    """The causal tri-plane or K-planes.

    The planes and the decoder serve all frames and go on learning. Of the causal tri-plane's time encoder only the current frame's
    weights learn: they start from those of the frame before (a step of zero), Eq. (3).
    """

    def __init__(self, representation: str, frames: int, box: np.ndarray, spacing: float, scale: float) -> None:
        """`box` (2, 3) [m] holds all motion; `scale` [m/s²] is the acceleration of a normalised force of one."""
        options: dict[str, Any] = {"features": FEATURES, "width": WIDTH, "hidden": HIDDEN}
        causal = representation == "causal_triplane"
        self.module: NeuralModule = CausalTriPlane(frames, [NODES], **options) if causal else KPlanes(frames, NODES, **options)
        self.box, self.step, self.scale = box, OFFSET * spacing, scale
        self.frame, self.count = 0, 0
        self.stencil: Stencil
        self.index: torch.Tensor

    def begin(self, frame: int, x: np.ndarray) -> None:
        points = star(x, self.step)
        s = torch.from_numpy((points - self.box[0]) / (self.box[1] - self.box[0])).float()
        self.frame, self.count = frame, len(x)
        self.index = torch.full((len(points),), frame)
        self.stencil = self.module.stencil(s, self.index)

    def acceleration(self) -> tuple[torch.Tensor, torch.Tensor]:
        values = self.scale * self.module.decoder(self.module.latent(self.stencil, self.index)).double()
        return quotient(values, self.step)

    def roughness(self) -> torch.Tensor:
        total = SPACE_WEIGHT * self.module.roughness()[0]
        if isinstance(self.module, CausalTriPlane) and self.frame:
            total = total + TIME_WEIGHT * self.module.time.step[self.frame - 1].abs().mean()  # Eq. (15)
        return total

    def parameters(self) -> list[nn.Parameter]:
        return list(self.module.parameters())

    def confine(self) -> None:
        """Between backward and step: of the time encoder only the current frame's weights learn (paper, Eq. (3)).

        The gradients of all other frames' weights are dropped; the other representations have nothing to confine.
        """
        if not isinstance(self.module, CausalTriPlane):
            return
        time = self.module.time
        if self.frame == 0:
            time.step.grad = None
            return
        time.first.grad = None
        assert time.step.grad is not None
        own = time.step.grad[self.frame - 1].clone()
        time.step.grad.zero_()
        time.step.grad[self.frame - 1] = own


def star(x: np.ndarray, step: float) -> np.ndarray:
    """Points x (N, 3) [m] and those a step before and behind them along each axis, (7 N, 3), for `quotient`."""
    offsets = step * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    return (x[None] + offsets[:, None]).reshape(-1, 3)


def quotient(values: torch.Tensor, step: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Values at the points of a `star` (7 N, 3) -> those at x (N, 3) and their gradient (N, 3, 3), d value_i / d x_j per metre."""
    parts = values.view(7, -1, 3)
    slope = (parts[1:4] - parts[4:]) / (2.0 * step)
    return parts[0], slope.permute(1, 2, 0).contiguous()


class PointFieldOfFrame(DescentField):
    """One vector per particle and frame: nothing ties it to its neighbours or to the frame before."""

    rate = POINT_RATE

    def __init__(self, scale: float) -> None:
        self.scale = scale
        self.force: nn.Parameter

    def begin(self, frame: int, x: np.ndarray) -> None:
        self.force = nn.Parameter(torch.zeros(len(x), 3, dtype=torch.float64))

    def acceleration(self) -> tuple[torch.Tensor, torch.Tensor]:
        return self.scale * self.force, torch.zeros(len(self.force), 3, 3, dtype=torch.float64)

    def roughness(self) -> torch.Tensor:
        return torch.zeros((), dtype=torch.float64)

    def parameters(self) -> list[nn.Parameter]:
        return [self.force]


def descent_field(representation: str, frames: int, box: np.ndarray, spacing: float, scale: float) -> DescentField:
    """causal_triplane, kplanes or point; arguments as for `PlaneField`."""
    if representation == "point":
        return PointFieldOfFrame(scale)
    return PlaneField(representation, frames, box, spacing, scale)
