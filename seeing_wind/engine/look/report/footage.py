"""The clip again, for the report: decoded once, reduced for the videos, with a few frames at full size for the measurements."""

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
"""Longer side of the report's images and videos [px], at most: they are looked at, not measured."""


@dataclass(frozen=True)
class Footage:
    """The clip's frames, and what was observed in them."""

    clip: Clip
    """Its frames, at the size of `small`."""
    seen: Observation
    """The observation at the clip's own size."""
    lens: Lens
    small: Observation
    """The observation at the size of the report's videos: only frame, background, masks, tracks, and the matching camera."""

    def straight(self, t: int) -> np.ndarray:
        """Frame t (H, W, 3) uint8 RGB at the file's own size, without lens distortion; t must have been in `keep` of `film`."""
        return self.lens.straight_one(self.clip.as_filmed(t))


def film(observation: Observation, recovery: Recovery, small: Observation, keep: Collection[int], progress: Progress) -> Footage:
    """Decode the observation's frames; those in `keep` also at the file's own size.

    Args:
        small: `reduced(observation)`.

    Raises:
        ClipError: the clip no longer exists, is shorter than the recovery or of another size, or there is no room on disk.
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
    """Raise ClipError if the clip has fewer frames than the recovery."""
    if frames < len(recovery.x):
        raise ClipError(f"The clip has {frames} frames, the recovery {len(recovery.x)}.", "Has the file been changed?")


def reduced(observation: Observation) -> Observation:
    """The observation at the size of the report's videos; unchanged if it is not larger."""
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
