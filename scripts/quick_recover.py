"""A whole recovery of a short clip in an environment without bpy: quick_recover.py PYTHON OUT --clip CLIP

CLIP is a folder that sample_scenes/falling_leaf/make.py made. Fails unless the recovery ends well and every file of the take is there.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from shutil import rmtree

ROOT = Path(__file__).resolve().parents[1]
WANTED = ("field.safetensors", "trajectory.npz", "report.json", "report.png", "overlay.mp4")
VERSIONS = (
    "import sys, cv2, numpy, scipy, torch; print('Python', sys.version.split()[0], 'NumPy', numpy.__version__, 'SciPy', scipy.__version__,"
    "'OpenCV', cv2.__version__, 'PyTorch', torch.__version__)"
)


class Failed(RuntimeError):
    """The recovery failed; the message ends with its last output."""


def main(argv: list[str]) -> int:
    """Recover and check the result; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("python")
    parser.add_argument("out", type=Path)
    parser.add_argument("--clip", type=Path, required=True)
    options = parser.parse_args(argv)
    try:
        print(recover(options.python, options.out, options.clip))
    except Failed as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def recover(python: str, out: Path, clip: Path) -> str:
    """One recovery by `python` into `out`; returns with what and how long.

    Raises:
        Failed: when it fails, leaves a file out, or `python` has bpy.
    """
    if subprocess.run([python, "-c", "import bpy"], capture_output=True, check=False).returncode == 0:
        raise Failed(f"{python} has bpy: it is not the engine's own environment.")
    rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    command = [python, "-m", "seeing_wind.engine", "recover", clip / "clip.mp4", "--take", out / "wind.take", "--distance", "2"]
    command += ["--mask", clip / "mask_0000.png", "--camera", clip / "camera.json", "--material", "leaf", "--particles", "200"]
    began = time.perf_counter()
    with open(out / "log.jsonl", "wb") as said, open(out / "log.txt", "wb") as log:
        code = subprocess.run([str(word) for word in command], cwd=ROOT, stdout=said, stderr=log, check=False).returncode
    seconds = time.perf_counter() - began
    if code:
        logs = [(out / name).read_text(encoding="utf-8", errors="replace").splitlines()[-3:] for name in ("log.jsonl", "log.txt")]
        raise Failed("\n".join([f"The recovery by {python} ended with exit code {code}:", *logs[0], *logs[1]]))
    there = {path.name for path in (out / "wind.take").iterdir() if path.stat().st_size}
    missing = [name for name in WANTED if name not in there]
    if missing:
        raise Failed(f"The take of {python} has no {', '.join(missing)}.")
    versions = subprocess.run([python, "-c", VERSIONS], capture_output=True, check=True, encoding="utf-8").stdout.strip()
    return f"Recovered in {seconds:.0f} s with {versions}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
