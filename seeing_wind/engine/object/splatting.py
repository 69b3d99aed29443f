"""A small differentiable rasteriser of 3D Gaussians on the CPU, and the fit of their look to picture 0.

Projection and blending as in Kerbl et al., 3D Gaussian splatting (2023), after Zwicker et al., EWA volume splatting (2001): covariances are
projected with the Jacobian of the perspective, widened by a pixel filter, and blended front to back. Tiles of the picture are
rendered as one batch, each with its own depth-sorted list padded to the longest.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from ..progress import NoProgress, Progress
from ..records import Camera, Gaussians
from . import gsplat_backend
from .gaussians import SH0, covariances, rest_covariances, view_camera
from .harmonics import seen_colours
from .relief import Relief

TILE = 8
"""Side of a tile [px]."""
PIXEL_FILTER = 0.3
"""Variance of the filter that keeps a Gaussian at least about a pixel wide [px²]; the value of the reference implementation."""
CUTOFF = 2.5
"""A Gaussian reaches this many standard deviations: 4 % of its peak; more costs time and changes no decibel."""
MAX_ALPHA = 0.99
NEAR = 1e-3
"""Gaussians nearer to the camera than this are not drawn [m]."""
FIT_PIXELS = 60_000
"""A mask's box of more pixels is reduced by an integer factor for the fit."""
MARGIN = 4
"""Pixels round the mask's box that the fit sees, so that Gaussians do not bleed over the outline."""
ITERATIONS = 40
RENEW = 15
"""The tiles' lists are made anew after this many iterations, as scales have changed."""
LEARNING_RATES = {"scale": 0.06, "opacity": 0.1, "sh": 0.08}
"""Adam's, for the logarithm of the scale, the logit of the opacity and the degree-0 harmonics."""
FIRST = 4.0
"""Weight of the first of several pictures: its camera's clip is what the object is put back into."""
ALPHA_WEIGHT = 0.2
"""Weight of the silhouette's squared error against the colours'."""


@dataclass(frozen=True)
class Tiles:
    """Which Gaussians a tile blends, nearest first."""

    index: torch.Tensor
    """(M, L) numbers of Gaussians, padded with 0."""
    used: torch.Tensor
    """(M, L, 1) 1 where not padding."""
    pixels: torch.Tensor
    """(M, P, 2) pixel centres of the tile."""
    across: int
    """Tiles per row of the picture; `down` per column."""
    down: int


