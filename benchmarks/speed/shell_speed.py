"""How long a shell takes: 24 frames of cotton that swings down from its edge, by number of vertices, at 24 frames a second.

    python benchmarks/speed/shell_speed.py [--columns 31 99] [--frames 24]

CPU seconds count all threads; wall seconds only mean something on an idle machine. The aim is 30 s of wall time on two cores for 10,000
vertices. Kernels are compiled, or loaded from where an earlier run keeps them, on a sheet of four vertices before anything is timed.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from seeing_wind.engine.materials import SHEETS
from seeing_wind.engine.mpm.shell import advance, at_rest, shell_of, substeps_for
from seeing_wind.engine.mpm.shell import bending as bend
from seeing_wind.engine.mpm.shell import membrane as stretch
from seeing_wind.engine.mpm.shell.model import Shell, State

SIDE, FPS = 0.8, 24.0
AIM, AIM_VERTICES = 30.0, 10_000
"""s of wall time on two cores for a sheet of so many vertices."""
G = np.array([0.0, 0.0, -9.81])


def square(columns: int) -> tuple[np.ndarray, np.ndarray]:
    """A level square of `columns` by `columns` cells: vertices (V, 3) [m], faces (F, 3)."""
    u, v = np.meshgrid(np.linspace(0.0, SIDE, columns + 1), np.linspace(0.0, SIDE, columns + 1), indexing="ij")
    index = np.arange(u.size).reshape(u.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], 1), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def energy(shell: Shell, state: State) -> float:
    """Of motion, height, stretching and bending [J]."""
    E = stretch.strain(stretch.deformation(shell.membrane, state.x))
    moving = 0.5 * (shell.mass[:, None] * state.v**2).sum() - (shell.mass[:, None] * state.x * G).sum()
    return float(moving + stretch.energy(shell.membrane, E).sum() + bend.energy(shell.bending, state.x))


def measured(columns: int, frames: int) -> None:
    """Simulate and print one line."""
    began = time.process_time()
    x, faces = square(columns)
    shell = shell_of(x, faces, SHEETS["cotton"], pinned=x[:, 0] < 1e-9)
    ready = time.process_time() - began
    substeps = substeps_for(FPS)
    dt = 1.0 / FPS / substeps
    state = at_rest(shell, acceleration=np.broadcast_to(G, x.shape), dt=dt)
    first, wall, cpu, iterations, inner = energy(shell, state), time.perf_counter(), time.process_time(), 0, 0
    for _ in range(frames * substeps):
        state, effort = advance(shell, state, dt=dt, gravity=G)
        iterations += effort.iterations
        inner += effort.inner
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    lost = (first - energy(shell, state)) / (shell.mass.sum() * 9.81 * SIDE)
    steps = frames * substeps
    print(
        f"{len(x):6d} vertices: {ready:5.1f} s CPU to set up; {frames} frames of {substeps} substeps {cpu:6.1f} s CPU, {wall:6.1f} s wall; "
        f"{iterations / steps:.1f} Newton iterations a substep, {inner / iterations:.1f} of conjugate gradients each; "
        f"{100.0 * lost:.1f} % of weight x side lost"
        + (f"; aim {AIM:.0f} s wall on two cores" if len(x) == AIM_VERTICES and frames == 24 else ""),
        flush=True,
    )


def warmed() -> float:
    """CPU seconds until the kernels are ready."""
    began = time.process_time()
    x, faces = square(1)
    shell = shell_of(x, faces, SHEETS["cotton"], pinned=x[:, 0] < 1e-9)
    advance(shell, at_rest(shell), dt=1.0 / FPS / substeps_for(FPS), gravity=G)
    return time.process_time() - began


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--columns", type=int, nargs="+", default=[31, 99])
    parser.add_argument("--frames", type=int, default=24)
    options = parser.parse_args()
    print(f"kernels ready after {warmed():.1f} s CPU", flush=True)
    for count in options.columns:
        measured(count, options.frames)
