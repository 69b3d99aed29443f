"""Builds the sample clip of a potted plant from nothing: a stalk with leaves, held in its pot, in a known wind.

    python sample_scenes/potted_plant/make.py --out DIR [--seed N] [--frames 96] [--size 480x360] [--samples N] [--blender PATH]

What a user of the clip would have: clip.mp4, camera.json, mask_0000.png, held_0000.png (where it is held), box.json.
For the report only: known_wind.safetensors (the field) and truth.npz (particles and forces), which the recovery never reads.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / "common"), str(HERE.parents[1])]  # a script of the source tree

if __name__ == "__main__":
    from needs import tell_missing_packages

    tell_missing_packages()

import numpy as np  # noqa: E402
import plate_scene  # noqa: E402
from gusts import turbulence  # noqa: E402
from outlines import inside  # noqa: E402
from painting import dot  # noqa: E402
from plate_scene import Plate  # noqa: E402
from scipy.ndimage import gaussian_filter  # noqa: E402

from seeing_wind.engine.field.analytic import ForceFieldAnalytic  # noqa: E402

HEIGHT = 0.36
"""Of the stalk, from the pot's soil [m]."""
STALK = 0.026
"""Half its thickness [m]."""
SUNK = 0.05
"""How far it reaches into the pot, where it is held [m]."""
LEAVES = ((0.11, 0.95, 0.19), (0.14, -1.0, 0.18), (0.23, 0.75, 0.16), (0.26, -0.80, 0.15), (0.33, 0.05, 0.15))
"""Height on the stalk [m], angle from straight up [rad, positive to the right], length [m]."""
DENSITY = 300.0
"""kg/m³."""
PLACE = (0.0, 0.0, 0.5)
"""Where the soil is [m]."""


def leaf(height: float, angle: float, length: float) -> np.ndarray:
    """A pointed oval that grows from the stalk (P, 2)."""
    along = np.linspace(0.0, 1.0, 40)
    half = 0.25 * length * np.sqrt(np.clip(np.sin(np.pi * along**0.85), 0.0, None)) * (1.0 - 0.35 * along) + 0.012 * (1.0 - along)
    shape = np.concatenate([np.stack([half, along * length], 1), np.stack([-half, along * length], 1)[::-1]])
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * shape[:, 0] + s * shape[:, 1], -s * shape[:, 0] + c * shape[:, 1] + height], 1)


def plant(seed: int) -> Plate:
    """Stalk and leaves, their frame, and the pot in front of what is held."""
    stalk = np.array([[-STALK, -SUNK], [STALK, -SUNK], [0.6 * STALK, HEIGHT], [-0.6 * STALK, HEIGHT]])
    outlines = [stalk, *(leaf(*each) for each in LEAVES)]
    return Plate(
        name="potted_plant", outlines=outlines, held=lambda flat: flat[:, 1] < 0.0, texture=paint_texture(seed, outlines), texture_side=1.4,
        material="leaf", density=DENSITY, youngs_modulus=6.0e5, thickness=0.012, place=PLACE, view_height=0.95,
        view_centre=(0.05, 0.22), stand=pot(),
    )  # fmt: skip


def paint_texture(seed: int, outlines: list[np.ndarray], size: int = 1400) -> np.ndarray:
    """Greens that differ from leaf to leaf, veins across them, and spots, so that there are corners to track."""
    rng = np.random.default_rng(seed + 1)
    axis = ((np.arange(size) + 0.5) / size - 0.5) * 1.4
    u, v = np.meshgrid(axis, axis[::-1])
    points = np.stack([u, v], -1).reshape(-1, 2)
    image = np.broadcast_to(np.array([0.30, 0.26, 0.12]), (size * size, 3)).copy()
    for outline, (height, angle, length) in zip(outlines[1:], LEAVES, strict=True):
        near = np.abs(points - outline.mean(0)).max(1) < length
        chosen = np.flatnonzero(near)[inside(outline, points[near])]
        c, s = np.cos(angle), np.sin(angle)
        along = s * points[chosen, 0] + c * (points[chosen, 1] - height)
        across = c * points[chosen, 0] - s * (points[chosen, 1] - height)
        green = np.array([0.10, 0.38, 0.10]) + rng.uniform(-0.05, 0.18, 3)
        veins = np.exp(-((np.sin(60.0 * np.pi * (along - 0.7 * np.abs(across))) / 0.35) ** 2)) + 2.0 * np.exp(-((across / 0.0022) ** 2))
        image[chosen] = green + (np.array([0.75, 0.86, 0.45]) - green) * np.clip(0.6 * veins, 0.0, 1.0)[:, None]
    image = image.reshape(size, size, 3)
    shade = gaussian_filter(rng.standard_normal((size, size)), 4)
    image = image * (1.0 + 0.18 * shade / shade.std())[..., None]
    for outline in outlines:
        for _ in range(14):
            centre = outline[rng.integers(len(outline))] * rng.uniform(0.3, 1.0) + outline.mean(0) * rng.uniform(0.0, 0.7)
            cx, cy, radius = (centre[0] / 1.4 + 0.5) * size, (0.5 - centre[1] / 1.4) * size, rng.uniform(3, 6)
            dot(image, cx, cy, radius, rng.choice([[0.9, 0.85, 0.3], [0.12, 0.07, 0.04], [0.85, 0.35, 0.2]]))
    return (np.clip(image, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def pot() -> tuple[np.ndarray, np.ndarray, tuple[float, float, float]]:
    """A round pot, wider at its rim, closed by its soil; its front hides what is held."""
    around = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
    rings = [(0.075, -0.15), (0.10, 0.0), (0.092, 0.0), (0.0, -0.004)]
    vertices = np.array([(r * np.cos(a), r * np.sin(a), z) for r, z in rings for a in around]) + PLACE
    n, triangles = len(around), []
    for ring in range(len(rings) - 1):
        for k in range(n):
            a, b = ring * n + k, ring * n + (k + 1) % n
            triangles += [(a, b, b + n), (a, b + n, a + n)]
    return vertices, np.array(triangles, dtype=np.int32), (0.42, 0.16, 0.07)


def wind(plate: Plate, rng: np.random.Generator, fps: float, frames: int) -> ForceFieldAnalytic:
    """A wind from the side in gusts, stronger higher up, which lifts some leaves and presses others down."""
    t = (np.arange(frames) + 0.5) / fps
    gust = turbulence(t, rng)
    uniform = np.stack([0.5 + 0.4 * gust, 0.02 * gust, 0.1 * gust], 1)
    # half a wave over the height: sideways, so that it runs upward without divergence
    vectors = np.array([[0.0, 0.0, 2.0 * np.pi / 1.1], [2.0 * np.pi / 0.7, 0.0, 0.0]])
    phases = np.array([-2.0 * np.pi / 1.1 * (PLACE[2] + 0.2), 0.3])
    amplitude = np.zeros((frames, 2, 3))
    amplitude[:, 0, 0] = 0.7 * gust
    amplitude[:, 1, 2] = 0.3 * turbulence(t, rng)
    box = np.array([[-0.6, -0.5, 0.2], [0.7, 0.5, 1.4]])
    return ForceFieldAnalytic(box, fps, frames, plate.density * uniform, vectors, phases, plate.density * amplitude)


def main(argv: list[str] | None = None) -> int:
    """Build everything into --out; returns the exit code."""
    return plate_scene.main(plant, wind, argv, __doc__ or "", frames=96)


if __name__ == "__main__":
    sys.exit(main())