def project(x: torch.Tensor, covariance: torch.Tensor, camera: Camera, frame: int = 0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Gaussians (G, 3), (G, 3, 3) -> means (G, 2) [px], covariances (G, 2, 2) [px²] with the pixel filter, depths (G,) [m]."""
    pose = torch.as_tensor(camera.pose(frame), dtype=x.dtype)
    local = (x - pose[:3, 3]) @ pose[:3, :3]
    depth = local[:, 2].clamp_min(NEAR)
    mean = torch.stack([camera.fx * local[:, 0] / depth + camera.cx, camera.fy * local[:, 1] / depth + camera.cy], dim=1)
    zero = torch.zeros_like(depth)
    rows = torch.stack([camera.fx / depth, zero, -camera.fx * local[:, 0] / depth**2], dim=1)
    columns = torch.stack([zero, camera.fy / depth, -camera.fy * local[:, 1] / depth**2], dim=1)
    jacobian = torch.stack([rows, columns], dim=1) @ pose[:3, :3].T
    flat = jacobian @ covariance @ jacobian.transpose(1, 2) + PIXEL_FILTER * torch.eye(2, dtype=x.dtype)
    return mean, flat, local[:, 2]


def tiles_of(mean: torch.Tensor, covariance: torch.Tensor, depth: torch.Tensor, width: int, height: int) -> Tiles:
    """Lists of the Gaussians that reach each tile of a picture."""
    across, down = -(-width // TILE), -(-height // TILE)
    reach = CUTOFF * np.sqrt(np.maximum(np.linalg.eigvalsh(covariance.detach().numpy())[:, -1], 0.0))
    centre, far = mean.detach().numpy(), depth.detach().numpy()
    first = np.floor((centre - reach[:, None] + 0.5) / TILE).astype(int)
    last = np.floor((centre + reach[:, None] + 0.5) / TILE).astype(int)
    first = np.clip(first, 0, None)
    last = np.minimum(last, [across - 1, down - 1])
    spans = np.maximum(last - first + 1, 0)
    covers = np.where(far > NEAR, spans.prod(axis=1), 0)
    owner = np.repeat(np.arange(len(covers)), covers)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(covers) - covers, covers)
    tile = (first[owner, 1] + within // spans[owner, 0]) * across + first[owner, 0] + within % spans[owner, 0]
    order = np.lexsort((far[owner], tile))
    owner, tile = owner[order], tile[order]
    lengths = np.bincount(tile, minlength=across * down)
    place = np.arange(len(tile)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    index = np.zeros((across * down, max(int(lengths.max(initial=0)), 1)), dtype=np.int64)
    used = np.zeros((*index.shape, 1), dtype=np.float32)
    index[tile, place], used[tile, place] = owner, 1.0
    inside = np.stack(np.meshgrid(np.arange(TILE), np.arange(TILE)), axis=-1).reshape(-1, 2)
    corner = TILE * np.stack([np.arange(across * down) % across, np.arange(across * down) // across], axis=1)
    pixels = (corner[:, None] + inside).astype(np.float32)
    return Tiles(torch.from_numpy(index), torch.from_numpy(used).to(mean.dtype), torch.from_numpy(pixels).to(mean.dtype), across, down)


def blend(
    mean: torch.Tensor, covariance: torch.Tensor, opacity: torch.Tensor, colour: torch.Tensor, tiles: Tiles, width: int, height: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Front-to-back blending: premultiplied colour (H, W, 3) and alpha (H, W). Differentiable in all Gaussians' arguments."""
    determinant = covariance[:, 0, 0] * covariance[:, 1, 1] - covariance[:, 0, 1] ** 2
    conic = torch.stack([covariance[:, 1, 1], -covariance[:, 0, 1], covariance[:, 0, 0]], dim=1) / determinant[:, None]
    # One gather for all properties: its adjoint, a scatter, is the slow part.
    packed = torch.cat([mean, conic, opacity[:, None], colour], dim=1)
    listed = torch.nn.functional.embedding(tiles.index, packed)  # (M, L, 9)
    offset_x, offset_y = (tiles.pixels[:, None, :, i] - listed[..., i, None] for i in range(2))  # (M, L, P)
    xx, xy, yy = (listed[..., i, None] for i in (2, 3, 4))
    power = -0.5 * (xx * offset_x**2 + yy * offset_y**2) - xy * offset_x * offset_y
    alpha = (listed[..., 5, None] * tiles.used * torch.exp(power)).clamp_max(MAX_ALPHA)
    absorbed = torch.log1p(-alpha)
    weight = alpha * torch.exp(torch.cumsum(absorbed, dim=1) - absorbed)
    picture = weight.transpose(1, 2) @ listed[..., 6:]  # (M, P, 3)
    cover = weight.sum(dim=1)
    return _assemble(picture, tiles)[:height, :width], _assemble(cover[..., None], tiles)[:height, :width, 0]


def _assemble(values: torch.Tensor, tiles: Tiles) -> torch.Tensor:
    """(M, P, C) of all tiles -> (down * TILE, across * TILE, C)."""
    channels = values.shape[-1]
    grid = values.reshape(tiles.down, tiles.across, TILE, TILE, channels)
    return grid.permute(0, 2, 1, 3, 4).reshape(tiles.down * TILE, tiles.across * TILE, channels)


def picture(
    gaussians: Gaussians, camera: Camera, frame: int = 0, x: np.ndarray | None = None, F: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Render Gaussians, at rest or carried by particles.

    Args:
        x: (N, 3) particle positions [m], None for rest; F: (N, 3, 3) their deformation gradients, None for the identity.

    Returns:
        premultiplied colour (H, W, 3) and alpha (H, W), float32 in 0..1.
    """
    centres = gaussians.x if x is None else gaussians.attachment.follow(x)
    spread = rest_covariances(gaussians) if F is None else covariances(gaussians, F)
    with one_thread(), torch.no_grad():
        place, shape = torch.from_numpy(centres).float(), torch.from_numpy(spread).float()
        colour = torch.from_numpy(seen_colours(gaussians, centres, camera.pose(frame)[:3, 3], F)).float()
        opacity = torch.from_numpy(gaussians.opacity).float()
        if gsplat_backend.usable():
            image, alpha = gsplat_backend.draw(place, shape, opacity, colour, camera, frame, NEAR)
        else:
            mean, flat, depth = project(place, shape, camera, frame)
            tiles = tiles_of(mean, flat, depth, camera.width, camera.height)
            image, alpha = blend(mean, flat, opacity, colour, tiles, camera.width, camera.height)
    return image.numpy(), alpha.numpy()


def fit(
    gaussians: Gaussians, relief: Relief, image: np.ndarray, iterations: int = ITERATIONS, progress: Progress | None = None
) -> tuple[Gaussians, float]:
    """Optimise {Sigma^0, sigma, SH} on picture 0 by splatting (paper, section 3.1): scales, opacities and colours, by Adam.

    Args:
        image: (H, W, 3) uint8 RGB. Only the mask's box is rendered, reduced to at most about `FIT_PIXELS`.

    Returns:
        the Gaussians and their PSNR inside the mask [dB], over black.

    Raises:
        Cancelled: between iterations.
    """
    return fit_views(gaussians, [Look(relief.camera, relief.mask, image)], iterations, progress)


@dataclass(frozen=True)
class Look:
    """The object in picture 0 of one camera."""

    camera: Camera
    mask: np.ndarray
    """(H, W) bool."""
    image: np.ndarray
    """(H, W, 3) uint8 RGB."""


def fit_views(
    gaussians: Gaussians, looks: Sequence[Look], iterations: int = ITERATIONS, progress: Progress | None = None
) -> tuple[Gaussians, float]:
    """As `fit`, on the pictures of several posed cameras at one moment. The PSNR is that of the first."""
    progress = progress or NoProgress()
    with one_thread():
        return _fit(gaussians, looks, iterations, progress)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Torch on one thread: these tensors are so small that threads mostly wait for each other, six times slower on a busy machine."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _fit(gaussians: Gaussians, looks: Sequence[Look], iterations: int, progress: Progress) -> tuple[Gaussians, float]:
    targets = [_target(look) for look in looks]
    axes = torch.from_numpy(_axes(gaussians)).float()
    x = torch.from_numpy(gaussians.x).float()
    limit = torch.log(torch.from_numpy(gaussians.scale).float()) + float(np.log(4.0))
    scale = torch.log(torch.from_numpy(gaussians.scale).float()).requires_grad_()
    opacity = torch.logit(torch.from_numpy(gaussians.opacity).float(), eps=1e-4).requires_grad_()
    sh = torch.from_numpy(gaussians.sh[:, 0]).float().requires_grad_()
    optimiser = torch.optim.Adam(
        [
            {"params": [scale], "lr": LEARNING_RATES["scale"]},
            {"params": [opacity], "lr": LEARNING_RATES["opacity"]},
            {"params": [sh], "lr": LEARNING_RATES["sh"]},
        ],
        betas=(0.9, 0.99),
    )
    decay = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, max(iterations, 1), eta_min=0.0)

    def render(camera: Camera, renew: Tiles | None) -> tuple[torch.Tensor, torch.Tensor, Tiles | None]:
        stretched = axes * torch.exp(scale)[:, None, :]
        if gsplat_backend.usable():
            spread = stretched @ stretched.transpose(1, 2)
            return *gsplat_backend.draw(x, spread, torch.sigmoid(opacity), 0.5 + SH0 * sh, camera, 0, NEAR), renew
        mean, flat, depth = project(x, stretched @ stretched.transpose(1, 2), camera)
        tiles = renew or tiles_of(mean, flat, depth, camera.width, camera.height)
        return *blend(mean, flat, torch.sigmoid(opacity), 0.5 + SH0 * sh, tiles, camera.width, camera.height), tiles

    tiles: list[Tiles | None] = [None] * len(targets)
    quality = 0.0
    for iteration in range(iterations):
        optimiser.zero_grad()
        for number, (camera, target, cover) in enumerate(targets):
            colour, alpha, tiles[number] = render(camera, None if iteration % RENEW == 0 else tiles[number])
            error = ((colour - target) ** 2).mean(dim=-1)
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
        camera, target, cover = targets[0]
        quality = _psnr(((render(camera, None)[0] - target) ** 2).mean(dim=-1), cover)
    fitted = dataclasses.replace(
        gaussians,
        scale=np.exp(scale.detach().double().numpy()),
        opacity=torch.sigmoid(opacity.detach().double()).numpy(),
        sh=sh.detach().double().numpy()[:, None],
    )
    return fitted, quality


def _axes(gaussians: Gaussians) -> np.ndarray:
    """(G, 3, 3) unit axes as columns."""
    return Rotation.from_quat(gaussians.rotation[:, [1, 2, 3, 0]]).as_matrix()


def _psnr(error: torch.Tensor, cover: torch.Tensor) -> float:
    """Peak signal to noise ratio [dB] over the pixels that the object covers fully."""
    inside = cover > 0.999
    mean = float(error[inside].mean()) if bool(inside.any()) else float(error.mean())
    return float(-10.0 * np.log10(max(mean, 1e-10)))


def _target(look: Look) -> tuple[Camera, torch.Tensor, torch.Tensor]:
    """Camera, colour (h, w, 3) over black and cover (h, w) of the mask's box in picture 0, reduced by block means."""
    rows, columns = np.nonzero(look.mask)
    x0, y0 = max(int(columns.min()) - MARGIN, 0), max(int(rows.min()) - MARGIN, 0)
    x1, y1 = min(int(columns.max()) + 1 + MARGIN, look.mask.shape[1]), min(int(rows.max()) + 1 + MARGIN, look.mask.shape[0])
    reduce = max(1, int(np.ceil(np.sqrt((x1 - x0) * (y1 - y0) / FIT_PIXELS))))
    camera = view_camera(look.camera, (x0, y0, x1, y1), reduce)
    height, width = camera.height, camera.width
    crop = (slice(y0, y0 + height * reduce), slice(x0, x0 + width * reduce))
    cover = look.mask[crop].astype(np.float32)
    colour = look.image[crop].astype(np.float32) / 255.0 * cover[..., None]
    blocks = (height, reduce, width, reduce)
    return camera, torch.from_numpy(colour.reshape(*blocks, 3).mean(axis=(1, 3))), torch.from_numpy(cover.reshape(blocks).mean(axis=(1, 3)))
