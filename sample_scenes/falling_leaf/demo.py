"""The main job from end to end: a clip becomes a force field, an edit and keyframes. `make demo` runs it.

    python sample_scenes/falling_leaf/demo.py --out DIR [--seed N] [--frames 45] [--blender PATH]

1. make.py builds DIR/clip: a leaf in a known wind, rendered.
2. `seeing_wind.engine recover` finds the wind from the clip alone: DIR/wind.take.
3. demo_scene.py, in Blender, inserts ribbons, pins one, doubles the mass of another, re-simulates, bakes: DIR/demo.blend, DIR/edited.mp4.
4. Only then the known wind is read, to say how near the recovery came.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(ROOT)]  # a script of the source tree: it runs with the package installed or not

import make  # noqa: E402
from in_blender import BlenderFailed, run  # noqa: E402

from seeing_wind.engine.conventions import GRAVITY  # noqa: E402
from seeing_wind.engine.errors import SeeingWindError  # noqa: E402
from seeing_wind.engine.field.sampling import sample_points  # noqa: E402
from seeing_wind.engine.field.storage import load_field  # noqa: E402
from seeing_wind.engine.report.accuracy import field_errors, uniform_errors  # noqa: E402

FIRST = 5
"""Pictures over which the first acceleration of a body is taken."""


def main(argv: list[str] | None = None) -> int:
    """Run the whole demo; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", default="build/demo", metavar="DIR")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--frames", type=int, default=45, metavar="T")
    parser.add_argument("--blender", metavar="PATH", help="instead of BLENDER=, the one on the PATH, or the bpy wheel")
    options = parser.parse_args(argv)
    out = Path(options.out).resolve()
    seconds: dict[str, float] = {}
    try:
        print("1/3 building the clip", flush=True)
        arguments = ["--out", str(out / "clip"), "--seed", str(options.seed), "--frames", str(options.frames)]
        arguments += ["--blender", options.blender] if options.blender else []
        began = time.perf_counter()
        if make.main(arguments):
            return 1
        seconds["clip"] = time.perf_counter() - began
        print("2/3 recovering the wind from the clip", flush=True)
        began = time.perf_counter()
        result = recover(out)
        seconds["recovery"] = time.perf_counter() - began
        print("3/3 editing in Blender", flush=True)
        began = time.perf_counter()
        os.environ["SEEING_WIND_PYTHON"] = sys.executable
        run(HERE / "demo_scene.py", [str(out)], options.blender, follow="demo:")
        seconds["Blender"] = time.perf_counter() - began
        print(summary(out, result, seconds))
    except (SeeingWindError, BlenderFailed) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def recover(out: Path) -> dict:
    """Run the worker on the clip and return its result. It is told what someone who filmed the leaf would know, nothing of the wind.

    Raises:
        SeeingWindError: when the recovery fails; the message is the worker's.
    """
    clip = out / "clip"
    known = json.loads((clip / "box.json").read_text())
    command = [sys.executable, "-m", "seeing_wind.engine", "recover", str(clip / "clip.mp4"), "--take", str(out / "wind.take")]
    command += ["--box", *map(str, known["box"]), "--camera", str(clip / "camera.json"), "--distance", str(known["distance"])]
    for name in ("material", "density", "youngs_modulus", "thickness"):
        command += [f"--{name.replace('_', '-')}", str(known[name])]
    result, error, shown = {}, {}, ""
    with (
        open(out / "recover.log", "w", encoding="utf-8") as log,
        subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=log, text=True) as worker,
    ):
        assert worker.stdout is not None
        for line in worker.stdout:
            message = json.loads(line)
            if message["type"] == "result":
                result = message
            elif message["type"] == "error":
                error = message
            elif message["type"] == "warning":
                print(f"  note: {message['message']}", flush=True)
            elif message.get("message") and (now := f"{message['stage']}: {message['message']}") != shown:
                shown = now
                print(f"  {message['fraction']:4.0%} {now}", flush=True)
    if worker.returncode:
        ended = f"The recovery ended with {result.get('outcome', 'no result')}."
        raise SeeingWindError(error.get("message", ended), error.get("hint", f"See {out / 'recover.log'}."))
    return result


def summary(out: Path, result: dict, seconds: dict[str, float]) -> str:
    """The table: how near the recovery came, what the edit did, how long it took, and where everything is."""
    with np.load(out / "clip" / "truth.npz", allow_pickle=False) as truth:
        x, want = truth["x"][:-1], truth["acc"] * float(truth["rho"])
    field = load_field(out / "wind.take" / "field.safetensors")
    recovered, uniform = field_errors(want, sample_points(field, x)[0]), uniform_errors(want)
    report = json.loads((out / "wind.take" / "report.json").read_text())
    bodies = {path.stem: np.load(path)["vertices"] for path in sorted((out / "wind.edit.take" / "bodies").glob("*.npz"))}
    held, one, two = bodies["Ribbon Pinned"], bodies["Ribbon"], bodies["Ribbon Twice the Mass"]
    first_row = np.flatnonzero(held[0, :, 2] > held[0, :, 2].max() - 1e-6)
    drift = 1000 * np.linalg.norm(held[:, first_row] - held[0, first_row], axis=-1).max()
    single, double = (first_acceleration(vertices, field.fps) - GRAVITY for vertices in (one, two))
    residual = report["residual"]
    rows = [
        ("", "magnitude", "direction"),
        ("recovered wind against the known one", f"{recovered[0]:.1f} %", f"{recovered[1]:.1f} degrees"),
        ("a uniform wind with the right net force", f"{uniform[0]:.1f} %", f"{uniform[1]:.1f} degrees"),
        (f"median residual of the tracks ({result['outcome']})", f"{residual['median']:.2f} {report['residual_unit']}", ""),
        ("pinned vertices moved at most", f"{drift:.4f} mm", ""),
        ("wind's push on twice the mass, of the single", f"{np.linalg.norm(double) / np.linalg.norm(single):.3f}", ""),
    ]
    took = {**{f"  {name}": value for name, value in report.get("seconds", {}).items()}}
    rows += [("seconds", "", "")] + [(name, f"{value:.0f}", "") for name, value in {**seconds, **took}.items()]
    files = [
        ("the clip", out / "clip" / "clip.mp4"),
        ("the clip with the recovered forces", out / "wind.take" / "overlay.mp4"),
        ("what the recovery says of itself", out / "wind.take" / "report.png"),
        ("ribbons in the same wind, over the clip", out / "edited.mp4"),
        ("the Blender file", out / "demo.blend"),
    ]
    table = "\n".join(f"  {name:<46}{first:>14}{second:>16}".rstrip() for name, first, second in rows)
    return f"\n{table}\n\n" + "\n".join(f"  {name:<42}{path}" for name, path in files)


def first_acceleration(vertices: np.ndarray, fps: float) -> np.ndarray:
    """Mean acceleration (3,) [m/s²] of a body from rest over the first pictures, from vertices (T+1, V, 3) [m]."""
    t = np.arange(1, FIRST + 1) / fps
    moved = vertices[1 : FIRST + 1].mean(1) - vertices[0].mean(0)
    return 2.0 * (moved * t[:, None] ** 2).sum(0) / (t**4).sum()


if __name__ == "__main__":
    sys.exit(main())
