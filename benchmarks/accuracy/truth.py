"""Scores `recover-trajectories` and `recover` on data that nobody here made: benchmarks/accuracy/truth.py SHARED [--takes DIR] [CASE ...]

A case is one of those listed without arguments, or "all"; NAME and "NAME 0.5 mm" are cases, too, of a file SHARED/truth/NAME.npz (for
further ones see `genesis_scenes.py`). SHARED holds truth/NAME.npz (bodies moved by known fields in another
simulator), truth/rendered/NAME_vN (the same, rendered from two sides) and clips/ (real footage). Prints a row per case with its bar and
exits with 1 when a bar is missed. With --takes the takes stay in DIR, a folder per case, and what is done there is kept.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from seeing_wind.engine.look.report.accuracy import field_errors, uniform_errors


def engine(*arguments: str | Path) -> dict:
    """Run a verb of the engine as a user would; returns its result."""
    command = [sys.executable, "-m", "seeing_wind.engine", *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode not in (0, 3):  # 3: done with warnings, which are no errors of the force
        sys.exit(f"{' '.join(command)}\nexit code {run.returncode}\n{run.stdout[-2000:]}\n{run.stderr[-2000:]}")
    return json.loads(run.stdout.splitlines()[-1])


def sampled(take: Path, x: np.ndarray) -> np.ndarray:
    """The take's field at the true positions x (T,N,3) [m] -> (T,N,3) [N/m³]."""
    np.save(take / "points.npy", x)
    engine("sample", take, "--points", take / "points.npy", "--out", take / "sampled.npz")
    with np.load(take / "sampled.npz", allow_pickle=False) as data:
        return data["force_density"]


def scores(truth_file: Path, take: Path) -> str:
    """Magnitude and direction error against the truth, beside those of a uniform field with the right net force."""
    truth = np.load(truth_file, allow_pickle=False)
    want, free = truth["acc"] * float(truth["rho"]), ~truth["fixed"]
    got = field_errors(want, sampled(take, truth["x"][:-1]), free)
    flat = uniform_errors(want, free)
    scores.last = got  # type: ignore[attr-defined]
    return f"{got[0]:5.1f} % {got[1]:5.1f} deg   uniform field {flat[0]:5.1f} % {flat[1]:5.1f} deg"


def trajectories(shared: Path, take: Path, name: str) -> str:
    """Exact trajectories of another simulator."""
    engine("recover-trajectories", shared / f"truth/{name}.npz", "--take", take)
    return scores(shared / f"truth/{name}.npz", take)


SEEDS = 5


def noisy(millimetres: float) -> Callable[[Path, Path, str], str]:
    """`trajectories` with smooth noise added: the mean scores over SEEDS draws."""

    def score(shared: Path, take: Path, name: str) -> str:
        file, errors = shared / f"truth/{name}.npz", []
        data = dict(np.load(file, allow_pickle=False))
        for seed in range(SEEDS):
            shaken, draw = take.parent / f"{seed}.npz", take.parent / f"{seed}.take"
            np.savez(shaken, **(data | {"x": data["x"] + smooth_noise(data["x"], 1e-3 * millimetres, seed)}))
            engine("recover-trajectories", shaken, "--take", draw)
            line = scores(file, draw)
            errors.append(scores.last)  # type: ignore[attr-defined]
        mean, spread = np.mean(errors, axis=0), np.std(errors, axis=0)
        scores.last = tuple(mean)  # type: ignore[attr-defined]
        return f"{mean[0]:5.1f} % {mean[1]:5.1f} deg (+- {spread[0]:.1f} % {spread[1]:.1f} deg) {line[line.index('uniform') :]}"

    return score


def smooth_noise(x: np.ndarray, size: float, seed: int, points: int = 12, reach: float = 0.08) -> np.ndarray:
    """Displacements (T+1,N,3) [m]: those of a dozen key points, of standard deviation `size` and drawn anew in every frame, interpolated
    over the body x (T+1,N,3) with Gaussian weights of `reach` [m] that add up to one."""
    some, distance = [0], np.linalg.norm(x[0] - x[0][0], axis=1)
    for _ in range(points - 1):
        some.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(x[0] - x[0][some[-1]], axis=1))
    weight = np.exp(-0.5 * ((x[0][:, None] - x[0][some]) ** 2).sum(axis=-1) / reach**2)
    weight /= weight.sum(axis=1, keepdims=True)
    return np.einsum("nk,tkc->tnc", weight, np.random.default_rng(seed).normal(0.0, size, (len(x), points, 3)))


