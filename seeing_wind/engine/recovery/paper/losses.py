"""Differentiable distances (in torch) between a simulated and an observed frame: the tracking objective, and what all objectives share.

Each loss is divided by about its value without any force, so that the weights of Eq. (14) mean the same for all.
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
"""Below this share of the scale, distances are smoothed to be quadratic, as |r| has no derivative at zero."""


class MotionLoss(Protocol):
    """L_motion of Eq. (14)."""

    def begin(self, x: np.ndarray, frame: int) -> None:
        """Compare with `frame` from now on; x (N, 3) [m] are the particles' recovered positions in the frame before."""

    def __call__(self, x: torch.Tensor, F: torch.Tensor) -> torch.Tensor:
        """The loss of particles at x (N, 3) [m] with deformation gradients F (N, 3, 3): a scalar, about 1 without any force."""


class TrackingLoss:
    """Mean distance between simulated and observed points, in 3D or in pixels (the paper's sparse tracking objective, Eq. (9)).

    Tracks are compared in the image, not lifted to 3D as in the paper: errors of the lifted depth would be mistaken for a force.

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
        """(T+1,) root mean square distance of a trajectory x (T+1, N, 3) [m] from points [m] or tracks [px]; 0 where nothing was seen."""
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
    """An `Attachment` as torch tensors."""

    def __init__(self, attachment: Attachment) -> None:
        self.index = torch.from_numpy(np.asarray(attachment.index, np.int64))
        self.weight = torch.from_numpy(np.asarray(attachment.weight, np.float64))

    def follow(self, values: torch.Tensor, some: np.ndarray | None = None) -> torch.Tensor:
        """Interpolate particle values (N, ...) to the attached points (K, ...), or to `some` of these (indices)."""
        rows = slice(None) if some is None else torch.from_numpy(some)
        index, weight = self.index[rows], self.weight[rows].to(values.dtype)
        return torch.einsum("kj,kj...->k...", weight, values[index])


def project(points: torch.Tensor, camera: Camera, frame: int) -> tuple[torch.Tensor, torch.Tensor]:
    """World points (K, 3) [m] -> pixels (K, 2) and depths (K,) [m], at least 1 mm even behind the camera; see `Camera.project`."""
    pose = torch.from_numpy(np.ascontiguousarray(camera.pose(frame), dtype=np.float64)).to(points.dtype)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    depth = local[:, 2].clamp_min(1e-3)
    return torch.stack([camera.fx * local[:, 0] / depth + camera.cx, camera.fy * local[:, 1] / depth + camera.cy], dim=1), depth


def smooth_length(vectors: torch.Tensor) -> torch.Tensor:
    """Lengths (K,) of vectors (K, c), smoothed so that they are differentiable at zero."""
    return (vectors.square().sum(dim=-1) + SMOOTH**2).sqrt() - SMOOTH
