"""The dense scene-flow loss (the paper's Table 3, "Flow+Depth Loss"): every visible Gaussian shall move as optical flow and depth imply.

The paper takes depth from a pretrained network. Here a frame's depth is interpolated from the tracked points that were lifted to 3D
(`Body.lifted`), which is more accurate than a monocular network on the bodies that this engine builds, so the baseline is not weakened.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from ...errors import ObjectError
from ...masks import Masks, at_pixels
from ...records import Attachment, Camera
from .losses import Rider, project, smooth_length

NEIGHBOURS = 8
"""Number of lifted points from which the depth at a pixel is interpolated."""


@dataclass(frozen=True)
class SceneFlow:
    """Flow and depth of one camera's clip."""

    flow: Sequence[Callable[[np.ndarray], np.ndarray] | None]
    """T functions: pixels (K, 2) in frame t -> their displacements (K, 2) [px] to frame t + 1; None where there is no flow."""
    masks: Masks
    """(T+1, H, W) bool, the object."""
    camera: Camera
    surface: Attachment
    """The visible points that carry the loss."""
    lifted: np.ndarray
    """(T+1, K, 3) tracked points lifted to 3D [m], NaN where not known."""


class FlowDepthLoss:
    """Mean distance between the surface points' simulated positions and those that flow and depth give.

    Args:
        scene: the observations.
        scale: distance [m] that the expected force moves the body by in a frame.

    Raises:
        ObjectError: no point was lifted, so no depth is known.
    """

    def __init__(self, scene: SceneFlow, scale: float) -> None:
        if not np.isfinite(scene.lifted).all(axis=-1).any():
            raise ObjectError("No tracked point has a depth.", "Use --objective tracking, or give --depth and textured surroundings.")
        self.scene, self.scale = scene, scale
        self.rider = Rider(scene.surface)
        self.frame = 0
        self.use: np.ndarray
        self.goal: torch.Tensor
        self.depth: torch.Tensor

    def begin(self, x: np.ndarray, frame: int) -> None:
        self.frame = frame
        self.use, goal, depth = self._targets(self.scene.surface.follow(x), frame)
        self.goal, self.depth = torch.from_numpy(goal), torch.from_numpy(depth)

    def __call__(self, x: torch.Tensor, F: torch.Tensor) -> torch.Tensor:
        if not len(self.use):
            return 0.0 * x.sum()
        pixels, along = project(self.rider.follow(x, self.use), self.scene.camera, self.frame)
        across = (pixels - self.goal) * (along.detach() / self.scene.camera.fx)[:, None]
        miss = torch.cat([across, (along - self.depth)[:, None]], dim=1)
        return smooth_length(miss / self.scale).mean()

    def _targets(self, before: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Indices (U,) of the points to use, and the pixels (U, 2) and depths (U,) [m] that they should have in `frame`.

        `before` (K, 3) [m] are the points' positions in the frame before.
        """
        camera, masks, flow = self.scene.camera, self.scene.masks, self.scene.flow[frame - 1]
        start, depth = camera.project(before, frame - 1)
        use = np.flatnonzero((depth > 0.0) & at_pixels(masks[frame - 1], start))
        known = np.isfinite(self.scene.lifted[frame]).all(axis=-1)
        if flow is None or not len(use) or not known.any():
            return use[:0], np.zeros((0, 2)), np.zeros(0)
        goal = start[use] + flow(start[use])
        kept = at_pixels(masks[frame], goal)
        use, goal = use[kept], goal[kept]
        anchors, distance = camera.project(self.scene.lifted[frame, known], frame)
        return use, goal, _blend(anchors, distance, goal)


def _blend(anchors: np.ndarray, values: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Values (A,) at anchors (A, 2) [px], interpolated to pixels (U, 2) with inverse squared distances as weights."""
    count = min(NEIGHBOURS, len(anchors))
    distance, index = cKDTree(anchors).query(xy, k=count)
    weight = 1.0 / (distance.reshape(-1, count) ** 2 + 1.0)
    return (weight * values[index.reshape(-1, count)]).sum(axis=1) / weight.sum(axis=1)
