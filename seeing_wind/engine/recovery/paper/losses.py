"""How far a simulated frame is from the observed one, for torch to differentiate: the tracking objective, and what all objectives share.

Each loss is divided by what it would be without any force, so that the weights of Eq. (14) mean the same for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch

from ...records import Attachment, Camera, Particles, PointTargets, TrackTargets
from ..targets.channels import check
from ..targets.tracks import edge_on

Targets = PointTargets | Sequence[TrackTargets]

SMOOTH = 0.1
"""Distances below this share of the scale count as squares: |r| has no derivative at zero."""


class MotionLoss(Protocol):
    """L_motion of Eq. (14)."""

    def begin(self, x: np.ndarray, frame: int) -> None:
        """From now on `frame` is compared; the particles x (N, 3) [m] are where they were found to be in the frame before."""

    def __call__(self, x: torch.Tensor, F: torch.Tensor) -> torch.Tensor:
        """Particles x (N, 3) [m] and F (N, 3, 3) -> a scalar, about one without any force."""


class TrackingLoss:
    """Mean distance of simulated and observed points, in 3D or in pixels (the paper's sparse tracking objective, Eq. (9)).

    Tracks are compared in the frame, not lifted to 3D as the paper does: a lift's errors along the view would be taken for force.

    Args:
        scale: distance [m] that the expected force moves the body by in a frame.
    """

    def __init__(self, particles: Particles, targets: Targets, scale: float) -> None:
        self.sources: list[PointTargets | TrackTargets] = [targets] if isinstance(targets, PointTargets) else list(targets)
        self.visible = []
        for one in self.sources:
            if isinstance(one, PointTargets):
                check(one.x, one.visible, 3, one.attachment, len(particles.x))
                self.visible.append(one.visible)
            else:
                check(one.xy, one.visible, 2, one.attachment, len(particles.x))
                self.visible.append(one.visible & ~edge_on(one.xy, one.visible))
        self.scale, self.frame = scale, 0
        self.riders = [Rider(one.attachment) for one in self.sources]

    def begin(self, x: np.ndarray, frame: int) -> None:
        self.frame = frame

    def __call__(self, x: torch.Tensor, F: torch.Tensor) -> torch.Tensor:
        parts, frame = [], self.frame
        for one, visible, rider in zip(self.sources, self.visible, self.riders, strict=True):
            seen = np.flatnonzero(visible[frame])
            if not len(seen):
                continue
            here = rider.follow(x, seen)
            if isinstance(one, PointTargets):
                miss = here - torch.from_numpy(one.x[frame, seen])
                weight = torch.ones(len(seen), dtype=x.dtype)
            else:
                pixels, depth = project(here, one.camera, frame)
                metres = (depth.detach() / one.camera.fx)[:, None]
                miss = (pixels - torch.from_numpy(one.xy[frame, seen])) * metres
                sigma = one.sigma[frame, seen]
                weight = torch.from_numpy(np.median(sigma) / sigma)
            parts.append((weight * smooth_length(miss / self.scale)).sum() / weight.sum())
        return torch.stack(parts).mean() if parts else 0.0 * x.sum()

    def distance(self, x: np.ndarray) -> np.ndarray:
        """(T+1,) root mean square distance of a trajectory (T+1, N, 3) in [m] for points, [px] for tracks; 0 where nothing was seen."""
        squares, count = np.zeros(len(x)), np.zeros(len(x))
        for one, visible in zip(self.sources, self.visible, strict=True):
            for t in range(len(x)):
                here = one.attachment.follow(x[t])[visible[t]]
                want = (one.x if isinstance(one, PointTargets) else one.xy)[t, visible[t]]
                got = here if isinstance(one, PointTargets) else one.camera.project(here, t)[0]
                squares[t] += ((got - want) ** 2).sum()
                count[t] += len(want)
        return np.sqrt(squares / np.maximum(count, 1))


class Rider:
    """An attachment for torch."""

    def __init__(self, attachment: Attachment) -> None:
        self.index = torch.from_numpy(np.asarray(attachment.index, np.int64))
        self.weight = torch.from_numpy(np.asarray(attachment.weight, np.float64))

    def follow(self, values: torch.Tensor, some: np.ndarray | None = None) -> torch.Tensor:
        """Particle values (N, ...) -> those of the attached points (K, ...), or of `some` of them."""
        rows = slice(None) if some is None else torch.from_numpy(some)
        index, weight = self.index[rows], self.weight[rows].to(values.dtype)
        return torch.einsum("kj,kj...->k...", weight, values[index])


def project(points: torch.Tensor, camera: Camera, frame: int) -> tuple[torch.Tensor, torch.Tensor]:
    """World points (K, 3) -> pixels (K, 2) and depths (K,) [m]; see `Camera.project`. Points behind the camera are held in front."""
    pose = torch.from_numpy(np.ascontiguousarray(camera.pose(frame), dtype=np.float64)).to(points.dtype)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    depth = local[:, 2].clamp_min(1e-3)
    return torch.stack([camera.fx * local[:, 0] / depth + camera.cx, camera.fy * local[:, 1] / depth + camera.cy], dim=1), depth


def smooth_length(vectors: torch.Tensor) -> torch.Tensor:
    """(K, c) -> (K,) lengths, differentiable at zero."""
    return (vectors.square().sum(dim=-1) + SMOOTH**2).sqrt() - SMOOTH