def pixels(*views: int, by_distance: bool = False) -> Callable[[Path, Path, str], str]:
    """The rendered clip with its camera, mask, held part and first depth; the first of `views` sees, the others add their tracks.

    `by_distance`: instead of the depth of every pixel only the object's median.
    """

    def score(shared: Path, take: Path, name: str) -> str:
        scenes = [shared / f"truth/rendered/{name}_v{view}" for view in views]
        scene, truth = scenes[0], np.load(shared / f"truth/{name}.npz", allow_pickle=False)
        depth = ["--depth", scene / "depth_0000.npy"]
        if by_distance:
            metres = np.load(scene / "depth_0000.npy")
            depth = ["--distance", float(np.median(metres[np.isfinite(metres)]))]
        # The other simulator yields at |dev tau| = Y, `Material` speaks of the uniaxial stress.
        yields = float(np.sqrt(1.5) * truth["yield_stress"])
        plastic = ["--law", "von_mises", "--yield-stress", yields] if yields > 0.0 else []
        pin = ["--pin", scene / "pin_0000.png"] if (scene / "pin_0000.png").exists() else []
        more: list[str | Path] = []
        for other in scenes[1:]:
            more += ["--view", other / "clip.mp4", other / "camera.json", other / "mask_0000.png"]
        engine(
            *("recover", scene / "clip.mp4", "--take", take, "--camera", scene / "camera.json", "--mask", scene / "mask_0000.png"),
            *("--no-gravity", "--density", truth["rho"], "--youngs-modulus", truth["E"], "--poisson-ratio", truth["nu"]),
            *("--report", "full"),
            *(*depth, *plastic, *pin, *more),
        )
        return f"{scores(shared / f'truth/{name}.npz', take)}   {looks(take)}"

    return score


LOOKS = {"first_psnr": 30.0, "psnr": 28.0, "ssim": 0.93}
"""Bars: lowest PSNR [dB] of the splatted first frame inside the mask, and lowest PSNR [dB] and SSIM of the re-simulated clip."""


def looks(take: Path) -> str:
    """How similar the re-simulated clip is to the filmed one, from the take's report."""
    found = json.loads((take / "report.json").read_text())["resimulated"]
    wrong = [name for name, bar in LOOKS.items() if not found.get(name, 0.0) >= bar]
    values = f"look {found.get('first_psnr', 0):.1f} dB, again {found.get('psnr', 0):.1f} dB, SSIM {found.get('ssim', 0):.3f}"
    return values + (f" (too low: {', '.join(wrong)})" if wrong else "")


def ball(shared: Path, take: Path, name: str) -> str:
    """A real ball in free flight: the recovered force over density must be gravity."""
    clip = shared / "clips/ball_toss_osp/BallTossOut.mov"
    engine(
        *("recover", clip, "--take", take, "--fps", 30.19, "--pixels-per-metre", 398.7, "--no-gravity", "--frames", "12:27"),
        *("--box", *BALL_BOX, "--material", "rubber"),
    )
    density = json.loads((take / "report.json").read_text())["material"]["density"]
    with np.load(take / "trajectory.npz", allow_pickle=False) as data:
        a = data["force_density"].mean((0, 1)) / density
    size, angle = np.linalg.norm(a), np.degrees(np.arccos(-a[2] / np.linalg.norm(a)))
    scores.last = (100 * abs(size / 9.8 - 1), angle)  # type: ignore[attr-defined]
    return f"{size:5.2f} m/s² {angle:5.1f} deg off straight down"


