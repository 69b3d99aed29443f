"""The look of the Gaussians in frame 0: scales, opacities and colours fitted by splatting to one or several posed frames (section 3.1)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from ..field.optimisers import Adam
from ..field.torch_threads import one_torch_thread
from ..observe.object import Built, SheetBuilt
from ..observe.object.shape.relief import clean_mask
from ..progress import Progress
from ..records import Body, Camera, Gaussians, Observation
from .covering import cover_bare_surface, joined
from .gaussians import SH0, Crop, axes_of, pixel_aligned
from .splatting import Tiles, blend, project, tiles_of

POOR_LOOK = 25.0
"""PSNR [dB] below which the user is warned that the Gaussians do not reproduce the object well."""
FIT_PIXELS = 60_000
"""A mask's box with more pixels is reduced by an integer factor for the fit."""
MARGIN = 4
"""Pixels around the mask's box that are fitted, too, so that Gaussians do not bleed over the outline."""
ITERATIONS = 40
RENEW = 15
"""The tiles' lists are rebuilt after this many iterations, because scales have changed."""
LEARNING_RATES = {"scale": 0.06, "opacity": 0.1, "sh": 0.08}
"""Adam's learning rates for the logarithm of the scale, the logit of the opacity and the degree-0 harmonics."""
FIRST = 4.0
"""Weight of the first of several frames: the object is put back into the clip of its camera."""
ALPHA_WEIGHT = 0.2
"""Weight of the silhouette's squared error relative to that of the colours."""


def dress(built: Built | SheetBuilt, observation: Observation, progress: Progress) -> Body:
    """The body with Gaussians fitted to frame 0 of the clip."""
    rough = pixel_aligned(built.relief, observation.image, built.particles.x)
    view = View(built.relief.camera, built.relief.mask, observation.image, observation.background)
    gaussians, quality = fit(rough, [view], progress)
    if quality < POOR_LOOK:
        progress.warn(f"The Gaussians reproduce the object with only {quality:.1f} dB; forces do not depend on them.")
    progress.update(1.0, f"{len(gaussians.x)} Gaussians, {quality:.1f} dB", psnr=round(quality, 2))
    return built.body(gaussians)


@dataclass(frozen=True)
class View:
    """The object in frame 0 of one camera."""

    camera: Camera
    mask: np.ndarray
    """(H, W) bool."""
    image: np.ndarray
    """(H, W, 3) uint8 RGB."""
    behind: np.ndarray
    """(H, W, 3) uint8 RGB, the background alone, with which pixels of the outline are blended."""


