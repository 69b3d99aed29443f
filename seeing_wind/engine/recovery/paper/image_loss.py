"""The photometric loss (the paper's Table 3, "Image Loss"): Gaussians carried by the simulated particles are rendered and compared with
the clip.

Rendering is the project's own differentiable splatting (`look/splatting`); the loss has derivatives with respect to the particles'
positions and deformation gradients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from ...errors import ObjectError
from ...look.gaussians import SH0, Crop, rest_covariances
from ...look.splatting import Tiles, blend, project, tiles_of
from ...masks import Masks
from ...observe.clip.stored import Frames
from ...records import Camera, Gaussians
from .losses import Rider

PIXELS = 30_000
"""A crop with more pixels than this is reduced by an integer factor."""
MARGIN = 10
"""Margin [px] around the masks of an interval's two frames."""
RENEW = 10
"""The lists of Gaussians per tile are rebuilt after this many calls, as the Gaussians have moved by then."""
SMOOTH = 1.0 / 255.0
"""Below this, colour differences are smoothed to be quadratic."""


@dataclass(frozen=True)
class Filmed:
    """What one camera filmed."""

    frames: Frames
    """(T+1, H, W, 3) uint8 RGB."""
    masks: Masks
    """(T+1, H, W) bool, the object."""
    background: np.ndarray
    """(H, W, 3) uint8 RGB, without the object."""
    camera: Camera
    gaussians: Gaussians


@dataclass
class _Target:
    """What the rendering of one frame is compared with, cropped and reduced."""

    camera: Camera
    image: torch.Tensor
    """(h, w, 3) in 0..1."""
    background: torch.Tensor
    change: float
    """Mean absolute difference from the frame before: the loss of a body that stays where it was."""
    tiles: Tiles | None = None
    calls: int = 0


class ImageLoss:
    """Mean absolute colour difference |I - pi(G)| in a crop around the object, divided by that between the frame and the one before.

    It is 0 in a frame that does not show the object if the frame before does not either, as there is nothing to compare then.

    Args:
        dtype: float32, or float64 to check derivatives.

    Raises:
        ObjectError: the object is not in the first frame.
    """

    def __init__(self, filmed: Filmed, dtype: torch.dtype = torch.float32) -> None:
        if not filmed.masks[0].any():
            raise ObjectError("The object is not in the first frame.", "Check the mask.")
        self.filmed, self.dtype = filmed, dtype
        self.rider = Rider(filmed.gaussians.attachment)
        self.rest = torch.from_numpy(rest_covariances(filmed.gaussians)).to(dtype)
        self.opacity = torch.from_numpy(filmed.gaussians.opacity).to(dtype)
        self.colour = (0.5 + SH0 * torch.from_numpy(filmed.gaussians.sh[:, 0])).clamp(0.0, 1.0).to(dtype)
        self.target: _Target | None

    def begin(self, x: np.ndarray, frame: int) -> None:
        self.target = self._target(frame)

    def __call__(self, x: torch.Tensor, F: torch.Tensor) -> torch.Tensor:
        target = self.target
        if target is None:
            return 0.0 * x.sum()
        centres, carried = self.rider.follow(x).to(self.dtype), self.rider.follow(F).to(self.dtype)
        spread = carried @ self.rest @ carried.transpose(1, 2)  # Sigma^t = F Sigma^0 F^T, Eq. (8)
        mean, flat, depth = project(centres, spread, target.camera)
        width, height = target.camera.width, target.camera.height
        if target.tiles is None or target.calls % RENEW == 0:
            target.tiles = tiles_of(mean, flat, depth, width, height)
        target.calls += 1
        colour, alpha = blend(mean, flat, self.opacity, self.colour, target.tiles, width, height)
        difference = colour + (1.0 - alpha)[..., None] * target.background - target.image
        return ((difference.square() + SMOOTH**2).sqrt() - SMOOTH).mean().double() / target.change

    def _target(self, frame: int) -> _Target | None:
        """The part of `frame` that shows the object or showed it in the frame before; None if neither frame shows it."""
        p = self.filmed
        either = p.masks[frame] | p.masks[frame - 1]
        if not either.any():
            return None
        crop = Crop.around(either, p.camera, frame, MARGIN, PIXELS)
        target, before, behind = (
            crop.reduced(crop.cut(one).astype(np.float64) / 255.0) for one in (p.frames[frame], p.frames[frame - 1], p.background)
        )
        change = float(np.abs(target - before).mean()) + 0.1 * SMOOTH
        return _Target(crop.camera, torch.from_numpy(target).to(self.dtype), torch.from_numpy(behind).to(self.dtype), change)
