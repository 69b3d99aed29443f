"""Clips of high resolution are observed in a smaller copy; the results are reported in the file's own pixels.

Tracks and outlines gain nothing from thousands of pixels, while the time of every part grows with them. The user's files of the clip's size
are checked at their own size; then smaller copies of them are written to a temporary folder.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from ..masks import Masks
from ..records import Camera, Observation
from ..settings import ObserveSettings
from .clip.camera import read_camera, resized
from .clip.depth import filled, read_depth
from .clip.frames import Clip
from .clip.images import write_png
from .clip.lens import Lens
from .clip.transforms import LENS
from .mask.cutting import grown
from .mask.first_mask import point_list, read_mask
from .tracks.file import load_tracks

LONGEST = 1280
"""Length of the frame's longer side that is enough [px]."""

LEAST_OBJECT = 160
"""Length of the object's longer side below which a smaller copy would lose its pattern [px]."""

ALIKE = 12
"""Difference [grey levels] up to which frame 0 shows the same background as the one that was found, only sharper."""


def working_scale(settings: ObserveSettings, height: int, width: int) -> float:
    """The factor, at most 1, by which frames of `height` and `width` [px] are reduced.

    Raises:
        UsageError: a mask that cannot be read.
    """
    scale = LONGEST / max(height, width)
    side = float(max(height, width))
    if settings.mask is not None:
        rows, columns = np.nonzero(read_mask(settings.mask, height, width))
        side = float(max(np.ptp(rows), np.ptp(columns)) + 1) if len(rows) else side
    elif settings.box is not None and np.isfinite(settings.box).all():
        side = max(settings.box[2] - settings.box[0], settings.box[3] - settings.box[1], 1.0)
    return min(1.0, max(scale, LEAST_OBJECT / side))


class WorkingSize:
    """A clip's own size `file` (H, W) and the size `work` (H, W) at which it is observed [px]."""

    def __init__(self, height: int, width: int, scale: float) -> None:
        self.file = (height, width)
        self.work = (max(1, round(height * scale)), max(1, round(width * scale)))
        self._factor = np.array([width / self.work[1], height / self.work[0]])
        """File pixels per working pixel, x and y."""

    def inward(self, xy: np.ndarray) -> np.ndarray:
        """Working pixels (..., 2) of the file's pixels xy (..., 2); pixel centres are at integers in both."""
        return (np.asarray(xy, dtype=np.float64) + 0.5) / self._factor - 0.5

    def outward(self, xy: np.ndarray) -> np.ndarray:
        """The inverse of `inward`."""
        return (xy + 0.5) * self._factor - 0.5

    def settings(self, settings: ObserveSettings, clip: Clip, folder: Path) -> ObserveSettings:
        """The settings for the smaller copy of `clip`, with smaller copies of the files that they name in `folder`.

        Raises:
            UsageError: one of these files is unusable; the message is in the file's own pixels.
        """
        changes: dict[str, object] = {}
        for name, what in (("mask", "mask"), ("outline", "outline"), ("pin", "pin mask")):
            path = getattr(settings, name)
            if path is not None:
                changes[name] = str(folder / f"{name}.png")
                small = cv2.resize(read_mask(path, *self.file, what).astype(np.float32), self.work[::-1], interpolation=cv2.INTER_AREA)
                write_png(folder / f"{name}.png", (small >= 0.5).astype(np.uint8) * 255)
        if settings.depth is not None:
            depth = read_depth(settings.depth, *self.file)
            changes["depth"] = str(folder / "depth.npy")
            np.save(folder / "depth.npy", cv2.resize(depth, self.work[::-1], interpolation=cv2.INTER_NEAREST))
        if settings.camera is not None:
            camera = read_camera(settings.camera, self.file[1], self.file[0], len(clip.frames), clip.first_frame)
            changes["camera"] = str(folder / "camera.json")
            (folder / "camera.json").write_text(json.dumps(self._camera(camera)), encoding="utf-8")
        if settings.tracks is not None:
            xy, visible, sigma = load_tracks(settings.tracks)
            copy = folder / "tracks" / Path(settings.tracks).name  # messages have the file's name
            copy.parent.mkdir()
            changes["tracks"] = str(copy)
            with open(copy, "wb") as file:
                np.savez(file, xy=self.inward(xy), visible=visible, sigma=sigma / self._factor.mean())
        if settings.box is not None:
            changes["box"] = tuple(float(value) for value in self.inward(np.reshape(settings.box, (2, 2))).ravel())
        if settings.points is not None:
            points = point_list(settings.points, *self.file)
            changes["points"] = tuple(float(value) for value in self.inward(points).ravel())
        if settings.correct is not None:
            rows = np.array(settings.correct, dtype=np.float64).reshape(-1, 4)
            rows[:, 1:3] = self.inward(rows[:, 1:3])
            changes["correct"] = tuple(float(value) for value in rows.ravel())
        if settings.pixels_per_metre is not None:
            changes["pixels_per_metre"] = settings.pixels_per_metre / float(self._factor[0])
        return replace(settings, **changes)  # type: ignore[arg-type]

    def _camera(self, camera: Camera) -> dict[str, object]:
        camera = resized(camera, *self.work)
        values = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
        return {**values, "camera_to_world": np.asarray(camera.camera_to_world).tolist(), **dict(zip(LENS, camera.distortion))}

    def observation(self, seen: Observation, clip: Clip) -> Observation:
        """The observation `seen` of the smaller copy of `clip`, in the file's own pixels."""
        camera = resized(seen.camera, *self.file)
        size = self.file[::-1]
        image = Lens(camera).straight_one(clip.as_filmed(0))
        background = cv2.resize(seen.background, size, interpolation=cv2.INTER_CUBIC)
        # Off the object, frame 0 often shows the same background, only sharper.
        same = (cv2.absdiff(seen.background, seen.image).max(axis=2) < ALIKE) & ~grown(seen.masks[0])
        background[self._larger(same)] = image[self._larger(same)]
        mask = self._larger(seen.masks[0])
        depth = cv2.resize(filled(seen.depth, np.isfinite(seen.depth)), size, interpolation=cv2.INTER_LINEAR)
        return replace(
            seen,
            camera=camera,
            image=image,
            background=background,
            masks=Masks.of(self._larger(one) for one in seen.masks),
            depth=np.where(mask, depth, np.float32(np.inf)),
            pin=np.zeros_like(mask),
            xy=self.outward(seen.xy),
            sigma=seen.sigma * self._factor.mean(),
            recognised=None if seen.recognised is None else seen.recognised.moved(lambda xy, _: self.outward(xy)),
        )

    def _larger(self, mask: np.ndarray) -> np.ndarray:
        return cv2.resize(mask.astype(np.uint8) * np.uint8(255), self.file[::-1], interpolation=cv2.INTER_LINEAR) >= 128
