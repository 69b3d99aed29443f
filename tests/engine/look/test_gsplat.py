"""The CUDA rasteriser against our own; runs only where gsplat and a GPU are."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.look import gsplat_backend
from seeing_wind.engine.look.splatting import NEAR, blend, project, tiles_of
from seeing_wind.engine.records import Camera


@pytest.mark.skipif(not gsplat_backend.usable(), reason="needs gsplat and CUDA")
def test_it_draws_the_same_frame() -> None:
    rng = np.random.default_rng(0)
    camera = Camera(64, 48, 60.0, 62.0, 31.0, 24.5, front_view(2.0))
    x = torch.from_numpy(rng.uniform(-0.5, 0.5, (200, 3))).float()
    axes = torch.from_numpy(rng.normal(0, 0.03, (200, 3, 3))).float()
    spread = axes @ axes.transpose(1, 2) + 1e-4 * torch.eye(3)
    opacity, colour = torch.from_numpy(rng.uniform(0.2, 0.9, 200)).float(), torch.from_numpy(rng.uniform(0, 1, (200, 3))).float()
    mean, flat, depth = project(x, spread, camera)
    image, alpha = blend(mean, flat, opacity, colour, tiles_of(mean, flat, depth, 64, 48), 64, 48)
    theirs, cover = gsplat_backend.draw(x, spread, opacity, colour, camera, 0, NEAR)
    # Ours cuts a Gaussian off at 2.5 standard deviations, 4 % of its peak.
    assert (image - theirs).abs().mean() < 0.01 and (alpha - cover).abs().mean() < 0.01


def test_without_gsplat_or_gpu_it_is_not_used() -> None:
    import importlib.util

    assert gsplat_backend.usable() == (importlib.util.find_spec("gsplat") is not None and torch.cuda.is_available())
