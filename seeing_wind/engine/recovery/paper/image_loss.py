"""The photometric loss (the paper's Table 3, "Image Loss"): Gaussians carried by the simulated particles, rendered, against the clip.

Rendering is the project's own differentiable splatting (`object/splatting`); derivatives reach positions and deformation gradients.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch

from ...errors import ObjectError
from ...look.gaussians import SH0, rest_covariances, view_camera
from ...look.splatting import Tiles, blend, project, tiles_of
from ...masks import Masks
from ...observe.clip.stored import Frames
from ...records import Camera, Gaussians
from .losses import Rider

PIXELS = 30_000
"""A crop of more pixels is reduced by an integer factor."""
MARGIN = 10
"""Pixels round the silhouettes of an interval's two frames."""
RENEW = 10
"""The tiles' lists are made anew after this many calls: the Gaussians have moved on."""
SMOOTH = 1.0 / 255.0
"""Colour differences below this count as squares."""


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
class _Crop:
    """What one frame is compared with, cut out and reduced."""

    camera: Camera
    target: torch.Tensor
    """(h, w, 3) in 0..1."""
    background: torch.Tensor
    change: float
    """Mean absolute difference from the frame before: the loss of a body that stays where it was."""
    tiles: Tiles | None = None
    calls: int = 0


class ImageLoss:
    """Mean absolute colour difference |I - pi(G)| in a crop round the object, divided by how much the frame changed.

    Args:
        frames: clip, silhouettes and Gaussians.
        dtype: float32, or float64 to check derivatives.

    Raises:
        ObjectError: for a clip in which the object is in no frame.
    """

    def __init__(self, filmed: Filmed, dtype: torch.dtype = torch.float32) -> None:
        if not filmed.masks[0].any():
            raise ObjectError("The object is not in the first frame.", "Check the mask.")
        self.filmed, self.dtype = filmed, dtype
        self.rider = Rider(filmed.gaussians.attachment)
        self.rest = torch.from_numpy(rest_covariances(filmed.gaussians)).to(dtype)
        self.opacity = torch.from_numpy(filmed.gaussians.opacity).to(dtype)
        self.colour = (0.5 + SH0 * torch.from_numpy(filmed.gaussians.sh[:, 0])).clamp(0.0, 1.0).to(dtype)
        self.crop: _Crop

    def begin(self, x: np.ndarray, frame: int) -> None:
        self.crop = self._crop(frame)

    def __call__(self, x: torch.Tensor, F: torch.Tensor) -> torch.Tensor:
        crop = self.crop
        centres, carried = self.rider.follow(x).to(self.dtype), self.rider.follow(F).to(self.dtype)
        spread = carried @ self.rest @ carried.transpose(1, 2)  # Sigma^t = F Sigma^0 F^T, Eq. (8)
        mean, flat, depth = project(centres, spread, crop.camera)
        width, height = crop.camera.width, crop.camera.height
        if crop.tiles is None or crop.calls % RENEW == 0:
            crop.tiles = tiles_of(mean, flat, depth, width, height)
        crop.calls += 1
        colour, alpha = blend(mean, flat, self.opacity, self.colour, crop.tiles, width, height)
        difference = colour + (1.0 - alpha)[..., None] * crop.background - crop.target
        return ((difference.square() + SMOOTH**2).sqrt() - SMOOTH).mean().double() / crop.change

    def _crop(self, frame: int) -> _Crop:
        """The part of `frame` in which the object is or was."""
        p = self.filmed
        either = p.masks[frame] | p.masks[frame - 1]
        where = either if either.any() else p.masks[0]
        rows, columns = np.flatnonzero(where.any(axis=1)), np.flatnonzero(where.any(axis=0))
        height, width = where.shape
        x0, y0 = max(int(columns[0]) - MARGIN, 0), max(int(rows[0]) - MARGIN, 0)
        x1, y1 = min(int(columns[-1]) + 1 + MARGIN, width), min(int(rows[-1]) + 1 + MARGIN, height)
        reduce = max(1, int(np.ceil(np.sqrt((x1 - x0) * (y1 - y0) / PIXELS))))
        camera = dataclasses.replace(view_camera(p.camera, (x0, y0, x1, y1), reduce), camera_to_world=p.camera.pose(frame))

        def cut(image: np.ndarray) -> np.ndarray:
            part = image[y0 : y0 + camera.height * reduce, x0 : x0 + camera.width * reduce].astype(np.float64) / 255.0
            return part.reshape(camera.height, reduce, camera.width, reduce, 3).mean(axis=(1, 3))

        target, before = cut(p.frames[frame]), cut(p.frames[frame - 1])
        change = float(np.abs(target - before).mean()) + 0.1 * SMOOTH
        return _Crop(camera, torch.from_numpy(target).to(self.dtype), torch.from_numpy(cut(p.background)).to(self.dtype), change)