@one_torch_thread()
def fit(gaussians: Gaussians, views: Sequence[View], progress: Progress, iterations: int = ITERATIONS) -> tuple[Gaussians, float]:
    """Optimise {Sigma^0, sigma, SH} by splatting (paper, section 3.1): scales, opacities and colours, by Adam.

    Args:
        views: frames of several posed cameras at the same moment; only the masks' boxes are rendered.

    Returns:
        the Gaussians and their PSNR inside the first view's mask [dB], rendered over the background.
    """
    targets = [_target(view) for view in views]
    axes = torch.from_numpy(axes_of(gaussians)).float()
    x = torch.from_numpy(gaussians.x).float()
    limit = torch.log(torch.from_numpy(gaussians.scale).float()) + float(np.log(4.0))
    scale = torch.log(torch.from_numpy(gaussians.scale).float()).requires_grad_()
    opacity = torch.logit(torch.from_numpy(gaussians.opacity).float(), eps=1e-4).requires_grad_()
    sh = torch.from_numpy(gaussians.sh[:, 0]).float().requires_grad_()
    optimiser = Adam(
        [
            {"params": [scale], "lr": LEARNING_RATES["scale"]},
            {"params": [opacity], "lr": LEARNING_RATES["opacity"]},
            {"params": [sh], "lr": LEARNING_RATES["sh"]},
        ],
        betas=(0.9, 0.99),
    )
    decay = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, max(iterations, 1), eta_min=0.0)

    def render(camera: Camera, renew: Tiles | None) -> tuple[torch.Tensor, torch.Tensor, Tiles]:
        stretched = axes * torch.exp(scale)[:, None, :]
        mean, flat, depth = project(x, stretched @ stretched.transpose(1, 2), camera)
        tiles = renew or tiles_of(mean, flat, depth, camera.width, camera.height)
        return *blend(mean, flat, torch.sigmoid(opacity), 0.5 + SH0 * sh, tiles, camera.width, camera.height), tiles

    tiles: list[Tiles | None] = [None] * len(targets)
    quality = 0.0
    for iteration in range(iterations):
        optimiser.zero_grad()
        for number, (camera, target, behind, cover) in enumerate(targets):
            colour, alpha, tiles[number] = render(camera, None if iteration % RENEW == 0 else tiles[number])
            error = ((colour + (1.0 - alpha)[..., None] * behind - target) ** 2).mean(dim=-1)
            weight = FIRST if number == 0 else 1.0
            loss = weight * (error.mean() + ALPHA_WEIGHT * ((alpha - cover) ** 2).mean()) / (FIRST + len(targets) - 1)
            loss.backward()
            quality = _psnr(error.detach(), cover) if number == 0 else quality
        optimiser.step()
        decay.step()
        with torch.no_grad():
            scale.copy_(torch.minimum(scale, limit))
        progress.update(iteration / iterations, f"fitting the look, {quality:.1f} dB", psnr=round(quality, 2))
    with torch.no_grad():
        camera, target, behind, cover = targets[0]
        colour, alpha, _ = render(camera, None)
        quality = _psnr(((colour + (1.0 - alpha)[..., None] * behind - target) ** 2).mean(dim=-1), cover)
    fitted = dataclasses.replace(
        gaussians,
        scale=np.exp(scale.detach().double().numpy()),
        opacity=torch.sigmoid(opacity.detach().double()).numpy(),
        sh=sh.detach().double().numpy()[:, None],
    )
    return fitted, quality


def _psnr(error: torch.Tensor, cover: torch.Tensor) -> float:
    """Peak signal to noise ratio [dB] over the pixels that the object covers fully."""
    inside = cover > 0.999
    mean = float(error[inside].mean()) if bool(inside.any()) else float(error.mean())
    return float(-10.0 * np.log10(max(mean, 1e-10)))


def _target(view: View) -> tuple[Camera, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Camera, object over background (h, w, 3), background (h, w, 3) and coverage (h, w) in the mask's box, reduced by block means."""
    crop = Crop.around(view.mask, view.camera, 0, MARGIN, FIT_PIXELS)
    cover = crop.cut(view.mask).astype(np.float32)[..., None]
    behind = crop.cut(view.behind).astype(np.float32) / 255.0
    # Outside the object the target is the background itself: other differences from it, such as shadows, are not for the Gaussians.
    target = cover * crop.cut(view.image).astype(np.float32) / 255.0 + (1.0 - cover) * behind
    shown, plain, covered = (torch.from_numpy(crop.reduced(part)) for part in (target, behind, cover))
    return crop.camera, shown, plain, covered[..., 0]


def with_views(body: Body, first: Observation, further: Sequence[Observation], progress: Progress) -> Body:
    """The body, built from the first view, with Gaussians for everything that frame 0 of any view shows, fitted to all views.

    Raises:
        ObjectError: a further view whose mask is empty.
    """
    views = [View(one.camera, clean_mask(one.masks[0]), one.image, one.background) for one in (first, *further)]
    gaussians = body.gaussians
    for view in views[1:]:
        gaussians = joined(gaussians, cover_bare_surface(body, gaussians, view.camera, view.mask, view.image))
    return dataclasses.replace(body, gaussians=fit(gaussians, views, progress)[0])
