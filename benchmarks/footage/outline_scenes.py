"""Synthetic clips with a known outline in every frame, each with something that misleads an outline found from colours.

A painted thing is bent or swung before a still frame, at twice the resolution and over three moments of an open shutter, then grain is
added: a flower on a stem before a curtain of its own tint, a toy that hangs from a balloon of another colour, a ball with its shadow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

FINE = 2
"""Samples per pixel along each axis."""
SHUTTER = (-0.25, 0.0, 0.25)
"""Moments of the exposure [frames], relative to its middle: the shutter is open half of the time."""


@dataclass(frozen=True)
class Painted:
    """A clip and its truth."""

    frames: np.ndarray
    """(T+1, H, W, 3) uint8 RGB."""
    masks: np.ndarray
    """(T+1, H, W) bool: where the thing covers more than half."""
    held: tuple[float, float] | None
    """x, y [px] of the place where it is held."""


Warp = Callable[[float, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Moment, x and y of the frame's pixels -> where they lie on the painting, all [px]."""


def cloth(shape: tuple[int, int], dark: tuple[int, int, int], light: tuple[int, int, int], fold: float, seed: int) -> np.ndarray:
    """A hanging curtain (H, W, 3) float32: folds of about `fold` px, woven threads and blotches."""
    rng = np.random.default_rng(seed)
    height, width = shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    folds = np.sin(2 * np.pi * x / fold + 1.5 * np.sin(x / (2.3 * fold)) + 0.0008 * y * np.sin(x / fold))
    weave = cv2.GaussianBlur(rng.standard_normal(shape).astype(np.float32), (0, 0), 1.4)
    blotches = cv2.GaussianBlur(rng.standard_normal(shape).astype(np.float32), (0, 0), 0.4 * fold)
    shade = 0.5 + 0.24 * folds + 0.1 * weave / weave.std() + 0.08 * blotches / blotches.std()
    return (np.array(dark) + np.clip(shade, 0, 1)[..., None] * (np.array(light) - np.array(dark))).astype(np.float32)


