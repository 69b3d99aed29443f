"""A small differentiable rasteriser of 3D Gaussians on the CPU.

Projection and blending as in Kerbl et al., 3D Gaussian splatting (2023), after Zwicker et al., EWA volume splatting (2001): covariances are
projected with the Jacobian of the perspective, widened by a pixel filter, and blended front to back. Tiles of the frame are
rendered in batches, each tile with its own depth-sorted list, padded to the longest of its batch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from ..field.torch_threads import one_torch_thread
from ..observe.object.shape.visibility import counted
from ..records import Camera, Gaussians
from .gaussians import covariances, rest_covariances
from .harmonics import seen_colours

TILE = 4
"""Side of a tile [px]."""
PIXEL_FILTER = 0.3
"""Variance of the filter that keeps a Gaussian at least about a pixel wide [px²]; the value of the reference implementation."""
CUTOFF = 2.5
"""A Gaussian is cut off at this many standard deviations, 4 % of its peak; more takes time and does not change the PSNR by a decibel."""
TOGETHER = 64
"""Tiles blended as one batch; a larger batch needs more padding, because all its lists are padded to the longest."""
MAX_ALPHA = 0.99
NEAR = 1e-3
"""Gaussians nearer to the camera than this are not drawn [m]."""


@dataclass(frozen=True)
class Batch:
    """Tiles with lists of similar length, and the Gaussians that each of them blends, nearest first."""

    tile: torch.Tensor
    """(M,) numbers of the tiles, row by row."""
    index: torch.Tensor
    """(M, L) numbers of Gaussians, padded with 0."""
    used: torch.Tensor
    """(M, L, 1) 1, or 0 for padding."""
    pixels: torch.Tensor
    """(M, P, 2) pixel centres of the tile."""


@dataclass(frozen=True)
class Tiles:
    """The tiles of a frame that Gaussians reach."""

    batches: tuple[Batch, ...]
    across: int
    """Number of tiles along a row of the frame."""
    down: int
    """Number of tiles along a column."""


def project(x: torch.Tensor, covariance: torch.Tensor, camera: Camera, frame: int = 0) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Gaussians with centres x (G, 3) and covariances (G, 3, 3) -> means (G, 2) [px], covariances (G, 2, 2) [px²] including the pixel
    filter, depths (G,) [m]."""
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
    """Lists of the Gaussians that reach each tile of a frame."""
    across, down = -(-width // TILE), -(-height // TILE)
    reach = CUTOFF * np.sqrt(np.maximum(np.linalg.eigvalsh(covariance.detach().numpy())[:, -1], 0.0))
    centre, far = mean.detach().numpy(), depth.detach().numpy()
    first = np.floor((centre - reach[:, None] + 0.5) / TILE).astype(int)
    last = np.floor((centre + reach[:, None] + 0.5) / TILE).astype(int)
    first = np.clip(first, 0, None)
    last = np.minimum(last, [across - 1, down - 1])
    spans = np.maximum(last - first + 1, 0)
    covers = np.where(far > NEAR, spans.prod(axis=1), 0)
    owner, within = counted(covers)
    tile = (first[owner, 1] + within // spans[owner, 0]) * across + first[owner, 0] + within % spans[owner, 0]
    order = np.lexsort((far[owner], tile))
    owner, tile = owner[order], tile[order]
    lengths = np.bincount(tile, minlength=across * down)
    begins = np.cumsum(lengths) - lengths
    inside = np.stack(np.meshgrid(np.arange(TILE), np.arange(TILE)), axis=-1).reshape(-1, 2)
    filled = np.argsort(lengths, kind="stable")[np.count_nonzero(lengths == 0) :]
    batches = []
    for chosen in (filled[k : k + TOGETHER] for k in range(0, len(filled), TOGETHER)):
        place = np.arange(lengths[chosen[-1]])
        used = place < lengths[chosen, None]
        index = np.where(used, owner[np.minimum(begins[chosen, None] + place, len(owner) - 1)], 0)
        corner = TILE * np.stack([chosen % across, chosen // across], axis=1)
        pixels = torch.from_numpy((corner[:, None] + inside).astype(np.float32)).to(mean.dtype)
        weight = torch.from_numpy(used[..., None].astype(np.float32)).to(mean.dtype)
        batches.append(Batch(torch.from_numpy(chosen), torch.from_numpy(index), weight, pixels))
    return Tiles(tuple(batches), across, down)


def shapes(mean: torch.Tensor, covariance: torch.Tensor, opacity: torch.Tensor) -> torch.Tensor:
    """(G, 6) the properties of Gaussians that `blend_weights` needs: centre [px], inverse covariance [1/px²] (xx, xy, yy), opacity."""
    determinant = covariance[:, 0, 0] * covariance[:, 1, 1] - covariance[:, 0, 1] ** 2
    conic = torch.stack([covariance[:, 1, 1], -covariance[:, 0, 1], covariance[:, 0, 0]], dim=1) / determinant[:, None]
    return torch.cat([mean, conic, opacity[:, None]], dim=1)


def blend_weights(listed: torch.Tensor, batch: Batch) -> tuple[torch.Tensor, torch.Tensor]:
    """Blending weights (M, L, P) of a batch's Gaussians with `shapes` (M, L, 6 or more), and the transmittance of all of them (M, P)."""
    offset_x, offset_y = (batch.pixels[:, None, :, i] - listed[..., i, None] for i in range(2))  # (M, L, P)
    xx, xy, yy = (listed[..., i, None] for i in (2, 3, 4))
    power = -0.5 * (xx * offset_x**2 + yy * offset_y**2) - xy * offset_x * offset_y
    alpha = (listed[..., 5, None] * batch.used * torch.exp(power)).clamp_max(MAX_ALPHA)
    absorbed = torch.log1p(-alpha)
    along = torch.cumsum(absorbed, dim=1)
    return alpha * torch.exp(along - absorbed), torch.exp(along[:, -1])


def blend(
    mean: torch.Tensor, covariance: torch.Tensor, opacity: torch.Tensor, colour: torch.Tensor, tiles: Tiles, width: int, height: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Front-to-back blending: premultiplied colour (H, W, 3) and alpha (H, W). Differentiable in all properties of the Gaussians."""
    # One gather for all properties, because its adjoint, a scatter, is the slow part.
    packed = torch.cat([shapes(mean, covariance, opacity), colour], dim=1)
    parts = []
    for batch in tiles.batches:
        listed = torch.nn.functional.embedding(batch.index, packed)  # (M, L, 9)
        weight, _ = blend_weights(listed, batch)
        parts.append(torch.cat([weight.transpose(1, 2) @ listed[..., 6:], weight.sum(dim=1)[..., None]], dim=2))  # (M, P, 4)
    blank = packed.new_zeros((tiles.across * tiles.down, TILE**2, 4))
    if not parts:
        image = _assemble(blank, tiles)
    else:
        image = _assemble(blank.index_copy(0, torch.cat([batch.tile for batch in tiles.batches]), torch.cat(parts)), tiles)
    return image[:height, :width, :3], image[:height, :width, 3]


def _assemble(values: torch.Tensor, tiles: Tiles) -> torch.Tensor:
    """Values (M, P, C) of all tiles -> an image (down * TILE, across * TILE, C)."""
    channels = values.shape[-1]
    grid = values.reshape(tiles.down, tiles.across, TILE, TILE, channels)
    return grid.permute(0, 2, 1, 3, 4).reshape(tiles.down * TILE, tiles.across * TILE, channels)


def render_gaussians(
    gaussians: Gaussians, camera: Camera, frame: int = 0, x: np.ndarray | None = None, F: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Render Gaussians, at rest or moved by particles.

    Args:
        x: (N, 3) particle positions [m], None for rest; F: (N, 3, 3) their deformation gradients, None for the identity.

    Returns:
        premultiplied colour (H, W, 3) and alpha (H, W), float32 in 0..1.
    """
    centres = gaussians.x if x is None else gaussians.attachment.follow(x)
    spread = rest_covariances(gaussians) if F is None else covariances(gaussians, F)
    with one_torch_thread(), torch.no_grad():
        place, shape = torch.from_numpy(centres).float(), torch.from_numpy(spread).float()
        colour = torch.from_numpy(seen_colours(gaussians, centres, camera.pose(frame)[:3, 3], F)).float()
        opacity = torch.from_numpy(gaussians.opacity).float()
        mean, flat, depth = project(place, shape, camera, frame)
        tiles = tiles_of(mean, flat, depth, camera.width, camera.height)
        image, alpha = blend(mean, flat, opacity, colour, tiles, camera.width, camera.height)
    return image.numpy(), alpha.numpy()
