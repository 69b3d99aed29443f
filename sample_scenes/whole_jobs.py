"""The whole job on every sample scene: clip, recover, insert, pin, re-simulate, bake, render, save, play it without the extension.

    python sample_scenes/whole_jobs.py --out DIR [SCENE ...] [--blender PATH] [--quick] [--video]

Blender gets scripts that only call operators (common/whole_job.py, common/replay.py). The known wind is read afterwards, to say how near
the recovery came: DIR/SCENE/job.json. A clip that is in DIR already is used again. `make scenes` runs all three.
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

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "common"), str(HERE.parent)]  # a script of the source tree: it runs with the package installed or not

if __name__ == "__main__":
    from needs import tell_missing_packages

    tell_missing_packages()

import numpy as np  # noqa: E402
from in_blender import BlenderFailed, run  # noqa: E402

from seeing_wind.engine.field.sampling import sample_points  # noqa: E402
from seeing_wind.engine.field.storage import load_field  # noqa: E402
from seeing_wind.engine.look.report.accuracy import field_errors, uniform_errors  # noqa: E402

SCENES = ("falling_leaf", "flag", "potted_plant")
QUICK_CLIP = ("--frames", "4", "--size", "240x180", "--samples", "1", "--spacing", "0.016")
QUICK_JOB = ("--iterations", "1", "--particles", "100", "--no-render")
"""The smallest that is still the real thing, for the tests; its figures mean nothing."""
MARK = "replay: "


def main(argv: list[str] | None = None) -> int:
    """Do all scenes; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=", ".join(SCENES))
    parser.add_argument("--out", required=True, metavar="DIR", type=Path)
    parser.add_argument("--blender", metavar="PATH", help="instead of BLENDER=, the one on the PATH, or the bpy wheel")
    parser.add_argument("--quick", action="store_true", help="few small frames, one iteration: whether it works, not how well")
    parser.add_argument("--video", action="store_true", help="render job.mp4 too")
    options = parser.parse_args(argv)
    unknown = set(options.scenes) - set(SCENES)
    if unknown:
        parser.error(f"there is no scene {', '.join(sorted(unknown))}; there are {', '.join(SCENES)}")
    try:
        for name in options.scenes or SCENES:
            print(summary(name, whole_job(name, options.out.resolve() / name, options.blender, options.quick, options.video)), flush=True)
    except (BlenderFailed, subprocess.CalledProcessError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def whole_job(name: str, folder: Path, blender: str | None = None, quick: bool = False, video: bool = False) -> dict:
    """Everything for one scene; returns the figures, which are in `folder`/job.json too.

    Raises:
        BlenderFailed: when a step fails in Blender, or the saved file does not play as it did.
        CalledProcessError: when the clip cannot be built.
    """
    os.environ.setdefault("SEEING_WIND_PYTHON", sys.executable)
    if not (folder / "clip.mp4").is_file():
        call = [sys.executable, str(HERE / name / "make.py"), "--out", str(folder), *(QUICK_CLIP if quick else ())]
        subprocess.run([*call, *(("--blender", blender) if blender else ())], check=True)
    for edit in folder.glob("wind.edit*.take"):  # what an earlier run left must not pass for this one's
        shutil.rmtree(edit)
    began = time.perf_counter()
    run(HERE / "common" / "whole_job.py", [str(folder), *(QUICK_JOB if quick else ()), *(("--video",) if video else ())], blender)
    seconds = time.perf_counter() - began
    said = run(HERE / "common" / "replay.py", [str(folder)], blender)
    played = json.loads(next(line for line in said.splitlines() if line.startswith(MARK))[len(MARK) :])
    figures = {**measure(folder), **played, "seconds": round(seconds, 1)}
    (folder / "job.json").write_text(json.dumps(figures, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return figures


def measure(folder: Path) -> dict:
    """How near the recovery came to the known wind, beside a uniform one with the right net force, and how far held vertices moved."""
    with np.load(folder / "truth.npz", allow_pickle=False) as truth:
        free = ~truth["fixed"]
        x, want = truth["x"][:-1, free], (truth["acc"] * float(truth["rho"]))[:, free]
    found, uniform = field_errors(want, sample_points(load_field(folder / "wind.take" / "field.safetensors"), x)[0]), uniform_errors(want)
    report = json.loads((folder / "wind.take" / "report.json").read_text())
    held = np.load(folder / "wind.edit.take" / "pins" / "Ribbon.npy", allow_pickle=False)
    with np.load(folder / "wind.edit.take" / "bodies" / "Ribbon.npz", allow_pickle=False) as body:
        still = body["vertices"][:, held]
    return {
        "magnitude_percent": found[0], "direction_degrees": found[1],
        "uniform_magnitude_percent": uniform[0], "uniform_direction_degrees": uniform[1],
        "residual_median": report["residual"]["median"], "residual_unit": report["residual_unit"],
        "pinned_moved_mm": float(1000.0 * np.linalg.norm(still - still[0], axis=-1).max()), "frames": len(x) + 1,
    }  # fmt: skip


def summary(name: str, figures: dict) -> str:
    """Some lines for people."""
    differs, moved = max(figures["differs_m"].values()), figures["moved_m"]["Ribbon"]
    return (
        f"{name}, {figures['frames']} frames, Blender {figures['blender']}, {figures['seconds']:.0f} s\n"
        f"  wind off by {figures['magnitude_percent']:.1f} % and {figures['direction_degrees']:.1f} degrees "
        f"(a uniform one with the right net force: {figures['uniform_magnitude_percent']:.1f} %, "
        f"{figures['uniform_direction_degrees']:.1f} degrees)\n"
        f"  tracks' median residual {figures['residual_median']:.2f} {figures['residual_unit']}\n"
        f"  the ribbon moves {100 * moved:.1f} cm, its held end {figures['pinned_moved_mm']:.4f} mm\n"
        f"  played without the extension it differs by {1000 * differs:.4f} mm at most"
    )


if __name__ == "__main__":
    sys.exit(main())
