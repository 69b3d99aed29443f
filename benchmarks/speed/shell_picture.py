"""Draws docs/shell.png: a square of cotton held at two neighbouring corners, every fourth frame of its fall.

    python benchmarks/speed/shell_picture.py [--columns 24]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT)]  # a script of the source tree: it runs with the package installed or not

from benchmarks.speed.shell_speed import FPS, SIDE, G, square  # noqa: E402
from seeing_wind.engine.materials import SHEETS  # noqa: E402
from seeing_wind.engine.mpm.shell import advance_frame, at_rest, shell_of, substeps_for  # noqa: E402

SHOWN, EVERY = 4, 4
OUT = ROOT / "docs" / "shell.png"


def simulated(columns: int) -> tuple[list[np.ndarray], np.ndarray]:
    """Vertices (V, 3) [m] of the frames to show, and faces (F, 3)."""
    x, faces = square(columns)
    corners = (x[:, 0] < 1e-9) & ((x[:, 1] < 1e-9) | (x[:, 1] > SIDE - 1e-9))
    shell = shell_of(x, faces, SHEETS["cotton"], pinned=corners)
    substeps = substeps_for(FPS)
    state = at_rest(shell, acceleration=np.broadcast_to(G, x.shape), dt=1.0 / FPS / substeps)
    found = []
    for frame in range(SHOWN * EVERY):
        state = advance_frame(shell, state, frame=frame, fps=FPS, substeps=substeps, gravity=G)
        if frame % EVERY == EVERY - 1:
            found.append(state.x)
    return found, faces


def draw(shapes: list[np.ndarray], faces: np.ndarray) -> None:
    """Side by side, with light from the left."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.colors import LightSource

    figure = plt.figure(figsize=(12.0, 3.6))
    for number, x in enumerate(shapes):
        axes = figure.add_subplot(1, len(shapes), number + 1, projection="3d")
        axes.plot_trisurf(*x.T, triangles=faces, color="#d8c8a8", lightsource=LightSource(60, 40), linewidth=0.0, antialiased=False)
        axes.set(xlim=(-0.1, SIDE), ylim=(0.0, SIDE), zlim=(-SIDE, 0.1), title=f"{(number + 1) * EVERY / FPS:.2f} s")
        axes.set_box_aspect((1.0, 1.0, 1.0))
        axes.view_init(15, 40)
        axes.set_axis_off()
    figure.tight_layout()
    figure.savefig(OUT, dpi=80)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--columns", type=int, default=24)
    draw(*simulated(parser.parse_args().columns))
