"""The worker as a program starts it, and a clip for it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

FLAT = np.full((48, 64, 3), 90, dtype=np.uint8)


def in_a_process_of_its_own(*arguments: object, expect: int) -> list[dict]:
    """Run the worker, check its exit code and that stdout holds JSON lines only."""
    run = subprocess.run([sys.executable, "-m", "seeing_wind.engine", *map(str, arguments)], capture_output=True, text=True, timeout=300)
    messages = [json.loads(line) for line in run.stdout.splitlines()]
    assert run.returncode == expect, (run.returncode, messages[-2:], run.stderr[-2000:])
    return messages


def clip(path: Path, frames: int = 8, moving: bool = True) -> Path:
    """A bright square that drifts over a plain background, or an empty scene."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for t in range(frames):
        frame = FLAT.copy()
        if moving:
            frame[10 + t : 30 + t, 12:32] = 220
        writer.write(frame)
    writer.release()
    return path