def _filmed(painting: np.ndarray, behind: np.ndarray, warp: Warp, count: int, shadow: tuple[float, float] | None, seed: int):
    """Frames and masks of `painting` (H, W, 4) over `behind` (H, W, 3), FINE times as large as the clip; grain of 3 grey levels."""
    rng = np.random.default_rng(seed)
    height, width = behind.shape[:2]
    y, x = np.mgrid[:height, :width].astype(np.float32)
    size = (width // FINE, height // FINE)
    frames, masks = [], []
    for t in range(count):
        image, cover = np.zeros_like(behind), np.zeros(behind.shape[:2], np.float32)
        for moment in SHUTTER:
            u, v = warp(t + moment, x, y)
            layer = cv2.remap(painting, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
            alpha = layer[..., 3:]
            ground = behind
            if shadow is not None:
                dark = cv2.GaussianBlur(np.roll(layer[..., 3], (int(shadow[1]), int(shadow[0])), (0, 1)), (0, 0), 8.0)
                ground = behind * (1.0 - 0.45 * dark[..., None])
            image += (alpha * layer[..., :3] + (1 - alpha) * ground) / len(SHUTTER)
            cover += alpha[..., 0] / len(SHUTTER)
        small = cv2.GaussianBlur(cv2.resize(image, size, interpolation=cv2.INTER_AREA), (0, 0), 0.7)
        frames.append(np.clip(np.round(small + rng.normal(0, 3.0, small.shape)), 0, 255).astype(np.uint8))
        masks.append(cv2.resize(cover, size, interpolation=cv2.INTER_AREA) > 0.5)
    return np.stack(frames), np.stack(masks)


def _speckled(colors: np.ndarray, seed: int, size: float = 3.0, strength: float = 14.0) -> np.ndarray:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal(colors.shape[:2]).astype(np.float32), (0, 0), size)
    return np.clip(colors + strength * (noise / noise.std())[..., None], 0, 255).astype(np.float32)


def flower(
    petals: tuple[int, int, int],
    curtain: tuple[tuple[int, int, int], tuple[int, int, int]],
    sway: float = 0.16,
    seed: int = 0,
    length: int = 31,
) -> Painted:
    """A flower of `petals`' colour on a green stem with two leaves, 400x460, its foot below the frame, swaying for `length` frames.

    `sway` is the turn of its head [rad]; it bends as a beam that is clamped at the foot.
    """
    height, width = 460 * FINE, 400 * FINE
    rng = np.random.default_rng(seed)
    colors, alpha = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.uint8)
    foot, head = (200 * FINE, 470 * FINE), (200 * FINE, 150 * FINE)

    def paint(draw: Callable[[np.ndarray, int | tuple[int, int, int]], None], color: tuple[int, int, int]) -> None:
        layer = np.zeros((height, width), np.uint8)
        draw(layer, 1)
        colors[layer > 0] = color
        alpha[layer > 0] = 1

    paint(lambda a, c: cv2.line(a, foot, head, c, 7 * FINE), (70, 110, 50))
    for side, at in ((-1, 330), (1, 370)):
        middle = (foot[0] + side * 26 * FINE, at * FINE)
        paint(lambda a, c, m=middle, s=side: cv2.ellipse(a, m, (30 * FINE, 8 * FINE), -s * 35, 0, 360, c, -1), (85, 130, 60))
    for ring, count in ((58, 13), (40, 10), (22, 7)):
        for angle in np.linspace(0, 2 * np.pi, count, endpoint=False) + rng.uniform(0, 1):
            middle = (int(head[0] + ring * 0.7 * FINE * np.cos(angle)), int(head[1] + ring * 0.55 * FINE * np.sin(angle)))
            shade = rng.uniform(0.75, 1.0)
            color = tuple(int(shade * value) for value in petals)
            paint(lambda a, c, m=middle, g=angle: cv2.ellipse(a, m, (18 * FINE, 13 * FINE), np.degrees(g), 0, 360, c, -1), color)
    painting = np.dstack([_speckled(colors, seed + 1), alpha.astype(np.float32)])

    def warp(t: float, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # A clamped beam's deflection grows with the square of the height; its slope turns what sits on it.
        height = float(foot[1] - head[1])
        s = np.clip((foot[1] - y) / height, 0.0, 1.3)
        bend = sway * (np.sin(2 * np.pi * t / 21.0) + 0.35 * np.sin(2 * np.pi * t / 8.3 + 1.0) - 0.29)
        return x - 0.5 * bend * height * s**2, y - bend * s * (x - foot[0])

    frames, masks = _filmed(painting, cloth((height, width), *curtain, 38.0 * FINE, seed + 2), warp, length, None, seed + 3)
    return Painted(frames, masks, (200.0, 459.0))


def hanging_toy(balloon: tuple[int, int, int], toy: tuple[int, int, int], seed: int = 0) -> Painted:
    """A toy on a string under a balloon of another colour, 360x640, rising and swinging before a papered wall with their shadow on it."""
    height, width = 640 * FINE, 360 * FINE
    colors, alpha = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.uint8)
    layer = np.zeros((height, width), np.uint8)
    cv2.line(layer, (180 * FINE, 330 * FINE), (180 * FINE, 400 * FINE), 1, 2 * FINE)
    cv2.ellipse(layer, (180 * FINE, 275 * FINE), (46 * FINE, 58 * FINE), 0, 0, 360, 2, -1)
    cv2.rectangle(layer, (158 * FINE, 400 * FINE), (202 * FINE, 446 * FINE), 3, -1)
    cv2.circle(layer, (180 * FINE, 392 * FINE), 15 * FINE, 3, -1)
    for value, color in ((1, (230, 230, 225)), (2, balloon), (3, toy)):
        colors[layer == value] = color
    alpha[layer > 0] = 1
    cv2.ellipse(colors, (164 * FINE, 250 * FINE), (10 * FINE, 16 * FINE), 20, 0, 360, (250, 235, 235), -1)
    painting = np.dstack([_speckled(colors, seed, 4.0, 9.0), alpha.astype(np.float32)])

    def warp(t: float, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        dx, dy = FINE * (-60 + 3.4 * t), FINE * (70.0 - 4.0 * t - 0.08 * t * t)
        angle = 0.14 * np.sin(0.3 * t)
        x0, y0 = x - dx - 180 * FINE, y - dy - 290 * FINE
        return np.cos(angle) * x0 + np.sin(angle) * y0 + 180 * FINE, -np.sin(angle) * x0 + np.cos(angle) * y0 + 290 * FINE

    wall = cloth((height, width), (120, 112, 100), (188, 178, 160), 60.0 * FINE, seed + 2)
    frames, masks = _filmed(painting, wall, warp, 28, (26.0 * FINE, 20.0 * FINE), seed + 3)
    return Painted(frames, masks, None)


def striped_ball(seed: int = 0) -> Painted:
    """A ball half white, half dark, turning as it flies past a brick-like wall with its shadow, 480x270."""
    height, width = 270 * FINE, 480 * FINE
    y, x = np.mgrid[:height, :width].astype(np.float32)
    middle, radius = (240.0 * FINE, 135.0 * FINE), 34.0 * FINE
    inside = np.hypot(x - middle[0], y - middle[1]) < radius
    colors = np.where((x < middle[0])[..., None], np.array([232, 228, 220], np.float32), np.array([70, 60, 90], np.float32))
    painting = np.dstack([_speckled(colors, seed), inside.astype(np.float32)])
    wall = cloth((height, width), (96, 84, 74), (150, 134, 118), 24.0 * FINE, seed + 2)

    def warp(t: float, px: np.ndarray, py: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        dx, dy = FINE * (-150.0 + 11.0 * t), FINE * (-40.0 - 5.0 * t + 0.32 * t * t)
        angle = 0.06 * t
        u, v = px - dx - middle[0], py - dy - middle[1]
        return np.cos(angle) * u + np.sin(angle) * v + middle[0], -np.sin(angle) * u + np.cos(angle) * v + middle[1]

    frames, masks = _filmed(painting, wall, warp, 24, (14.0 * FINE, 12.0 * FINE), seed + 3)
    return Painted(frames, masks, None)


def carnation(length: int = 31) -> Painted:
    """A pale flower in front of a pale curtain, for `length` frames."""
    return flower((222, 176, 170), ((150, 120, 108), (214, 184, 168)), length=length)


SCENES: dict[str, Callable[[], Painted]] = {
    "carnation": carnation,
    "tulip": lambda: flower((150, 40, 52), ((92, 58, 54), (150, 104, 92)), 0.11, 20),
    "daisy": lambda: flower((236, 232, 214), ((186, 178, 160), (238, 232, 220)), 0.2, 40),
    "hanging_toy": lambda: hanging_toy((196, 40, 48), (60, 90, 170)),
    "hanging_bag": lambda: hanging_toy((220, 190, 60), (120, 96, 80), 50),
    "striped_ball": striped_ball,
}
