"""Observations made up from formulas."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.records import Camera, Observation

WIDTH, HEIGHT, FOCAL = 96, 72, 90.0


def camera(distance: float = 1.0) -> Camera:
    return Camera(WIDTH, HEIGHT, FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, front_view(distance))


def observed(mask: np.ndarray, depth: np.ndarray | float, xy: np.ndarray | None = None, **changes) -> Observation:
    """A still clip of three frames of an object with the given mask (H, W) and depth [m], coloured smoothly."""
    height, width = mask.shape
    rows, columns = np.mgrid[:height, :width]
    image = np.stack([127 + 90 * np.sin(columns / 9), 127 + 90 * np.cos(rows / 7), 127 + 60 * np.sin((rows + columns) / 11)], axis=-1)
    image = image.round().astype(np.uint8)
    xy = np.argwhere(mask)[:: max(1, int(mask.sum()) // 12), ::-1].astype(float) if xy is None else xy
    tracks = np.repeat(xy[None], 3, axis=0)
    values = Observation(
        clip="made up",
        fps=30.0,
        first_frame=0,
        camera=camera(),
        image=image,
        background=np.zeros_like(image),
        masks=np.repeat(mask[None], 3, axis=0),
        depth=np.where(mask, depth, np.inf).astype(np.float32),
        pin=np.zeros_like(mask),
        xy=tracks,
        visible=np.ones(tracks.shape[:2], dtype=bool),
        sigma=np.full(tracks.shape[:2], 0.2),
        on_centroid=np.zeros(len(xy), dtype=bool),
    )
    return dataclasses.replace(values, **changes)


@pytest.fixture
def plate() -> Observation:
    """A rectangle of 40 x 24 pixels on a plane that leans away to the right."""
    mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
    mask[20:44, 30:70] = True
    # 1 / depth is linear in the pixel for a plane: z = 1 + 0.5 x in camera axes.
    slope = (np.arange(WIDTH) - (WIDTH - 1) / 2) / FOCAL
    return observed(mask, np.broadcast_to(1.0 / (1.0 - 0.5 * slope), mask.shape))


@pytest.fixture
def ball() -> Observation:
    """A ball about ten pixels wide at one distance, tracked by its centroid alone."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    mask = (rows - 36) ** 2 + (columns - 48) ** 2 <= 26
    return observed(mask, 1.0, xy=np.array([[48.0, 36.0]]), on_centroid=np.array([True]))
