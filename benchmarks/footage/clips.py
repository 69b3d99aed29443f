"""Runs `recover` on real footage whose physics is known: benchmarks/footage/clips.py SHARED [--takes DIR] [CASE ...]

SHARED holds clips/ (see the README there). Gravity counts as part of the field, so the recovered force over density is the net
acceleration. Prints a row per case with what was found and its bar, and exits with 1 when a bar is missed. With --takes the takes stay in
DIR, a folder per clip, and what is done there is kept.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.accuracy.truth import engine  # noqa: E402


@dataclass(frozen=True)
class Clip:
    """Footage and how a user would mark what moves in it."""

    file: str
    fps: float
    pixels_per_metre: float
    frames: tuple[int, int]
    box: tuple[int, int, int, int]
    material: str = "rubber"
    thickness: float | None = None
    """Of what is no ball though it looks round [m]."""


CLIPS = {
    "toss": Clip("ball_toss_osp/BallTossOut.mov", 30.19, 398.7, (12, 27), (175, 150, 200, 175)),
    "sideways": Clip("ball_bounce_sideways/clip.mp4", 100.0, 357.0, (64, 120), (462, 340, 499, 376)),
    # The puck's scale is that of its tape rule, about; both clips have the same. The free one is pulled, too, up to frame 18.
    "puck pulled": Clip("puck_constant_force/clip.avi", 25.0, 400.0, (12, 22), (102, 66, 184, 150), thickness=0.03),
    "puck free": Clip("puck_no_force/clip.avi", 25.0, 400.0, (18, 25), (192, 70, 276, 152), thickness=0.03),
    "pendulum": Clip("pendulum_bauble_chain/clip.mp4", 29.921, 750.0, (26, 105), (78, 466, 134, 526)),
    "diabolo": Clip("diabolo_cm/clip.mp4", 80.0, 409.8, (42, 100), (1245, 48, 1342, 142)),
    "tree": Clip("tree_wind_opencv/clip.mp4", 15.0, 200.0, (0, 24), (40, 40, 280, 200), "leaf"),
}


def accelerations(shared: Path, takes: Path, name: str) -> np.ndarray:
    """(T, 3) [m/s²] mean over the body of what was recovered from a clip, unless it is in `takes` already."""
    clip, take = CLIPS[name], takes / f"{name.replace(' ', '_')}.take"
    thickness = [] if clip.thickness is None else ["--thickness", clip.thickness]
    engine(
        *("recover", shared / "clips" / clip.file, "--take", take, "--fps", clip.fps, "--pixels-per-metre", clip.pixels_per_metre),
        *("--frames", f"{clip.frames[0]}:{clip.frames[1]}", "--box", *clip.box, "--material", clip.material, "--no-gravity"),
        *thickness,
    )
    density = json.loads((take / "report.json").read_text())["material"]["density"]
    with np.load(take / "trajectory.npz", allow_pickle=False) as data:
        return data["force_density"].mean(axis=1) / density


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Degrees between two vectors."""
    return float(np.degrees(np.arccos(np.clip(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)), -1.0, 1.0))))


def toss(shared: Path, takes: Path) -> tuple[str, bool]:
    """Free flight of a white ball: 9.8 m/s² down."""
    a = accelerations(shared, takes, "toss").mean(axis=0)
    size, off = float(np.linalg.norm(a)), angle(a, np.array([0.0, 0.0, -1.0]))
    return f"{size:.2f} m/s2, {off:.1f} deg off straight down (9.8 within 3 %, 5 deg)", abs(size / 9.8 - 1.0) < 0.03 and off < 5.0


def sideways(shared: Path, takes: Path) -> tuple[str, bool]:
    """Free flight in a frame that lies on its side: about 9 m/s² to the right."""
    a = accelerations(shared, takes, "sideways").mean(axis=0)
    size, off = float(np.linalg.norm(a)), angle(a, np.array([1.0, 0.0, 0.0]))
    return f"{size:.2f} m/s2, {off:.1f} deg off the right (about 9, 10 deg)", abs(size / 9.0 - 1.0) < 0.1 and off < 10.0


