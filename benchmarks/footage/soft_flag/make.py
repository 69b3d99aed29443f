"""Builds a clip of a flag of thin fabric from nothing: held along its left edge, in gusts of a known velocity, for 4 s.

    python benchmarks/footage/soft_flag/make.py --out DIR --fabric nylon|sailcloth [--seed N] [--frames 96] [--size 480x360]

It is made as the sample scenes are, and DIR gets what theirs get: clip.mp4, camera.json, mask_0000.png, held_0000.png, box.json with the
options for `recover`, and, for the report only, known_wind.safetensors and truth.npz. The sheet is moved by this engine's own shells.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "sample_scenes" / "common"), str(ROOT)]  # a script of the source tree

import clip_files  # noqa: E402
from clip_files import Filmed  # noqa: E402
from flagpole import pole, striped  # noqa: E402
from gusts import turbulence  # noqa: E402
from outlines import flat_mesh  # noqa: E402

from seeing_wind.engine.conventions import GRAVITY  # noqa: E402
from seeing_wind.engine.field.analytic import ForceFieldAnalytic  # noqa: E402
from seeing_wind.engine.look.report.accuracy import uniform_errors  # noqa: E402
from seeing_wind.engine.materials import SHEETS, Sheet  # noqa: E402
from seeing_wind.engine.mpm.shell.model import at_rest, shell_of  # noqa: E402
from seeing_wind.engine.mpm.shell.rollout import advance_frame, substeps_for  # noqa: E402
from seeing_wind.engine.recovery.wind.drag import vertex_drag  # noqa: E402

SAILCLOTH = {"material": "polyester", "density": 600.0, "youngs_modulus": 6.0e8, "thickness": 2.0e-4, "form": "sheet"}
"""As heavy as cotton, with a stiff finish: it bends like card, so it ripples and does not fold [kg/m³, Pa, m]."""
FABRICS: dict[str, dict[str, str | float]] = {"nylon": {"material": "flag_nylon"}, "sailcloth": SAILCLOTH}
"""The options for `recover` by which a fabric is told."""
SIZE = (0.6, 0.4)
"""Width and height of the flag [m]."""
SPACING = 0.025
"""Of its vertices [m]."""
PLACE = (-0.3, 0.0, 1.2)
"""The middle of its held edge [m]."""
HELD = 0.012
"""Width of the strip along the edge that is held [m]."""
DISTANCE, VIEW_HEIGHT, VIEW_CENTRE = 2.0, 0.72, (0.3, -0.04)
"""From the camera; what the frame shows there, top to bottom; where the camera looks, right of and above the held edge [m]."""
EDDY, SHEAR = 1.0, 1.6
"""Wavelengths of the eddies that drift along the flag, and of the change of the wind with height [m]."""
MEAN = (5.0, 0.7, 0.5)
"""Of the wind [m/s]: a gentle breeze along the flag, a little from the front."""
TEXTURE = 1.25
"""Side of the square round the middle of the held edge that the texture covers [m]."""


def main(argv: list[str] | None = None) -> int:
    """Build everything into --out; returns the exit code."""
    fabric = argparse.ArgumentParser(add_help=False)
    fabric.add_argument("--fabric", choices=FABRICS, default="nylon")
    own, rest = fabric.parse_known_args(argv)
    chosen = clip_files.options(__doc__ or "", rest, seed=3, frames=96, fps=24.0, size="480x360", samples=8, spacing=SPACING)
    how = chosen.seed, chosen.frames, chosen.fps, chosen.size, chosen.spacing
    return clip_files.build(chosen, lambda: simulate(own.fabric, *how), summary)


def sheet_of(fabric: str) -> Sheet:
    """The sheet of a fabric's name."""
    known = FABRICS[fabric]
    numbers = [known.get(name) for name in ("density", "youngs_modulus", "poisson_ratio", "thickness")]
    return SHEETS[str(known["material"])].with_own(*(None if number is None else float(number) for number in numbers))


def summary(filmed: Filmed) -> str:
    """How far it moves, and how hard it is."""
    moved, free = np.linalg.norm(filmed.x - filmed.x[0], axis=-1).max(), ~filmed.truth["fixed"]
    magnitude, direction = uniform_errors(filmed.truth["wind"], free)
    return (
        f"Moved up to {100 * moved:.0f} cm, in {np.linalg.norm(filmed.truth['wind'], axis=-1).mean():.1f} m/s of wind.\n"
        f"A uniform wind with the right mean in every frame would be off by {magnitude:.0f} % and {direction:.0f} degrees."
    )


