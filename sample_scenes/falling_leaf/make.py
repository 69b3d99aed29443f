"""Builds the sample clip from nothing: a leaf in a known wind, simulated with the engine's solver and rendered with Blender.

    python sample_scenes/falling_leaf/make.py --out DIR [--seed N] [--frames 45] [--size 640x360] [--samples N] [--blender PATH]

What a user of the clip would have: clip.mp4, camera.json, mask_0000.png, box.json (box round the leaf, distance, what it is made of).
For the report only: known_wind.safetensors (the field) and truth.npz (particles and forces), which the recovery never reads.
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
# a script of the source tree: it runs with the package installed or not
sys.path[:0] = [str(HERE), str(HERE.parent / "common"), str(HERE.parents[1])]

if __name__ == "__main__":
    from needs import tell_missing_packages

    tell_missing_packages()

import clip_files  # noqa: E402
import numpy as np  # noqa: E402
from clip_files import Filmed  # noqa: E402
from leaf import make_leaf, make_texture  # noqa: E402
from motion import START, THICKNESS, fly, tilt  # noqa: E402

from seeing_wind.engine.errors import SeeingWindError  # noqa: E402
from seeing_wind.engine.look.report.accuracy import uniform_errors  # noqa: E402

DISTANCE = 2.0
"""From the camera to the leaf in frame 0 [m]."""
VIEW_HEIGHT = 0.98
"""What the frame shows at that distance, top to bottom [m]."""
VIEW_CENTRE = (0.24, -0.25)
"""Where the camera looks, right of and above the leaf's first place [m]."""
MOST_TILT = 60.0
"""Degrees from the camera at which a leaf can no longer be followed."""
SPACING = 0.006
"""Of the particles [m]."""


def main(argv: list[str] | None = None) -> int:
    """Build everything into --out; returns the exit code."""
    about = __doc__ or ""
    chosen = clip_files.options(about, argv, seed=7, frames=45, fps=30.0, size="640x360", samples=12, spacing=SPACING)
    return clip_files.build(chosen, lambda: simulate(chosen.seed, chosen.frames, chosen.fps, chosen.size, chosen.spacing), summary)


def summary(filmed: Filmed) -> str:
    """How it flies, and how hard it is."""
    fall = filmed.x[-1].mean(0) - filmed.x[0].mean(0)
    magnitude, direction = uniform_errors(filmed.truth["acc"])
    return (
        f"The leaf sinks {-fall[2]:.2f} m, drifts {fall[0]:.2f} m and tilts up to {tilt(filmed.x).max():.0f} degrees.\n"
        f"A uniform field with the right net force in every frame would be off by {magnitude:.0f} % and {direction:.0f} degrees."
    )


def simulate(seed: int, frames: int, fps: float, size: tuple[int, int], spacing: float = SPACING) -> Filmed:
    """The leaf's flight in the wind of `seed`, as the camera sees it.

    Raises:
        SeeingWindError: when the flight leaves the frame or turns edge-on; another seed helps.
    """
    leaf = make_leaf(seed)
    flight = fly(leaf, seed, fps, frames, spacing)
    centre = (START[0] + VIEW_CENTRE[0], START[2] + VIEW_CENTRE[1])
    camera = clip_files.level_camera(size, DISTANCE, VIEW_HEIGHT, centre, START[1] - THICKNESS / 2)
    pixels, _ = camera.project(flight.surface)
    if pixels.min() < 2 or (pixels.max((0, 1)) > np.array(size) - 3).any():
        raise SeeingWindError("The leaf leaves the frame.", "Choose another --seed or fewer --frames.")
    if tilt(flight.x).max() > MOST_TILT:
        raise SeeingWindError("The leaf turns its edge to the camera.", "Choose another --seed or fewer --frames.")
    return Filmed(
        name="falling_leaf", x=flight.x, wind=flight.wind, known=clip_files.known_of_solid(flight.material, THICKNESS),
        truth=clip_files.truth_of_solid(flight.material, flight.particles.pinned, flight.v, flight.acceleration),
        surface=flight.surface, triangles=leaf.triangles, uv=leaf.uv, texture=make_texture(seed), camera=camera, distance=DISTANCE,
    )  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
