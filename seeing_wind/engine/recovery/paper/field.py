"""The force as a function that gradient descent optimises: from parameters to the particles' acceleration and its gradient, frame by frame.

These are the three representations of the paper's Table 2. The paper gives no sizes: planes of 24 nodes per axis and a learning rate of
1e-2 for Adam are those of the closest published work (PhysDreamer, Zhang et al. 2024, with two authors in common). Its decoder, with three
layers of 64, took twice the iterations and ended at three times the error of one layer of 128, which is used here and in the stored field.
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
"""Adam's learning rate for single vectors, which have no decoder to amplify a step."""
SPACE_WEIGHT, TIME_WEIGHT = 1e-3, 1e-2
"""lambda_1 and lambda_2 of Eq. (14), for a misfit scaled so that it is 1 without any force."""
OFFSET = 0.25
"""Step of the finite differences for the field's gradient, in particle spacings."""


class DescentField:
    """A representation of the normalised force in the box of all motion, of which each frame may change a certain part."""

    rate = RATE

    def begin(self, frame: int, x: np.ndarray) -> None:
        """Move on to `frame`, at whose start the particles are at x (N, 3) [m]."""
        raise NotImplementedError

    def acceleration(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Acceleration a (N, 3) [m/s²] and its gradient d a_i / d x_j (N, 3, 3) [1/s²] in the current frame, float64."""
        raise NotImplementedError

    def roughness(self) -> torch.Tensor:
        """lambda_1 L_space + lambda_2 L_time of Eq. (14) for the current frame."""
        raise NotImplementedError

    def parameters(self) -> list[nn.Parameter]:
        """The parameters that the current frame optimises."""
        raise NotImplementedError

    def confine(self) -> None:
        """After a backward pass: drop the gradients of parameters that belong to other frames."""


class PlaneField(DescentField):
    """The causal tri-plane or K-planes.

    The planes and the decoder are shared by all frames and optimised in each. Of the causal tri-plane's time encoder only the current
    frame's weights are optimised, starting from those of the frame before (a step of zero), Eq. (3).
    """

    def __init__(self, representation: str, frames: int, box: np.ndarray, spacing: float, scale: float) -> None:
        """`box` (2, 3) [m] contains all motion; `scale` [m/s²] is the acceleration at a normalised force of 1."""
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
        """Drop the gradients of all time-encoder weights but the current frame's (paper, Eq. (3)); K-planes are left as they are."""
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
    """(7 N, 3) [m]: the points x (N, 3), then these shifted by +step and by -step [m] along each axis, for `quotient`."""
    offsets = step * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    return (x[None] + offsets[:, None]).reshape(-1, 3)


def quotient(values: torch.Tensor, step: float) -> tuple[torch.Tensor, torch.Tensor]:
    """From values (7 N, 3) at the points of a `star`: the values at x (N, 3) and their gradient d value_i / d x_j (N, 3, 3) [per metre]."""
    parts = values.view(7, -1, 3)
    slope = (parts[1:4] - parts[4:]) / (2.0 * step)
    return parts[0], slope.permute(1, 2, 0).contiguous()


class PointFieldOfFrame(DescentField):
    """One force vector per particle and frame, independent of its neighbours and of the frame before."""

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
    """The field for `representation` causal_triplane, kplanes or point; the other arguments are as for `PlaneField`."""
    if representation == "point":
        return PointFieldOfFrame(scale)
    return PlaneField(representation, frames, box, spacing, scale)
