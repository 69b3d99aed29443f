"""The main job from end to end: a clip becomes a force field, an edit and keyframes. `make demo` runs it.

    python sample_scenes/falling_leaf/demo.py --out DIR [--seed N] [--frames 45] [--blender PATH]

1. make.py builds DIR/clip: a leaf in a known wind, rendered.
2. `seeing_wind.engine recover` finds the wind from the clip alone: DIR/wind.take.
3. demo_scene.py, in Blender, hangs washing on a line, lets leaves fly, one at twice the mass, re-simulates, bakes: DIR/demo.blend,
   DIR/edited.mp4.
4. Only then the known wind is read, to say how near the recovery came: DIR/demo.json, which check.py holds against the bars.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(HERE.parent / "common"), str(ROOT)]  # a script of the source tree: it runs with the package installed or not

if __name__ == "__main__":
    from needs import tell_missing_packages

    tell_missing_packages()

import cv2  # noqa: E402
import make  # noqa: E402
import numpy as np  # noqa: E402
from check import HELD  # noqa: E402
from in_blender import BlenderFailed, run  # noqa: E402
from leaf import make_leaf, make_texture  # noqa: E402

from seeing_wind.engine.errors import SeeingWindError  # noqa: E402
from seeing_wind.engine.field.sampling import sample_points  # noqa: E402
from seeing_wind.engine.field.storage import load_field  # noqa: E402
from seeing_wind.engine.look.report.accuracy import field_errors, uniform_errors  # noqa: E402
from seeing_wind.engine.recovery.resimulate import simulate_bodies  # noqa: E402
from seeing_wind.engine.settings import Edit  # noqa: E402
from seeing_wind.engine.settings.tables import read_edit  # noqa: E402

FIRST = 5
"""Frames over which the first acceleration of a body is taken."""
FIGURES = "demo.json"
"""What was measured, for check.py."""
LEAVES, TEXTURE = 3, 256
"""Leaves beside the filmed one, each of its own shape, and the side of their frames [px]."""


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
    out.mkdir(parents=True, exist_ok=True)
    # what an earlier run left must not pass for this one's
    (out / FIGURES).unlink(missing_ok=True)
    for edit in out.glob("wind.edit*.take"):
        shutil.rmtree(edit)
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
        os.environ.setdefault("SEEING_WIND_PYTHON", sys.executable)
        press_leaves(out, options.seed)
        run(HERE / "demo_scene.py", [str(out)], options.blender, follow="demo:")
        seconds["Blender"] = time.perf_counter() - began
        figures = measure(out) | {"outcome": result["outcome"], "seconds": {name: round(value, 1) for name, value in seconds.items()}}
        (out / FIGURES).write_text(json.dumps(figures, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        print(summary(out, figures))
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
    python = os.environ.get("SEEING_WIND_PYTHON", sys.executable)
    command = [python, "-m", "seeing_wind.engine", "recover", str(clip / "clip.mp4"), "--take", str(out / "wind.take")]
    command += ["--box", *map(str, known["box"]), "--camera", str(clip / "camera.json"), "--distance", str(known["distance"])]
    command += ["--outline-model", "none"]  # so that the figures do not depend on what else is installed
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


def press_leaves(out: Path, seed: int) -> None:
    """More leaves of the filmed one's kind, for demo_scene.py: leaf_K.npz, vertices u v [m] in meshes coarse enough for a shell, and
    leaf_K.png, as fine as they are seen: they are smaller.

    Raises:
        SeeingWindError: a file cannot be written.
    """
    for k in range(LEAVES):
        leaf = make_leaf(seed + 1 + k, edge=0.016)
        np.savez(out / f"leaf_{k}.npz", vertices=leaf.vertices, triangles=leaf.triangles, uv=leaf.uv)
        texture = cv2.resize(make_texture(seed + 1 + k), (TEXTURE, TEXTURE), interpolation=cv2.INTER_AREA)
        if not cv2.imwrite(str(out / f"leaf_{k}.png"), texture[:, :, ::-1]):
            raise SeeingWindError(f"Cannot write {out}/leaf_{k}.png.", "Choose another folder.")


def measure(out: Path) -> dict:
    """How near the recovery came to the known wind, and whether the edit did what it should."""
    with np.load(out / "clip" / "truth.npz", allow_pickle=False) as truth:
        x, want = truth["x"][:-1], truth["acc"] * float(truth["rho"])
    field = load_field(out / "wind.take" / "field.safetensors")
    recovered, uniform = field_errors(want, sample_points(field, x)[0]), uniform_errors(want)
    report = json.loads((out / "wind.take" / "report.json").read_text())
    return {
        "magnitude_percent": recovered[0],
        "direction_degrees": recovered[1],
        "uniform_magnitude_percent": uniform[0],
        "uniform_direction_degrees": uniform[1],
        "residual_median": report["residual"]["median"],
        "residual_unit": report["residual_unit"],
        "pinned_moved_mm": pinned_moved(out / "wind.edit.take"),
        "doubled_mass_acceleration": doubled_mass_acceleration(out),
        "frames": len(x) + 1,
        "recovery_seconds": report.get("seconds", {}),
        "expected_seconds": report.get("expected_seconds", {}),
    }


def pinned_moved(edit: Path) -> float:
    """How far any pinned vertex is from its first place at any time [mm]."""
    moved = []
    for name in HELD:
        held = np.load(edit / "pins" / f"{name}.npy", allow_pickle=False)
        with np.load(edit / "bodies" / f"{name}.npz", allow_pickle=False) as body:
            vertices = body["vertices"][:, held]
        moved.append(np.linalg.norm(vertices - vertices[0], axis=-1).max())
    return float(1000.0 * max(moved))


def doubled_mass_acceleration(out: Path) -> float:
    """First acceleration of the leaf of twice the mass over the single one's: the edit again, both in one place, without gravity."""
    folder = out / "wind.edit.take"
    bodies = {body.name: body for body in read_edit(str(folder / "edit.toml")).body}
    one = dataclasses.replace(bodies["Leaf"], start_frame=0)
    two = dataclasses.replace(bodies["Leaf Twice the Mass"], mesh=one.mesh, start_frame=0)
    field = load_field(out / "wind.take" / "field.safetensors")
    field.frames = min(FIRST, field.frames)  # the rest of the motion is not asked for
    edit = Edit(body=(one, two), gravity=(0.0, 0.0, 0.0))
    moved = simulate_bodies(edit, field, None, folder)
    single, double = (np.linalg.norm(first_acceleration(moved[body.name].vertices, field.fps)) for body in (one, two))
    return float(double / single)


