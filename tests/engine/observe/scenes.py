"""Small clips made on the spot: a patterned disc or a plain ball over a still, noisy background, with every position known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

HEIGHT, WIDTH = 160, 220


@dataclass
class Scene:
    """A clip on disk and what is true of it."""

    path: Path
    frames: np.ndarray
    masks: np.ndarray
    centers: np.ndarray
    angles: np.ndarray

    def moved(self, points: np.ndarray, t: int) -> np.ndarray:
        """Where points (K, 2) of the body in frame 0 are in frame t."""
        angle = self.angles[t] - self.angles[0]
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return (points - self.centers[0]) @ turn.T + self.centers[t]

    @property
    def box(self) -> tuple[float, float, float, float]:
        rows, columns = np.nonzero(self.masks[0])
        return float(columns.min()), float(rows.min()), float(columns.max()), float(rows.max())


def noise(
    rng: np.random.Generator, shape: tuple[int, int], low: tuple[int, int, int], high: tuple[int, int, int], blur: float
) -> np.ndarray:
    """Smooth random colours (h, w, 3) between two colours."""
    raw = cv2.GaussianBlur(rng.standard_normal((*shape, 3)), (0, 0), blur)
    raw = np.clip(0.5 + 0.25 * raw / raw.std(), 0, 1)
    return np.asarray(low) + raw * (np.asarray(high) - np.asarray(low))


def moving_body(
    folder: Path, centers: np.ndarray, angles: np.ndarray, radius: float, texture: np.ndarray | None, fps: float = 30.0, seed: int = 0
) -> Scene:
    """Render a disc of `radius` at `centers` (T+1, 2), turned by `angles` (T+1,) rad; plain white without a texture (h, w, 3) in 0..255."""
    rng = np.random.default_rng(seed)
    background = noise(rng, (HEIGHT, WIDTH), (40, 45, 70), (95, 100, 130), 3.0)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    frames, masks = [], []
    for center, angle in zip(centers, angles):
        dx, dy = columns - center[0], rows - center[1]
        cover = np.clip(radius + 0.5 - np.hypot(dx, dy), 0, 1)
        if texture is None:
            body = np.full((HEIGHT, WIDTH, 3), 235.0)
        else:
            u, v = np.cos(angle) * dx + np.sin(angle) * dy, -np.sin(angle) * dx + np.cos(angle) * dy
            middle = (np.array(texture.shape[:2]) - 1) / 2
            body = cv2.remap(
                texture.astype(np.float32), (u + middle[1]).astype(np.float32), (v + middle[0]).astype(np.float32), cv2.INTER_CUBIC
            )
        frame = background + cover[..., None] * (body - background) + rng.normal(0, 1.0, background.shape)
        frames.append(np.clip(np.round(frame), 0, 255).astype(np.uint8))
        masks.append(cover > 0.5)
    path = folder / "clip.avi"
    write_video(path, frames, fps)
    return Scene(path, np.stack(frames), np.stack(masks), np.asarray(centers), np.asarray(angles))


def overlap(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Intersection over union (T,) of masks (T, H, W) that are not both empty."""
    found, true = np.asarray(found), np.asarray(true)
    return (found & true).sum(axis=(1, 2)) / (found | true).sum(axis=(1, 2))


def write_video(path: Path, frames: list[np.ndarray], fps: float) -> None:
    """RGB frames as Motion JPEG, which every OpenCV can write and read."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, frames[0].shape[1::-1])
    assert writer.isOpened()
    writer.set(cv2.VIDEOWRITER_PROP_QUALITY, 95)
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    writer.release()


def disc_scene(folder: Path) -> Scene:
    """A patterned disc, 34 px in radius, that drifts, accelerates and turns for 12 frames."""
    t = np.arange(13.0)
    centers = np.stack([60 + 6.0 * t, 70 + 0.5 * t + 0.15 * t**2], axis=1)
    texture = noise(np.random.default_rng(7), (90, 90), (120, 40, 20), (255, 200, 110), 1.6)
    return moving_body(folder, centers, 0.03 * t, 34.0, texture)


def ball_scene(folder: Path, acceleration: float = 1.2) -> Scene:
    """A plain ball, ten pixels across, that moves twice its width a frame on a parabola."""
    t = np.arange(10.0)
    centers = np.stack([18.3 + 19.0 * t, 110.4 - 12.0 * t + 0.5 * acceleration * t**2], axis=1)
    return moving_body(folder, centers, 0.0 * t, 5.0, None)


def painted_scene(folder: Path, centers: np.ndarray, angles: np.ndarray, radius: float, body: Callable[..., np.ndarray]) -> Scene:
    """A disc of `radius` at `centers` (T+1, 2), turned by `angles` (T+1,) rad, before mottled paper.

    body(t, dx, dy) gives its colours (h, w, 3) at offsets (h, w) from the centre.
    """
    rng = np.random.default_rng(6)
    paper = noise(rng, (HEIGHT, WIDTH), (95, 82, 66), (150, 136, 114), 1.5)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    frames, masks = [], []
    for t, center in enumerate(centers):
        dx, dy = columns - center[0], rows - center[1]
        cover = np.clip(radius + 0.5 - np.hypot(dx, dy), 0, 1)
        frame = paper + cover[..., None] * (body(t, dx, dy) - paper) + rng.normal(0, 1.0, paper.shape)
        frames.append(cv2.GaussianBlur(np.clip(np.round(frame), 0, 255).astype(np.uint8), (0, 0), 0.8))
        masks.append(cover > 0.5)
    write_video(folder / "clip.avi", frames, 30.0)
    return Scene(folder / "clip.avi", np.stack(frames), np.stack(masks), centers, angles)
