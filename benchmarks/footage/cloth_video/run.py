"""The wind on filmed cloth: benchmarks/footage/cloth_video/run.py DIR [OPTION ...], with what render.py left in DIR and options for
`recover`.

`recover` gets the clip, and of frame 0 camera, mask, depth and held places; of the sheet the weight per area, thickness and stiffness.
Printed: how far the sheet that is followed is from the true one, in the median and the mean [mm]; the error of the wind at the true
vertices, in size [%] and direction [degrees]; the same of two answers that know the true wind but not its shape: its mean over the sheet
in every frame, and over the clip. The take stays in DIR/cloth.take, with its frames.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from benchmarks.accuracy.wind_truth import engine, errors  # noqa: E402
from seeing_wind.engine.observe.object.sheet.riding import ride_flat  # noqa: E402
from seeing_wind.engine.reading import read_arrays  # noqa: E402
from seeing_wind.engine.record_arrays import read_body  # noqa: E402
from seeing_wind.engine.take import Take  # noqa: E402


def followed(take: Path, truth: dict[str, np.ndarray]) -> np.ndarray:
    """(T+1, V) distances [m] of the true vertices from the sheet that was followed, at the points that are nearest in frame 0."""
    body = read_body(Take(take))
    assert body.path is not None
    true, found = truth["x"][: len(body.path)].astype(float), body.surface.vertices
    centre = true[0].mean(axis=0)
    axes = np.linalg.svd(true[0] - centre, full_matrices=False)[2][:2].T
    return np.linalg.norm(ride_flat((true[0] - centre) @ axes, (found - centre) @ axes).follow(body.path) - true, axis=-1)


def main() -> None:
    """One line of a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    arguments, options = parser.parse_known_args()
    folder = arguments.folder.resolve()
    truth, take = read_arrays(folder / "truth.npz"), folder / "cloth.take"
    shutil.rmtree(take, ignore_errors=True)
    thickness = float(truth["thickness"])
    words = ["--fps", f"{float(truth['fps']):g}", "--form", "sheet", "--material", "cotton", "--report", "quick"]
    for name in ("mask.png", "depth.npy", "camera.json"):
        words += [f"--{Path(name).stem}", str(folder / name)]
    words += ["--density", f"{float(truth['areal_density']) / thickness:g}", "--thickness", f"{thickness:g}"]
    words += ["--youngs-modulus", f"{float(truth['E']):g}", "--poisson-ratio", f"{float(truth['nu']):g}"]
    words += ["--pin", str(folder / "held.png")] if truth["fixed"].any() else []
    begun = time.perf_counter()
    engine("recover", folder / "frame_*.png", "--take", take, *words, *options)
    minutes = (time.perf_counter() - begun) / 60.0
    away = followed(take, truth)
    frames = len(away) - 1
    np.save(folder / "points.npy", truth["x"][:frames].astype(float))
    engine("sample", take, "--points", folder / "points.npy", "--out", folder / "sampled.npz")
    free = ~truth["fixed"].astype(bool)
    true = truth["wind"][:frames, free].astype(float)
    found = read_arrays(folder / "sampled.npz")["wind_velocity"][:, free]
    pairs = [errors(np.broadcast_to(one, true.shape), true) for one in (found, true.mean(axis=1, keepdims=True), true.mean(axis=(0, 1)))]
    heads = ("clip", "frames", "minutes", "sheet off, mm, median / mean", "wind: size % / degrees", "best uniform wind of each frame")
    print(f"| {' | '.join(heads)} | best constant wind |")
    print("|---|---|---|---|---|---|---|")
    figures = " | ".join(f"{size:.1f} / {direction:.1f}" for size, direction in pairs)
    print(f"| {folder.name} | {frames} | {minutes:.1f} | {1e3 * np.median(away):.1f} / {1e3 * away.mean():.1f} | {figures} |")


if __name__ == "__main__":
    main()