def summary(out: Path, figures: dict) -> str:
    """The table: how near the recovery came, what the edit did, how long it took, and where everything is."""
    rows = [
        ("", "magnitude", "direction"),
        ("recovered wind against the known one", *errors(figures)),
        ("a uniform wind with the right net force", *errors(figures, "uniform_")),
        (f"median residual of the tracks ({figures['outcome']})", f"{figures['residual_median']:.2f} {figures['residual_unit']}", ""),
        ("pinned vertices moved at most", f"{figures['pinned_moved_mm']:.4f} mm", ""),
        ("acceleration of twice the mass, no gravity", f"{figures['doubled_mass_acceleration']:.3f}", "of the single"),
        ("seconds", "", ""),
    ]
    took = {**figures["seconds"], **{f"  {name}": value for name, value in figures["recovery_seconds"].items()}}
    rows += [(name, f"{value:.0f}", "") for name, value in took.items()]
    if figures["expected_seconds"]:
        rows.append(("seconds that the solve was expected to take", f"{figures['expected_seconds']['recover']:.0f}", ""))
    files = [
        ("the clip", out / "clip" / "clip.mp4"),
        ("the clip with the recovered forces", out / "wind.take" / "overlay.mp4"),
        ("what the recovery says of itself", out / "wind.take" / "report.png"),
        ("washing and leaves in the same wind", out / "edited.mp4"),
        ("the Blender file", out / "demo.blend"),
        ("these figures", out / FIGURES),
    ]
    table = "\n".join(f"  {name:<46}{first:>14}{second:>16}".rstrip() for name, first, second in rows)
    return f"\n{table}\n\n" + "\n".join(f"  {name:<42}{path}" for name, path in files)


def errors(figures: dict, whose: str = "") -> tuple[str, str]:
    """Magnitude and direction error as the table shows them."""
    return f"{figures[whose + 'magnitude_percent']:.1f} %", f"{figures[whose + 'direction_degrees']:.1f} degrees"


def first_acceleration(vertices: np.ndarray, fps: float) -> np.ndarray:
    """Mean acceleration (3,) [m/s²] of a body from rest over the first frames, from vertices (T+1, V, 3) [m]."""
    t = np.arange(1, FIRST + 1) / fps
    moved = vertices[1 : FIRST + 1].mean(1) - vertices[0].mean(0)
    return 2.0 * (moved * t[:, None] ** 2).sum(0) / (t**4).sum()


if __name__ == "__main__":
    sys.exit(main())
