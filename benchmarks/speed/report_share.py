"""What a whole `recover` of a large clip costs: benchmarks/speed/report_share.py [--size W H] [--frames T ...] [-- OPTION ...]

A textured square turns and swings before a mottled wall. Prints, for each length, the share of each stage and of each of the report's
products, and the most memory that the engine's process held. Exits with 1 where the report takes more than a fifth, or the memory of the
longest clip is more than a quarter above that of the shortest. Options after -- are the engine's, such as --particles 64 --report full.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

FPS = 30.0
PERIOD = 30
"""Frames of the swing: the clip repeats its frames, which are linked and not made again."""
FIFTH, GROWTH = 0.2, 1.25


def clip(folder: Path, width: int, height: int, frames: int) -> tuple[int, int, int, int]:
    """Write the clip's frames into `folder`; returns the box round the square in the first one [px]."""
    rng = np.random.default_rng(0)

    def mottled(rows: int, columns: int, cell: int) -> np.ndarray:
        coarse = rng.integers(0, 256, (rows // cell + 2, columns // cell + 2, 3)).astype(np.uint8)
        return cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_CUBIC)

    side = min(width, height) // 5
    wall = (0.35 * mottled(height, width, max(8, width // 60)) + 60).astype(np.uint8)
    square = mottled(side, side, max(3, side // 24))
    boxes = []
    for t in range(frames):
        path = folder / f"{t:05d}.jpg"
        if t >= PERIOD:
            os.link(folder / f"{t % PERIOD:05d}.jpg", path)
            continue
        phase = 2.0 * np.pi * t / PERIOD
        turn = cv2.getRotationMatrix2D((side / 2, side / 2), 6.0 * np.sin(phase), 1.0)
        turn[:, 2] += [width * (0.35 + 0.1 * np.sin(phase)), height * (0.35 + 0.06 * np.sin(phase + 0.5))]
        cover = cv2.warpAffine(np.ones((side, side), np.float32), turn, (width, height))
        image = np.where(cover[..., None] > 0.5, cv2.warpAffine(square, turn, (width, height)), wall)
        cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, 95])
        rows, columns = np.nonzero(cover > 0.5)
        boxes.append((columns.min() - 3, rows.min() - 3, columns.max() + 3, rows.max() + 3))
    return tuple(int(value) for value in boxes[0])  # type: ignore[return-value]


def cost(width: int, height: int, frames: int, options: list[str]) -> dict:
    """Seconds per stage, of the report's products and of the whole, and the most memory held [MB], of one `recover`."""
    with tempfile.TemporaryDirectory() as home:
        folder, take = Path(home) / "clip", Path(home) / "a.take"
        folder.mkdir()
        box = clip(folder, width, height, frames)
        command = [sys.executable, "-m", "seeing_wind.engine", "recover", str(folder), "--take", str(take), "--fps", str(FPS)]
        command += ["--box", *map(str, box), "--distance", "2", "--no-gravity", *options]
        started = time.perf_counter()
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=Path(__file__).resolve().parents[2]) as engine:
            # wait4 tells of this process alone, unlike getrusage over all children.
            _, status, usage = os.wait4(engine.pid, 0)
            engine.returncode = os.waitstatus_to_exitcode(status)
        whole = time.perf_counter() - started
        if engine.returncode:
            sys.exit(f"{' '.join(command)}\nexit code {engine.returncode}")
        report = json.loads((take / "report.json").read_text()) if (take / "report.json").is_file() else {}
    held = usage.ru_maxrss / (1024.0 if sys.platform != "darwin" else 1024.0**2)
    stages = {name: seconds for name, seconds in report.get("seconds", {}).items() if name != "total"}
    return {"whole": whole, "stages": stages, "products": report.get("report", {}).get("seconds", {}), "megabytes": held}


def main() -> int:
    """All lengths, one after the other."""
    words = sys.argv[1:]
    cut = words.index("--") if "--" in words else len(words)
    own, engines = words[:cut], words[cut + 1 :]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, nargs=2, default=(1080, 1920), metavar=("W", "H"))
    parser.add_argument("--frames", type=int, nargs="+", default=(50, 100), metavar="T")
    options = parser.parse_args(own)
    good, held = True, []
    for frames in options.frames:
        found = cost(*options.size, frames, engines)
        report = sum(found["products"].values())
        share = report / found["whole"]
        print(f"{frames} frames of {options.size[0]}x{options.size[1]}: {found['whole']:.0f} s, at most {found['megabytes']:.0f} MB")
        for name, seconds in found["stages"].items():
            print(f"  {name:16} {seconds:7.1f} s {100 * seconds / found['whole']:5.1f} %")
        print(f"  {'report':16} {report:7.1f} s {100 * share:5.1f} %")
        for name, seconds in found["products"].items():
            print(f"    {name:14} {seconds:7.1f} s {100 * seconds / found['whole']:5.1f} %", flush=True)
        good &= share <= FIFTH
        held.append(found["megabytes"])
    print("the report takes at most a fifth" if good else "the report takes more than a fifth")
    flat = held[-1] <= GROWTH * held[0]
    print(f"memory {held[-1] / held[0]:.2f} times that of the shortest clip")
    return 0 if good and flat else 1


if __name__ == "__main__":
    sys.exit(main())
