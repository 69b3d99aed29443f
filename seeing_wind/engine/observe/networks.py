"""The steps for which a network can replace the default: depth, the first outline, the outlines after it, and the tracks."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..conventions import DEFAULT_FOV_DEGREES
from ..errors import ObjectError, UsageError
from ..masks import Masks, Packing
from ..progress import Progress
from ..settings import ObserveSettings
from .clip.camera import read_camera
from .clip.depth import read_depth
from .clip.frames import Clip
from .clip.lens import Lens
from .clip.stored import Frames
from .mask.background import Plate
from .mask.cutting import LEAST_PIXELS
from .mask.first_mask import first_mask, point_list
from .mask.from_box import mask_in_box
from .mask.motion import Flow, FlowSolver, middle_of, window_of
from .mask.moving.in_box import Moving
from .tracks.tracker import find_corners

LEAST_TRACKS = 3
"""Least number of the object's points to give to a network."""


def check_networks(settings: ObserveSettings) -> None:
    """Raise UsageError for options that need each other or exclude each other."""
    if (settings.prompt is None) != (settings.detector_model is None):
        raise UsageError("--prompt and --detector-model belong together.", "Give the words, and the network that finds them.")
    if settings.prompt is not None and (settings.mask or settings.box or settings.points):
        raise UsageError("The object is marked by words and by a mask, box or points.", "Give one of them.")
    if settings.outline_frame and settings.outline is None:
        raise UsageError("--outline-frame says which frame --outline shows, but --outline is missing.", "Give both, or neither.")
    if settings.mask_model and (settings.correct or settings.outline):
        raise UsageError("--mask-model follows the outline by itself, and cannot be corrected.", "Leave it or the corrections out.")
    if settings.mask_model and settings.outline_model:
        raise UsageError("--mask-model follows the outline by itself, and takes no --outline-model.", "Give one of them.")
    if settings.depth and settings.depth_model:
        raise UsageError("--depth and --depth-model contradict each other.", "Give one of them.")
    if settings.tracks and settings.track_model:
        raise UsageError("--tracks and --track-model contradict each other.", "Give one of them.")


def first_depth(settings: ObserveSettings, clip: Clip, progress: Progress) -> tuple[np.ndarray | None, str]:
    """The depth (H, W) float32 [m] of frame 0 as filmed, from a file or a network, None without either; and its name for messages.

    Raises:
        UsageError: a depth file that cannot be used. ModelError, MissingPackage: a network that cannot.
    """
    frames, height, width = clip.frames.shape[:3]
    if settings.depth is not None:
        return read_depth(settings.depth, height, width), Path(settings.depth).name
    if settings.depth_model is None:
        return None, ""
    from .models.depth import predict_depth

    fov = settings.fov if 1.0 <= settings.fov <= 170.0 else DEFAULT_FOV_DEGREES  # `find_camera` raises an error for a wrong angle
    focal = 0.5 * width / float(np.tan(0.5 * np.radians(fov)))
    if settings.camera is not None:
        focal = read_camera(settings.camera, width, height, frames, clip.first_frame).fx
    return predict_depth(settings.depth_model, clip.frames[0], focal, progress), settings.depth_model


def first_outline(
    settings: ObserveSettings, frames: Frames, plate: Plate | None, moving: Moving | None, lens: Lens, progress: Progress
) -> np.ndarray:
    """The object (H, W) bool in the first of the straightened `frames` (T+1, H, W, 3).

    It is found from words or a box, else as `first_mask` does; a network cuts it out if one is named. `plate` is the background, and
    `moving` what moves before it, see `moving_from`.

    Raises:
        ObjectError, UsageError: as in `first_mask` and `mask_in_box`. ModelError, MissingPackage: a network that cannot be used.
    """
    box, frame = settings.box, frames[0]
    if settings.prompt is not None and settings.detector_model is not None:
        from .models.masks import find_box

        box = find_box(settings.detector_model, settings.prompt, frame, progress)
    if (box is not None or settings.points is not None) and settings.mask is None and settings.mask_model is not None:
        from .models.masks import MaskModel

        network = MaskModel(settings.mask_model)
        if box is not None:
            mask = network.in_box(frame, box)
        else:
            mask = network.at_points(frame, point_list(settings.points or (), *frame.shape[:2]))
        if mask.sum() < LEAST_PIXELS:
            raise ObjectError(f"{settings.mask_model} finds nothing there.", "Mark it more closely, or give --mask with a PNG.")
        return mask
    if box is not None and settings.mask is None:
        return mask_in_box(frame, box, plate, progress, moving)
    mask = first_mask(settings, frames, plate, progress)
    # The user's mask or depth map is given in the filmed frame; anything else was found in the straightened one.
    return lens.straight_map(mask) if settings.mask is not None or settings.depth is not None else mask


def network_masks(name: str, frames: Frames, mask: np.ndarray, progress: Progress) -> Masks:
    """The masks (T+1, H, W) of `frames` (T+1, H, W, 3) from the network `name`, given `mask` (H, W) bool in frame 0."""
    from .models.masks import MaskModel

    packing = Packing()
    packing.add(mask)
    for t, new in enumerate(MaskModel(name).follow(frames, mask, progress), start=1):
        progress.update(t / len(frames), f"following the object, frame {t} of {len(frames) - 1}")
        packing.add(new)
    return packing.masks()


class Outlined:
    """A `mask.through.Follower` for an object whose `masks` (T+1, H, W) are known already: it only computes the flow between them."""

    def __init__(self, frame: np.ndarray, masks: Masks) -> None:
        """`frame`: frame 0, (H, W, 3) uint8 RGB."""
        self._solver, self._masks, self._count = FlowSolver(rough=True), masks, 0
        self._gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        self.mask = masks[0]
        self.flow: Flow | None = None

    def advance(self, frame: np.ndarray) -> np.ndarray:
        """See `Follower.advance`."""
        before, gray = self.mask, cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        self._count += 1
        self.mask, self.flow = self._masks[self._count], None
        if before.any() and self.mask.any():
            shift = middle_of(self.mask) - middle_of(before)
            self.flow = self._solver.between(self._gray, gray, window_of(before, 24), shift)
        self._gray = gray
        return self.mask

    def finished(self, frame: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """See `Follower.finished`."""
        return mask

    def state(self) -> dict[str, np.ndarray]:
        """See `Follower.state`."""
        return {"outlined": np.array(self._count)}

    def resume(self, frame: np.ndarray, mask: np.ndarray, state: dict[str, np.ndarray]) -> None:
        """See `Follower.resume`."""
        self._count, self._gray = int(state["outlined"]), cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        self.mask, self.flow = mask, None


def network_tracks(name: str, frames: Frames, mask: np.ndarray, progress: Progress) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tracks of the object's corners from the network `name`: xy (T+1, K, 2) [px], visible (T+1, K) bool and sigma (T+1, K) [px].

    Raises:
        ObjectError: the object has too few corners. ModelError, MissingPackage: the network cannot be used.
    """
    from .models.points import follow_points

    corners = find_corners(frames[0], mask)
    if len(corners) < LEAST_TRACKS:
        raise ObjectError("The object is too plain to follow points on it.", "Leave --track-model out: its silhouette is followed then.")
    return follow_points(name, frames, corners, progress)