def puck(shared: Path, takes: Path) -> tuple[str, bool]:
    """A coasting puck feels under 5 % of the force that pulls it in the other clip; that one keeps its direction."""
    pulled, free = (accelerations(shared, takes, name) for name in ("puck pulled", "puck free"))
    share = float(np.linalg.norm(free.mean(axis=0)) / np.linalg.norm(pulled.mean(axis=0)))
    spread = max(angle(a, pulled.mean(axis=0)) for a in pulled)
    pull = float(np.linalg.norm(pulled.mean(axis=0)))
    return f"{100 * share:.1f} % of the pull of {pull:.2f} m/s2, whose direction varies by {spread:.0f} deg (5 %)", share < 0.05


def pendulum(shared: Path, takes: Path) -> tuple[str, bool]:
    """A bauble whose chain hangs along a wall: the chain pulls it back from the left, the wall throws it back in the middle of every swing.

    So the force along the swing changes its sign twice in half a period of about 0.68 s: to the left at the wall, then to the right again.
    """
    a = accelerations(shared, takes, "pendulum")[:, 0]
    at = np.flatnonzero(np.diff(np.sign(a)) != 0)
    changes = (at + a[at] / (a[at] - a[at + 1])) / CLIPS["pendulum"].fps
    to_left, to_right = changes[a[at] > 0.0], changes[a[at] < 0.0]
    halves = np.concatenate([np.diff(to_left), np.diff(to_right)])
    good = len(halves) >= 2 and bool(np.abs(np.median(halves) / 0.68 - 1.0) < 0.1) and bool((np.abs(halves / 0.68 - 1.0) < 0.2).all())
    left, right = (", ".join(f"{time:.2f}" for time in times) for times in (to_left, to_right))
    return f"turns left at {left} s, right at {right} s: half periods of {np.median(halves):.2f} s (0.68 within 10 %, each 20 %)", good


def diabolo(shared: Path, takes: Path) -> tuple[str, bool]:
    """The glide of a spinning paper cup: the air carries it, under 2 m/s² are left."""
    a = accelerations(shared, takes, "diabolo").mean(axis=0)
    return f"{np.linalg.norm(a):.2f} m/s2 (under 2)", bool(np.linalg.norm(a) < 2.0)


def tree(shared: Path, takes: Path) -> tuple[str, bool]:
    """Foliage in the wind has no known truth: look at overlay.mp4 of its take."""
    a = accelerations(shared, takes, "tree")
    return f"{np.linalg.norm(a, axis=1).mean():.2f} m/s2 on average; look at overlay.mp4", bool(np.isfinite(a).all())


CASES: dict[str, Callable[[Path, Path], tuple[str, bool]]] = {
    one.__name__: one for one in (toss, sideways, puck, pendulum, diabolo, tree)
}  # fmt: skip


def main() -> int:
    """All cases, or those named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shared", type=Path, metavar="SHARED")
    parser.add_argument("--takes", type=Path, metavar="DIR")
    parser.add_argument("case", nargs="*", metavar="CASE", default=list(CASES), help=f"some of: {', '.join(CASES)}")
    arguments = parser.parse_intermixed_args()
    unknown = sorted(set(arguments.case) - set(CASES))
    if unknown:
        parser.error(f"no case {', '.join(unknown)}; there are {', '.join(CASES)}")
    missed = 0
    for case in arguments.case:
        with tempfile.TemporaryDirectory() as folder:
            started = time.perf_counter()
            line, good = CASES[case](arguments.shared.resolve(), arguments.takes or Path(folder))
        missed += not good
        print(f"{case:10} {line}   {time.perf_counter() - started:5.1f} s   {'ok' if good else 'MISSED'}", flush=True)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
