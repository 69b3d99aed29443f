"""What Blender's own particles and Sample Wind feel of a recovered field, and what a VDB of it says, against the engine's `sample`.

    SEEING_WIND_PYTHON=... blender -b --factory-startup --python-exit-code 9 --python tests/blender/take_check.py -- TAKE [--reach R]

Prints the table of docs/reference/units.md: mean and median angle and error of the size over the box, the same on the body, and what is
left of the wind beside the box. Ends with exit code 9 when the mean of the box misses `BAR`.
"""

from __future__ import annotations

import argparse
import os
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
solvers = runpy.run_path(str(Path(__file__).with_name("native_solvers_check.py")), run_name="solvers")

from seeing_wind import ui  # noqa: E402
from seeing_wind.engine.take import Take  # noqa: E402
from seeing_wind.ui.field.display import said_of_fit  # noqa: E402
from seeing_wind.ui.field.lattice import CLEAR  # noqa: E402
from seeing_wind.ui.field.samples import read_samples, samples_of  # noqa: E402

PROBES = 120
FRAMES = 6
BAR = (1.0, 0.02)
"""Mean angle [degrees] and mean relative error of the size in the box."""


def sampled(take: Path, points: np.ndarray, frame: int, fade: float | None) -> np.ndarray:
    """The engine's own answer (P, 3) [N/m³], of which a fade over so many metres from the object leaves a part (docs/reference/edit.md)."""
    with tempfile.TemporaryDirectory() as folder:
        places, out = Path(folder) / "points.npy", Path(folder) / "out.npz"
        np.save(places, points)
        call = [os.environ["SEEING_WIND_PYTHON"], "-m", "seeing_wind.engine", "sample", str(take), "--points", str(places)]
        # a Blender that stands elsewhere passes on nothing of its own Python
        clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")} | {"PYTHONPATH": str(ROOT)}
        subprocess.run([*call, "--frame", str(frame), "--out", str(out)], check=True, env=clean, stdout=subprocess.DEVNULL, cwd=ROOT)
        with np.load(out) as found:
            share = np.ones(len(points)) if fade is None else 1.0 - np.clip(found["distance"] / fade, 0.0, 1.0)
            return found["force_density"] * (share**2 * (3.0 - 2.0 * share))[:, None]


def compared(found: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles [degrees] and relative errors of the size where the force is no less than CLEAR of its frame's root mean square."""
    size = np.linalg.norm(truth, axis=1)
    clear = size > CLEAR * np.sqrt((size**2).mean())
    found, truth, size = found[clear], truth[clear], size[clear]
    own = np.linalg.norm(found, axis=1)
    return np.degrees(np.arccos(np.clip((found * truth).sum(1) / (own * size), -1.0, 1.0))), np.abs(own / size - 1.0)


def main() -> None:
    """Build the scene of the take, then measure."""
    parser = argparse.ArgumentParser()
    parser.add_argument("take", type=Path)
    parser.add_argument("--reach", default="FADE")
    options = parser.parse_args(sys.argv[sys.argv.index("--") + 1 :])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    ui.register()
    scene = bpy.context.scene
    scene.seeing_wind.field_reach = options.reach
    bpy.ops.seeing_wind.build_scene(take=str(options.take))
    field = scene.seeing_wind.field_object
    frames, first, density = int(field["seeing_wind_frames"]), int(field["seeing_wind_frame_start"]), field["seeing_wind_density"]
    middle = np.array(field.location)
    box = read_samples(samples_of(field)).box + middle
    body = Take(options.take).read_arrays("trajectory.npz")["x"]
    rng, side = np.random.default_rng(0), float(np.ptp(box, axis=0).max())
    fade = 0.75 * side if options.reach == "FADE" else None
    away = middle + side * np.array([[0.9, 0, 0], [0, 0, -0.9], [0, 1.5, 0], [2.5, 0, 0], [0, -4.0, 0], [0, 0, 10.0]])
    rows: dict[str, list] = {}
    for interval in np.linspace(0, frames - 1, min(FRAMES, frames)).astype(int):
        groups = {"in the box": rng.uniform(*box, (PROBES, 3)), "on the body": body[interval][rng.permutation(body.shape[1])[:PROBES]]}
        points = np.concatenate([*groups.values(), away])
        places, felt = solvers["checks"]["released_accelerations"](scene, field, points, first + interval)
        # both functions measure for the frame rate and density of their own swirl
        felt = felt * field["seeing_wind_fps"] / solvers["FPS"]
        _, read = solvers["sample_wind"](field, points, first + interval + 1)
        read = read * solvers["DENSITY"] / density
        truth = sampled(options.take, places, interval, fade) / density
        start = 0
        for place, group in groups.items():
            part = slice(start, start + len(group))
            start += len(group)
            rows.setdefault(f"particles, {place}", []).append(compared(felt[part], truth[part]))
            rows.setdefault(f"Sample Wind, {place}", []).append(compared(read[part], truth[part]))
        inside = np.linalg.norm(truth[:PROBES], axis=1).mean()
        for name, found in (("particles", felt), ("Sample Wind", read)):
            rows.setdefault(f"{name}, beside", []).append(np.linalg.norm(found[start:], axis=1) / inside)
    print(f"{options.take.name}: {said_of_fit(field)}")
    missed = 0
    for name, parts in rows.items():
        if name.endswith("beside"):
            continue
        angle, size = (np.concatenate(values) for values in zip(*parts, strict=True))
        missed += name.endswith("box") and (angle.mean() > BAR[0] or size.mean() > BAR[1])
        print(f"{name}: {angle.mean():.2f} degrees, {100 * size.mean():.2f} % (median {np.median(angle):.2f}, {100 * np.median(size):.2f})")
    for name in ("particles", "Sample Wind"):
        left = np.mean(rows[f"{name}, beside"], axis=0)
        print(f"{name}, left of the wind 0.9, 0.9, 1.5, 2.5, 4 and 10 box lengths from its middle:", " ".join(f"{x:.2f}" for x in left))
    if missed:
        raise SystemExit(9)


if __name__ == "__main__":
    main()
