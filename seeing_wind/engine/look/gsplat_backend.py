"""The same frame of Gaussians by gsplat (Ye et al. 2024), a CUDA rasteriser, where it is installed and a GPU is there."""

from __future__ import annotations

import functools
import importlib.util
from typing import Any

import torch

from ..records import Camera


@functools.cache
def usable() -> bool:
    """Whether CUDA and gsplat are both there."""
    return importlib.util.find_spec("gsplat") is not None and torch.cuda.is_available()


def draw(
    x: torch.Tensor, covariance: torch.Tensor, opacity: torch.Tensor, colour: torch.Tensor, camera: Camera, frame: int, near: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Premultiplied colour (H, W, 3) and alpha (H, W), differentiable in all Gaussians' arguments, on their device.

    Args:
        x: (G, 3) [m]; covariance: (G, 3, 3) [m²]; opacity: (G,); colour: (G, 3); near: metres within which nothing is drawn.
    """
    import gsplat

    device = x.device
    pose = torch.as_tensor(camera.pose(frame), dtype=torch.float32)
    view = torch.linalg.inv(pose)
    # gsplat's pixels have their centres at halves.
    k = torch.tensor([[camera.fx, 0.0, camera.cx + 0.5], [0.0, camera.fy, camera.cy + 0.5], [0.0, 0.0, 1.0]])
    arguments: dict[str, Any] = {"near_plane": near, "eps2d": 0.3, "packed": False}
    image, alpha, _ = gsplat.rasterization(
        means=x.cuda(),
        quats=None,
        scales=None,
        covars=covariance.cuda(),
        opacities=opacity.cuda(),
        colors=colour.cuda(),
        viewmats=view.cuda()[None],
        Ks=k.cuda()[None],
        width=camera.width,
        height=camera.height,
        **arguments,
    )
    return image[0].to(device), alpha[0, ..., 0].to(device)