def wind_of(seed: int, fps: float, frames: int) -> ForceFieldAnalytic:
    """A breeze in gusts, stronger higher up, with eddies that drift along the flag. All of it is free of divergence, as air is."""
    rng, t = np.random.default_rng(seed), (np.arange(frames) + 0.5) / fps
    gusts = np.stack([strength * turbulence(t, rng, scale=0.5) for strength in (1.2, 1.0, 0.5)], axis=1)
    k, drift = 2.0 * np.pi / EDDY, rng.uniform(0.0, 2.0 * np.pi) - 2.0 * np.pi / EDDY * MEAN[0] * t
    up = 2.0 * np.pi / SHEAR
    # a travelling wave is two standing ones; the third wave is zero at the middle of the flag's height
    vectors, phases = np.array([[k, 0.0, 0.0], [k, 0.0, 0.0], [0.0, 0.0, up]]), np.array([0.0, np.pi / 2, -up * PLACE[2]])
    amplitude = np.zeros((frames, 3, 3))
    amplitude[:, 0, 1], amplitude[:, 1, 1] = 0.8 * np.cos(drift), 0.8 * np.sin(drift)
    amplitude[:, 0, 2], amplitude[:, 1, 2] = 0.4 * np.sin(drift), 0.4 * np.cos(drift)
    amplitude[:, 2, 0] = 0.9 + 0.4 * turbulence(t, rng, scale=0.5)
    box = np.array([[-0.5, -0.6, 0.5], [0.6, 0.6, 1.7]])
    wind = ForceFieldAnalytic(box, fps, frames, MEAN + gusts, vectors, phases, amplitude)
    wind.kind = "wind"
    return wind


def simulate(fabric: str, seed: int, frames: int, fps: float, size: tuple[int, int], spacing: float = SPACING) -> Filmed:
    """The flag of a fabric, let go flat and at rest, in the wind of `seed` and in gravity, as the camera sees it."""
    wind, sheet = wind_of(seed, fps, frames), sheet_of(fabric)
    width, height = SIZE
    outline = np.array([[0.0, -height / 2], [width, -height / 2], [width, height / 2], [0.0, height / 2]])
    flat, faces = flat_mesh([outline], spacing)
    x, at_vertices = fly(wind, sheet, np.stack([flat[:, 0], 0.0 * flat[:, 0], flat[:, 1]], 1) + PLACE, faces, flat[:, 0] < HELD)
    bar = map(np.asarray, pole(PLACE[0], PLACE[2] + height / 2))
    stand = dict(zip(("stand_vertices", "stand_triangles", "stand_colour"), bar, strict=True))
    return Filmed(
        name="flag", x=x, wind=wind, surface=x, triangles=faces, uv=flat / TEXTURE + 0.5, texture=striped(seed, height, TEXTURE),
        camera=clip_files.level_camera(size, DISTANCE, VIEW_HEIGHT, (PLACE[0] + VIEW_CENTRE[0], PLACE[2] + VIEW_CENTRE[1]), PLACE[1]),
        distance=DISTANCE, held=flat[faces].mean(1)[:, 0] < HELD, more=stand,
        known=FABRICS[fabric],
        truth={
            "wind": at_vertices, "faces": faces, "fixed": flat[:, 0] < HELD, "areal_density": sheet.areal_density,
            "thickness": sheet.thickness, "E": sheet.tensile_stiffness / sheet.thickness, "nu": sheet.poisson_ratio,
        },
    )  # fmt: skip


def fly(
    wind: ForceFieldAnalytic, sheet: Sheet, vertices: np.ndarray, faces: np.ndarray, held: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T+1, V, 3) [m] of the vertices, and the wind (T, V, 3) [m/s] at them."""
    shell = shell_of(vertices, faces, sheet, pinned=held)
    substeps, gravity = substeps_for(wind.fps), np.asarray(GRAVITY)
    state, x, felt = at_rest(shell, acceleration=np.broadcast_to(gravity, vertices.shape), dt=1.0 / (wind.fps * substeps)), [vertices], []
    for t in range(wind.frames):
        felt.append(wind.sample(state.x, t)[0])

        def drag(now: np.ndarray, v: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
            return vertex_drag(wind.sample(now, frame)[0], now, v, shell.surface.faces)

        state = advance_frame(shell, state, frame=t, fps=wind.fps, substeps=substeps, gravity=gravity, load=drag)
        x.append(state.x)
    return np.stack(x), np.stack(felt)


if __name__ == "__main__":
    sys.exit(main())
