"""What a recovery costs: benchmarks/speed/cost.py [--frames T ...] [--particles N ...]

Plates in a gusty field (that of schedule.py without its mean wind, in which ten seconds would drive the plate to 16 m/s and through a
wave of the field in half a frame), longer and longer clips, and finer and finer bodies, each in a process of
its own. Counts the processor's seconds of all threads, which other work on the machine hardly changes, and the most memory held. Writes
benchmarks/results/cost.json and docs/recovery_cost.png.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT)]  # a script of the source tree: it runs with the package installed or not

FRAMES, PARTICLES = (24, 48, 96, 192, 300), (64, 128, 256, 512, 1024)
BASE = 24, 128
"""Frames while the particles grow, and particles while the frames do."""


def one(frames: int, particles: int) -> dict:
    """A recovery in this process."""
    from benchmarks.speed.schedule import FPS, MATERIAL, scene
    from seeing_wind.engine.look.report.accuracy import field_errors
    from seeing_wind.engine.progress import NoProgress
    from seeing_wind.engine.recovery.recover import recover

    case = scene(frames, particles, mean=(0.0, 0.0, 0.0), kind=True)
    few = case.seen(min(frames, 6))  # compiles what is needed, not counted
    recover(few.body, MATERIAL, few.targets, FPS, few.settings, NoProgress())
    before, began, started = held(), time.process_time(), time.perf_counter()
    found = recover(case.body, MATERIAL, case.targets, FPS, case.settings, NoProgress())
    spent, took = time.process_time() - began, time.perf_counter() - started
    percent, degrees = field_errors(case.force, found.force_density)
    return {
        "frames": frames, "particles": len(case.body.x), "cpu_seconds": spent, "seconds": took, "more_megabytes": held() - before,
        "magnitude_percent": percent, "direction_degrees": degrees,
    }  # fmt: skip


def held() -> float:
    """Most memory that this process has held [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024.0 if sys.platform != "darwin" else 1024.0**2)


def draw(by_frames: list[dict], by_particles: list[dict]) -> None:
    """Processor time against frames and particles, and memory against frames."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(11, 3.4))
    panels = (
        (by_frames, "frames", "cpu_seconds", "processor seconds", f"{by_frames[0]['particles']} particles"),
        (by_particles, "particles", "cpu_seconds", "processor seconds", f"{by_particles[0]['frames']} frames"),
        (by_frames, "frames", "more_megabytes", "MB more than before", f"{by_frames[0]['particles']} particles"),
    )
    for axis, (rows, across, up, label, title) in zip(axes, panels):
        axis.plot([row[across] for row in rows], [row[up] for row in rows], "o-")
        axis.set(xlabel=across, ylabel=label, title=title, ylim=(0, None), xlim=(0, None))
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(ROOT / "docs/recovery_cost.png", dpi=130)


def main() -> int:
    """All cases, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, nargs="+", default=FRAMES)
    parser.add_argument("--particles", type=int, nargs="+", default=PARTICLES)
    parser.add_argument("--one", type=int, nargs=2, metavar=("T", "N"), help="one case, as JSON")
    options = parser.parse_args()
    if options.one:
        print(json.dumps(one(*options.one)))
        return 0
    rows: dict[str, list[dict]] = {"frames": [], "particles": []}
    for name, cases in (("frames", [(t, BASE[1]) for t in options.frames]), ("particles", [(BASE[0], n) for n in options.particles])):
        for frames, particles in cases:
            command = [sys.executable, __file__, "--one", str(frames), str(particles)]
            row = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1])
            rows[name].append(row)
            print(
                f"{row['frames']:4} frames, {row['particles']:5} particles: {row['cpu_seconds']:7.1f} processor seconds "
                f"({1000 * row['cpu_seconds'] / row['frames']:6.0f} ms a frame), {row['more_megabytes']:6.0f} MB, "
                f"{row['magnitude_percent']:.1f} % {row['direction_degrees']:.1f} deg", flush=True,
            )  # fmt: skip
    draw(rows["frames"], rows["particles"])
    (ROOT / "benchmarks/results/cost.json").write_text(json.dumps(rows, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
