"""Dense optical flow of the object from every frame to the next, for the flow-and-depth objective."""

from __future__ import annotations

import cv2
import numpy as np

from ...masks import Masks
from ...progress import Progress
from ..clip.opencv_threads import one_thread
from ..clip.stored import Frames
from ..mask.motion import Flow, FlowSolver, middle_of, window_of

MARGIN = 16
"""Width [px] of the margin round the silhouette in which flow is computed."""


def dense_flow(frames: Frames, masks: Masks, progress: Progress) -> list[Flow | None]:
    """Flow from every frame to the next inside a window round the object, T entries; None where the object is not in the former frame.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; masks: (T+1, H, W) bool. The search begins at the shift of the silhouette's centroid.
    """
    solver = FlowSolver()
    flows: list[Flow | None] = []
    with one_thread():
        before, gray = masks[0], cv2.cvtColor(frames[0], cv2.COLOR_RGB2GRAY)
        for t in range(len(frames) - 1):
            progress.update(t / len(frames), f"dense flow, frame {t} of {len(frames) - 1}")
            after, next_gray = masks[t + 1], cv2.cvtColor(frames[t + 1], cv2.COLOR_RGB2GRAY)
            if before.any():
                shift = middle_of(after) - middle_of(before) if after.any() else np.zeros(2)
                flows.append(solver.between(gray, next_gray, window_of(before, MARGIN), shift))
            else:
                flows.append(None)
            before, gray = after, next_gray
    return flows
