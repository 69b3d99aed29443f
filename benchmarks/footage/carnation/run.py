"""The rendered carnation from a box to the report: benchmarks/footage/carnation/run.py DIR [OPTION ...], with what render.py left
in DIR and options for `recover`.

As docs/guide/real-footage.md says: `observe` with a box, then `recover` with the place that `observe` proposes as held.
Prints the outline's overlap with the masks, how much of it is curtain, where it is held, and seconds of the processor; exit code 1 says
that a bar is missed. The take stays in DIR/carnation.take, with its frames. With --iterations 1 it is the draft that the guide speaks of.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from outlines import box_round, overlap  # noqa: E402

from seeing_wind.engine.record_arrays import TRAJECTORY, from_arrays, read_body  # noqa: E402
from seeing_wind.engine.records import Observation  # noqa: E402
from seeing_wind.engine.take import Take  # noqa: E402

OUTLINE, CURTAIN, FOOT, SECONDS, OFF = 0.75, 0.05, 0.12, 120.0, 2.0
"""Least overlap in any frame; most of the outline that is curtain, 3 px and more off the flower; part of the flower's height within which
the held place lies; seconds of the processor of both verbs, of two processors together half of it; pixels from the simulation to the
tracks, in the median of all that are seen."""
BESIDE = 3
"""Pixels."""


def run(take: Path, *words: str) -> tuple[dict, float, float]:
    """One verb of the engine: its result, and seconds of the processor and of the wall."""
    started, before = time.perf_counter(), os.times()
    job = subprocess.run([sys.executable, "-m", "seeing_wind.engine", *words, "--take", str(take)], capture_output=True, text=True)
    after = os.times()
    result = json.loads(job.stdout.splitlines()[-1])
    if job.returncode:
        sys.exit(f"{words[0]}: {result}")
    spent = after.children_user - before.children_user + after.children_system - before.children_system
    return result, spent, time.perf_counter() - started


def main() -> int:
    """Both verbs, and what came of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    arguments, options = parser.parse_known_args()
    folder = arguments.folder.resolve()
    truth = json.loads((folder / "truth.json").read_text())
    with np.load(folder / "masks.npz", allow_pickle=False) as data:
        true = dict(zip(data["frames"].tolist(), data["masks"]))
    take = folder / "carnation.take"
    shutil.rmtree(take, ignore_errors=True)
    clip = [str(folder / "frame_*.png"), "--fps", f"{truth['fps']:g}", "--pixels-per-metre", f"{truth['pixels_per_metre']:g}"]
    box = ["--box", *(f"{value:g}" for value in box_round(true[0]))]
    looked, seconds, wall = run(take, "observe", *clip, *box)
    print(f"observe: {seconds:.1f} s of the processor, {wall:.1f} s of the wall")
    for one in looked["verdicts"]:
        print(f"  {one['severity']:.2f} {one['item']}: {one['because']}")
    held = take / "held.png"
    kept = held.with_name("held_at_first.png")
    if held.exists():
        shutil.copy(held, kept)
    pin = ["--pin", str(kept)] if held.exists() else []
    result, spent, wall = run(take, "recover", *clip, *box, *pin, "--material", "plant_stem", *options)
    print(f"recover: {spent:.1f} s of the processor, {wall:.1f} s of the wall; {result['outcome']}")
    for one in result.get("warnings", []):
        print(f"  {one}")
    seen = from_arrays(Observation, Take(take).read_arrays("observation.npz"))
    masks = {t: np.asarray(seen.masks[t]) for t in true}
    overlaps = [overlap(masks[t], true[t]) for t in true]
    near = {t: cv2.dilate(mask.astype(np.uint8), np.ones((2 * BESIDE + 1,) * 2, np.uint8)) > 0 for t, mask in true.items()}
    curtain = [float((masks[t] & ~near[t]).sum() / max(masks[t].sum(), 1)) for t in true]
    rows = np.nonzero(true[0])[0]
    place = np.nonzero(seen.pin)[0]
    depth = float((rows.max() - place.min()) / np.ptp(rows)) if len(place) else float("inf")
    print(f"outline: median {np.median(overlaps):.3f}, worst {min(overlaps):.3f}; curtain at most {100 * max(curtain):.1f} % of it")
    print(f"held: the lowest {100 * depth:.0f} % of the flower")
    body = read_body(Take(take))
    with np.load(take / TRAJECTORY, allow_pickle=False) as data:
        places = body.keypoints.follow(data["x"])
    on_body = seen.visible & np.isfinite(body.lifted).all(axis=-1)
    off = [np.linalg.norm(seen.camera.project(x, t)[0] - seen.xy[t], axis=1)[on_body[t]] for t, x in enumerate(places)]
    median = float(np.median(np.concatenate(off[1:])))
    by_frame = [float(np.median(one)) for one in off[1:]]
    print(f"simulation: {median:.2f} px off the tracks in the median; by frame {min(by_frame):.1f} to {max(by_frame):.1f} px")
    bars = {
        "outline": min(overlaps) >= OUTLINE,
        "curtain": max(curtain) <= CURTAIN,
        "held": depth <= FOOT,
        "seconds": spent + seconds <= SECONDS,
        "simulation": median <= OFF,
    }
    print("missed: " + ", ".join(name for name, good in bars.items() if not good) if not all(bars.values()) else "All bars are met.")
    return 0 if all(bars.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
