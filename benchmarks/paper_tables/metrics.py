"""Similarity of two clips: PSNR, SSIM, and LPIPS if its package and weights are installed."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

import numpy as np
from skimage.metrics import structural_similarity


def psnr(want: np.ndarray, got: np.ndarray) -> float:
    """Mean peak signal-to-noise ratio [dB], at most 100, over frames (T+1, H, W, 3) uint8."""
    error = ((want.astype(np.float64) - got) ** 2).mean(axis=(1, 2, 3)) / 255.0**2
    return float((-10.0 * np.log10(np.maximum(error, 1e-10))).mean())


def ssim(want: np.ndarray, got: np.ndarray) -> float:
    """Mean structural similarity (Wang et al. 2004) over frames."""
    return float(np.mean([structural_similarity(a, b, channel_axis=2) for a, b in zip(want, got, strict=True)]))


def lpips(want: np.ndarray, got: np.ndarray) -> float | None:
    """Mean LPIPS (Zhang et al. 2018, AlexNet) over frames; None without the package or AlexNet's weights; nothing is fetched."""
    if importlib.util.find_spec("lpips") is None or not _alexnet().is_file():
        return None
    import lpips as package
    import torch

    measure = package.LPIPS(net="alex", verbose=False)
    pairs = [torch.from_numpy(clip).permute(0, 3, 1, 2).float() / 127.5 - 1.0 for clip in (want, got)]
    with torch.no_grad():
        return float(measure(*pairs).mean())


def _alexnet() -> Path:
    """Where torchvision keeps the weights."""
    home = Path(os.environ.get("TORCH_HOME", Path.home() / ".cache" / "torch"))
    return home / "hub" / "checkpoints" / "alexnet-owt-7be5be79.pth"
