"""What every Gaussian contributes to every pixel, as a sparse matrix: with fixed shapes and opacities, a frame is linear in the colours."""

from __future__ import annotations

import numpy as np
import torch
from scipy import sparse

from ..records import Camera, Gaussians
from .gaussians import covariances
from .splatting import blend_weights, project, shapes, tiles_of

LEAST = 2e-3
"""Contributions below this, half a grey level, are left out."""


def contributions(gaussians: Gaussians, camera: Camera, x: np.ndarray, F: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray]:
    """Blending weights, as in `splatting.blend`, of Gaussians that move with particles.

    Args:
        camera: one that stands still; x: (N, 3) particle positions [m]; F: (N, 3, 3) their deformation gradients.

    Returns:
        (H W, G) weights, float32, pixels row by row; and (H W, 1) the share of the background that remains visible.
    """
    pixels, count = camera.height * camera.width, len(gaussians.x)
    behind = np.ones((pixels, 1), np.float32)
    rows, columns, values = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0, np.float32)]
    with torch.no_grad():
        place, spread = gaussians.attachment.follow(x), covariances(gaussians, F)
        mean, flat, depth = project(torch.from_numpy(place).float(), torch.from_numpy(spread).float(), camera)
        tiles = tiles_of(mean, flat, depth, camera.width, camera.height)
        packed = shapes(mean, flat, torch.from_numpy(gaussians.opacity).float())
        for batch in tiles.batches:
            weight, passed = blend_weights(packed[batch.index], batch)
            inside = (batch.pixels[..., 0] < camera.width) & (batch.pixels[..., 1] < camera.height)
            number = (batch.pixels[..., 1] * camera.width + batch.pixels[..., 0]).long()
            behind[number[inside].numpy(), 0] = passed[inside].numpy()
            tile, rank, pixel = torch.nonzero((weight > LEAST) & inside[:, None], as_tuple=True)
            rows.append(number[tile, pixel].numpy())
            columns.append(batch.index[tile, rank].numpy())
            values.append(weight[tile, rank, pixel].numpy())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sparse.csr_matrix(entries, (pixels, count)), behind
