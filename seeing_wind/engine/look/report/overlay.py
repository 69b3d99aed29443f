"""overlay.mp4: the clip with the recovered forces drawn on the object, coloured from weak to strong."""

from __future__ import annotations

import cv2
import numpy as np

from ...field import ForceField
from ...field.confidence import farthest_points
from ...field.sampling import sample_points
from ...observe.clip.stored import Frames
from ...observe.clip.video import video_writer
from ...progress import NoProgress, Progress
from ...records import Observation, Recovery
from ...take import Take
from .colours import force_colours, scale_top
from .drawing import Dials, draw_arrow
from .footage import check_length

LONGER = 960
"""Clips with fewer pixels along their longer side are enlarged to at least this many, so that arrows and numbers are not coarse."""

LONGEST = 0.15
"""Length of the strongest arrow over the frame's height."""

SHOWN = 0.15
"""Arrows with less confidence are not drawn; below one half they are pale."""


def write_overlay(
    take: Take,
    frames: Frames,
    observation: Observation,
    recovery: Recovery,
    field: ForceField,
    progress: Progress = NoProgress(),
    sampled: tuple[np.ndarray, np.ndarray] | None = None,
) -> None:
    """Draw the field's forces at the moving particles on every frame and write overlay.mp4 into the take.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB; observation: at the frames' size.
        recovery: the arrows start at its simulated particles.
        sampled: force density (T, N, 3) and confidence (T, N) of `field` at the particles, if known already; sampling takes long.

    Raises:
        ClipError: when `frames` ends before frame T.
        TakeError, MissingPackage: when the video cannot be written.
    """
    check_length(len(frames), recovery)
    drawing = _Drawing(observation, recovery, field.fps, sampled or sample_points(field, recovery.x[:-1]))
    with take.writing("overlay.mp4") as path, video_writer(path, field.fps, drawing.size) as writer:
        for number in range(len(recovery.x)):
            writer.write(cv2.cvtColor(drawing.draw(frames[number], number), cv2.COLOR_RGB2BGR))
            progress.update((number + 1) / len(recovery.x), "overlay.mp4")


class _Drawing:
    """What stays the same throughout the video: which particles carry arrows, the scale, the dials."""

    def __init__(self, observation: Observation, recovery: Recovery, fps: float, sampled: tuple[np.ndarray, np.ndarray]) -> None:
        height, width = observation.image.shape[:2]
        self.zoom = max(1, -(-LONGER // max(width, height)))
        # encoders of 4:2:0 video need even sizes
        self.size = (width * self.zoom // 2 * 2, height * self.zoom // 2 * 2)
        self.camera, self.recovery, self.fps = observation.camera, recovery, fps
        self.chosen = _carriers(observation, recovery.x)
        everywhere, sure = sampled
        self.force, self.confidence = everywhere[:, self.chosen], sure[:, self.chosen]
        self.mean = everywhere.mean(axis=1)
        self.top = scale_top(np.linalg.norm(everywhere, axis=-1))
        self.dials = Dials(self.size, self.top, float(np.linalg.norm(self.mean, axis=1).max()))
        self.metres = LONGEST * height * float(np.abs(self.camera.project(recovery.x[0].mean(axis=0), 0)[1])) / self.camera.fy

    def draw(self, image: np.ndarray, number: int) -> np.ndarray:
        """Frame `number` (H, W, 3) RGB with arrows and dials, at the video's size. The last frame repeats the last interval's force."""
        frame = min(number, len(self.force) - 1)
        canvas = cv2.resize(image, self.size, interpolation=cv2.INTER_CUBIC)
        force, confidence = self.force[frame], self.confidence[frame]
        start = self.recovery.x[number, self.chosen]
        tail, depth = self.camera.project(start, number)
        tip, tip_depth = self.camera.project(start + force / self.top * self.metres, number)
        colours = force_colours(np.linalg.norm(force, axis=1) / self.top)
        paleness = np.clip(1 - 2 * confidence, 0, 1)[:, None]
        colours += paleness * (200 - colours)
        for k in np.argsort(-depth):
            if min(depth[k], tip_depth[k]) > 0 and confidence[k] >= SHOWN:
                draw_arrow(canvas, self._on_canvas(tail[k]), self._on_canvas(tip[k]), tuple(colours[k].tolist()), self.dials.unit)
        rotation = self.camera.pose(number)[:3, :3]
        self.dials.draw(canvas, self.mean[frame] @ rotation, self.mean[frame], number, number / self.fps)
        return canvas

    def _on_canvas(self, pixel: np.ndarray) -> np.ndarray:
        # pixel centres are at integers before and after enlarging
        return (self.camera.filmed(pixel) + 0.5) * self.zoom - 0.5


def _carriers(observation: Observation, x: np.ndarray) -> np.ndarray:
    """Particles that carry arrows: evenly spread, about a twenty-sixth of the frame apart."""
    height, width = observation.image.shape[:2]
    apart = max(height, width) / 26
    count = int(np.clip(observation.masks[0].sum() / apart**2, 7, 70))
    return farthest_points(x[0], min(count, x.shape[1]))
