"""Processor seconds of the verb `observe` on a made clip: benchmarks/footage/observe_time.py [--against TREE] [--rounds N]

A painted flower (outline_scenes.py) of 1280x720 sways for 90 frames. With --against, another checkout of this repository (`git worktree
add`) is run in turns with this one, and the ratio is printed: processor seconds, because another program on the machine would
change the others. Seconds of the wall are the least of the rounds.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from outline_scenes import carnation
from outlines import box_round

HERE = Path(__file__).resolve().parents[2]
HEIGHT, WIDTH, FRAMES = 720, 1280, 90
BAR = 10.0
"""Largest processor time [s]."""


def write_clip(path: Path) -> tuple[float, float, float, float]:
    """The clip, and a box round the flower in its first frame."""
    painted = carnation(FRAMES)
    rng = np.random.default_rng(5)
    scale = HEIGHT / painted.frames.shape[1]
    wide = round(painted.frames.shape[2] * scale)
    left = (WIDTH - wide) // 2

    def large(image: np.ndarray) -> np.ndarray:
        return cv2.resize(image, (wide, HEIGHT), interpolation=cv2.INTER_CUBIC)

    beside = cv2.GaussianBlur(large(np.median(painted.frames, axis=0).astype(np.uint8))[:, ::-1], (0, 0), 1.0)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30.0, (WIDTH, HEIGHT))
    for frame in painted.frames:
        image = np.hstack([beside[:, wide - left :], large(frame), beside[:, : WIDTH - wide - left]])
        grain = rng.normal(0.0, 2.0, image.shape)
        writer.write(np.clip(np.round(image + grain), 0, 255).astype(np.uint8)[..., ::-1])
    writer.release()
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[:, left : left + wide] = large(painted.masks[0].astype(np.uint8)) > 0
    return box_round(mask)


def seconds_of(tree: Path, clip: Path, box: tuple[float, ...], folder: Path) -> tuple[float, float]:
    """Seconds of the processor and of the wall that `observe` takes in the checkout `tree`, with a new take in `folder`."""
    numbers = [f"{value:g}" for value in box]
    command = [sys.executable, "-m", "seeing_wind.engine", "observe", str(clip), "--take", str(folder / "a.take"), "--box", *numbers]
    started = time.perf_counter()
    with open(folder / "log", "wb") as log:
        # Compiled modules are kept, as the panel has it, also where the shell forbids it.
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        place = {**kept, "PYTHONPATH": str(tree)}
        job = subprocess.Popen([*command, "--distance", "1"], stdout=log, stderr=log, cwd=folder, env=place)
        _, status, usage = os.wait4(job.pid, 0)
        job.returncode = os.waitstatus_to_exitcode(status)
    if job.returncode:
        sys.exit((folder / "log").read_text(errors="replace"))
    return usage.ru_utime + usage.ru_stime, time.perf_counter() - started


def main() -> int:
    """Both checkouts in turns."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, metavar="TREE")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--clip", nargs=5, metavar=("CLIP", "X0", "Y0", "X1", "Y1"), help="this clip in place of the made one")
    arguments = parser.parse_args()
    trees = {"this": HERE} | ({"other": arguments.against.resolve()} if arguments.against else {})
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in trees}
    with tempfile.TemporaryDirectory() as made:
        clip, box = Path(made) / "flower.mp4", (0.0, 0.0, 0.0, 0.0)
        if arguments.clip:
            clip, box = Path(arguments.clip[0]).resolve(), tuple(float(value) for value in arguments.clip[1:])
        else:
            box = write_clip(clip)
        for _ in range(arguments.rounds):
            for name, tree in trees.items():
                with tempfile.TemporaryDirectory() as folder:
                    found[name].append(seconds_of(tree, clip, box, Path(folder)))
    best = {name: np.min(times, axis=0) for name, times in found.items()}
    for name, (processor, wall) in best.items():
        print(f"{name:6} {processor:6.2f} s of the processor, {wall:6.2f} s of the wall, least of {arguments.rounds}")
    if len(best) == 2:
        print(f"other / this: {best['other'][0] / best['this'][0]:.2f}")
    good = best["this"][0] <= BAR
    print(f"bar: {BAR:g} s of the processor  {'ok' if good else 'MISSED'}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