BALL_BOX = (175, 150, 200, 175)
Case = tuple[Callable[[Path, Path, str], str], str, float, float]
"""Scoring function, scene, bar in percent, bar in degrees."""
CASES: dict[str, Case] = {
    "sheet": (trajectories, "sheet", 3.0, 3.0),
    "banner": (trajectories, "banner", 11.0, 7.0),
    "clay": (trajectories, "clay", 8.0, 7.0),
    "pole": (trajectories, "pole", 12.0, 10.0),
    "sheet 0.5 mm": (noisy(0.5), "sheet", 5.0, 5.0),
    "banner 0.5 mm": (noisy(0.5), "banner", 15.0, 10.0),
    "clay 0.5 mm": (noisy(0.5), "clay", 10.0, 9.0),
    "pole 0.5 mm": (noisy(0.5), "pole", 18.0, 14.0),
    "sheet 1.5 mm": (noisy(1.5), "sheet", 8.0, 8.0),
    "banner 1.5 mm": (noisy(1.5), "banner", 22.0, 15.0),
    "clay 1.5 mm": (noisy(1.5), "clay", 16.0, 13.0),
    "pole 1.5 mm": (noisy(1.5), "pole", math.inf, math.inf),
    "sheet from pixels": (pixels(0), "sheet", 6.0, 5.0),
    "sheet from the side": (pixels(1), "sheet", 6.0, 5.0),
    "sheet from both": (pixels(0, 1), "sheet", 6.0, 5.0),
    "sheet by distance": (pixels(0, by_distance=True), "sheet", 25.0, 18.0),
    "pole from pixels": (pixels(0), "pole", 15.0, 12.0),
    "pole from the side": (pixels(1), "pole", 15.0, 12.0),
    "pole from both": (pixels(0, 1), "pole", 15.0, 12.0),
    "clay from pixels": (pixels(0), "clay", 18.0, 14.0),
    "clay from the side": (pixels(1), "clay", 18.0, 14.0),
    "clay from both": (pixels(0, 1), "clay", 8.0, 8.0),
    "banner from pixels": (pixels(0), "banner", 30.0, 18.0),
    "ball toss": (ball, "ball", 5.0, 5.0),
}
QUICK = ("sheet", "banner", "sheet from pixels", "ball toss")
"""Cases that run if none is named."""


def further(shared: Path, name: str) -> Case | None:
    """The case of a file that is not among `CASES`, without a bar: NAME, or NAME with so many millimetres of noise. None where none is."""
    match = re.fullmatch(r"(\S+)(?: ([\d.]+) mm)?", name)
    if match is None or not (shared / "truth" / f"{match[1]}.npz").is_file():
        return None
    return trajectories if match[2] is None else noisy(float(match[2])), match[1], math.inf, math.inf


def main() -> int:
    """The quick cases, those named, or "all" of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shared", type=Path, metavar="SHARED")
    parser.add_argument("--takes", type=Path, metavar="DIR")
    parser.add_argument("case", nargs="*", metavar="CASE", default=QUICK, help=f'"all", or some of: {", ".join(CASES)}')
    arguments = parser.parse_intermixed_args()
    names = list(CASES) if "all" in arguments.case else arguments.case
    cases = {name: CASES.get(name) or further(arguments.shared, name) for name in names}
    unknown = [name for name, case in cases.items() if case is None]
    if unknown:
        parser.error(f"no case {', '.join(unknown)}; there are {', '.join(CASES)}, and files in {arguments.shared / 'truth'}")
    missed = 0
    for case, (how, scene, percent, degrees) in cases.items():
        with tempfile.TemporaryDirectory() as folder:
            take = (arguments.takes or Path(folder)) / f"{case.replace(' ', '_')}.take"
            take.mkdir(parents=True, exist_ok=True)
            started = time.perf_counter()
            line = how(arguments.shared.resolve(), take, scene)
            took = time.perf_counter() - started
        good = scores.last[0] <= percent and scores.last[1] <= degrees  # type: ignore[attr-defined]
        missed += not good
        bar = f"bar {percent:g} % {degrees:g} deg" if math.isfinite(percent) else "no bar"
        print(f"{case:20} {line}   {bar}   {took:5.1f} s   {'ok' if good else 'MISSED'}", flush=True)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
