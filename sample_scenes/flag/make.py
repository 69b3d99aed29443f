"""Builds the sample clip of a flag from nothing: a sheet held along its left edge, in gusts that are known exactly.

    python sample_scenes/flag/make.py --out DIR [--seed N] [--frames 28] [--size 480x360] [--samples N] [--blender PATH]

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
from flagpole import pole, striped  # noqa: E402
from plate_scene import Plate  # noqa: E402

from seeing_wind.engine.field.analytic import ForceFieldAnalytic  # noqa: E402

SIZE = (0.45, 0.28)
"""Width and height of the sheet [m]."""
HELD = 0.024
"""Width of the edge that is held [m]."""
DENSITY = 300.0
"""kg/m³."""
WAVELENGTH = 0.5
"""Of the gusts that run along the sheet [m]."""


def flag(seed: int) -> Plate:
    """The sheet, its frame, and the pole behind its held edge."""
    width, height = SIZE
    outline = np.array([[0.0, -height / 2], [width, -height / 2], [width, height / 2], [0.0, height / 2]])
    return Plate(
        name="flag", outlines=[outline], held=lambda flat: flat[:, 0] < HELD, texture=striped(seed, height, 1.0), texture_side=1.0,
        material="leaf", density=DENSITY, youngs_modulus=3.0e4, thickness=0.012, place=(-0.2, 0.0, 1.2), view_height=0.62,
        view_centre=(0.22, -0.02), bears_weight=False, stand=pole(-0.2, 1.2 + height / 2),
    )  # fmt: skip


def wind(plate: Plate, rng: np.random.Generator, fps: float, frames: int) -> ForceFieldAnalytic:
    """A pull along the sheet that carries most of its weight, and gusts up and down that run along it."""
    t = (np.arange(frames) + 0.5) / fps
    swell = np.sin(2.0 * np.pi * t / rng.uniform(0.8, 1.0))
    uniform = np.stack([4.0 + 2.0 * swell, 0.4 * swell, 8.0 + 1.0 * np.cos(2.0 * np.pi * t / rng.uniform(0.5, 0.7))], 1)
    k = 2.0 * np.pi / WAVELENGTH
    speed, turn = rng.uniform(0.9, 1.2), rng.uniform(0.0, 2.0 * np.pi)
    # a travelling wave is two standing ones; both blow across the way they run, so they are free of divergence
    vectors, phases = np.array([[k, 0.0, 0.0]] * 2), np.array([0.0, np.pi / 2])
    drift = turn - k * speed * t
    amplitude = np.zeros((frames, 2, 3))
    amplitude[:, 0, 2], amplitude[:, 1, 2] = 6.0 * np.cos(drift), 6.0 * np.sin(drift)
    amplitude[:, 0, 1], amplitude[:, 1, 1] = 1.2 * np.sin(drift), 1.2 * np.cos(drift)
    box = np.array([[-0.5, -0.4, 0.7], [0.6, 0.4, 1.7]])
    return ForceFieldAnalytic(box, fps, frames, plate.density * uniform, vectors, phases, plate.density * amplitude)


def main(argv: list[str] | None = None) -> int:
    """Build everything into --out; returns the exit code."""
    return plate_scene.main(flag, wind, argv, __doc__ or "", frames=28)


if __name__ == "__main__":
    sys.exit(main())
