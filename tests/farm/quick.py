"""Jobs that take seconds, and the batch verb as a user starts it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
LATTICE = 0.1 * np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
QUICK = 'recover = { iterations = 1, stiffness = "given" }'


def trajectories(path: Path, push: float, frames: int = 6) -> None:
    """A block of 27 particles that falls and drifts, pushed with `push` m/s²."""
    time = np.arange(frames)[:, None, None] / 24.0
    x = LATTICE + 0.5 * time**2 * np.array([push, 0.0, -9.81])
    np.savez(path, x=x, fps=24.0, rho=500.0, E=1e4, nu=0.2, gravity=[0.0, 0.0, -9.81])


def clip(path: Path) -> None:
    """A speckled square that drifts over a plain background, 96x64 pixels."""
    import cv2

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (96, 64))
    speckles = cv2.resize(np.random.default_rng(1).integers(0, 255, (8, 8, 3), np.uint8), (32, 32), interpolation=cv2.INTER_CUBIC)
    for t in range(5):
        frame = np.full((64, 96, 3), 90, np.uint8)
        frame[14 + t : 46 + t, 20 + t : 52 + t] = speckles
        writer.write(frame)
    writer.release()


def start(jobs: Path, *options: str) -> subprocess.Popen[str]:
    """The batch verb in a process of its own, as a user starts it."""
    call = [sys.executable, "-m", "seeing_wind.engine", "batch", str(jobs), *options]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, cwd=ROOT)


def messages(process: subprocess.Popen[str]) -> list[dict]:
    """All that a batch has said, after its end."""
    out, log = process.communicate(timeout=1200)
    said = [json.loads(line) for line in out.splitlines()]
    assert said, log[-3000:]
    return said


def outcomes(jobs: Path) -> dict[str, dict]:
    """The rows of the summary by name."""
    rows = json.loads(jobs.with_name("jobs.summary.json").read_text())["jobs"]
    return {row["name"]: row for row in rows}
