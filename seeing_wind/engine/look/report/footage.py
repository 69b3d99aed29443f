"""The clip once more, for the report: decoded once, small for the videos, and a few frames at their own size for what is measured."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...errors import ClipError
from ...masks import Masks
from ...observe.clip.camera import resized
from ...observe.clip.frames import Clip, read_clip
from ...observe.clip.lens import Lens
from ...progress import Progress
from ...records import Observation, Recovery

LONGEST = 1280
"""Pixels of the longer side of the report's images and videos at most: they are looked at, not measured."""


@dataclass(frozen=True)
class Footage:
    """What was filmed, and what was seen in it."""

    clip: Clip
    """Its frames at the size of `small`."""
    seen: Observation
    lens: Lens
    small: Observation
    """The same at the size of the report's videos: only frame, background, masks, tracks, and a camera to go with them."""

    def straight(self, t: int) -> np.ndarray:
        """Frame t (H, W, 3) uint8 RGB at the file's own size without lens distortion; t must have been asked for in `film`."""
        return self.lens.straight_one(self.clip.as_filmed(t))


def film(observation: Observation, recovery: Recovery, small: Observation, keep: Collection[int], progress: Progress) -> Footage:
    """Decode the observation's frames, those in `keep` at the file's own size, too.

    Args:
        small: `reduced(observation)`.

    Raises:
        ClipError: the clip is not there any more, is shorter than the recovery or of another size, or there is no room on disk.
    """
    last = observation.first_frame + observation.frames
    size = small.image.shape[0], small.image.shape[1]
    clip = read_clip(
        observation.clip, (observation.first_frame, last), observation.fps, progress, resized=lambda height, width: size, keep=keep
    )
    if clip.size != observation.image.shape[:2]:
        raise ClipError(f"{observation.clip} is {clip.size[1]}x{clip.size[0]} now.", "Has the file been changed? Recover it again.")
    check_length(len(clip.frames), recovery)
    return Footage(clip, observation, Lens(observation.camera), small)


def check_length(frames: int, recovery: Recovery) -> None:
    """Raises ClipError where the clip has fewer frames than the recovery."""
    if frames < len(recovery.x):
        raise ClipError(f"The clip has {frames} frames, the recovery {len(recovery.x)}.", "Has the file been changed?")


def reduced(observation: Observation) -> Observation:
    """The observation at the size of the report's videos: itself where it is not larger."""
    height, width = observation.image.shape[:2]
    factor = LONGEST / max(height, width)
    if factor >= 1.0:
        return observation
    size = (round(width * factor), round(height * factor))

    def smaller(frame: np.ndarray) -> np.ndarray:
        return cv2.resize(frame, size, interpolation=cv2.INTER_AREA)

    scale = np.array(size) / [width, height]
    return replace(
        observation,
        camera=resized(observation.camera, size[1], size[0]),
        image=smaller(observation.image),
        background=smaller(observation.background),
        masks=Masks.of(smaller(mask.astype(np.uint8) * np.uint8(255)) >= 128 for mask in observation.masks),
        xy=(observation.xy + 0.5) * scale - 0.5,
    )
