"""The rows of the three tables: what each of them runs, and the paper's numbers."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from seeing_wind.engine.look.report.accuracy import field_errors, uniform_errors
from seeing_wind.engine.look.splatting import render_gaussians
from seeing_wind.engine.record_arrays import from_arrays
from seeing_wind.engine.records import Body
from seeing_wind.engine.take import VERSION as ENGINE
from seeing_wind.engine.take import Take

from .metrics import lpips, psnr, ssim
from .objects import THINGS
from .painter import backdrop, over
from .scene import FPS, FRAMES, Scene, film, material_options, recovered_vertices, render_frames, simulate, trajectories

VERSION = 1
"""Raise it when rows must be run again."""


@dataclass(frozen=True)
class Row:
    """One line of a table."""

    table: int
    name: str
    """As printed; unique within its table."""
    thing: str
    method: str
    options: tuple[str, ...]
    """Options of the recovery."""
    views: int
    """Number of cameras; with 0, trajectories are recovered instead of a clip."""
    paper: tuple[float, float, float, float, float] | None
    """PSNR, SSIM, LPIPS, magnitude [%], direction [degrees] of the paper."""
    seconds: float
    """Rough time of the row on two idle cores."""
    own: bool = False
    """For trajectories: use the true particles themselves, so that truth and recovery share their discretisation."""

    @property
    def key(self) -> str:
        """The row's name as a file name."""
        return f"{self.table}_{self.name.lower().replace(' ', '_').replace(',', '').replace('+', '_')}"


PAPER1 = {
    "Lego": (33.70, 0.98, 0.01, 19.53, 7.02), "Ficus": (25.92, 0.94, 0.03, 23.97, 11.55), "Sunflower": (34.08, 0.99, 0.01, 14.38, 7.85),
    "Toy": (41.35, 0.99, 0.00, 29.19, 8.11), "Chair": (40.10, 0.99, 0.00, 33.31, 23.40), "Hotdog": (30.63, 0.96, 0.02, 15.09, 11.63),
}  # fmt: skip
PAPER2 = {
    ("Elastic", "point"): (20.57, 0.94, 0.04, 95.91, 76.48), ("Elastic", "kplanes"): (26.25, 0.96, 0.03, 18.03, 39.83),
    ("Elastic", "causal_triplane"): (39.79, 0.99, 0.01, 5.14, 4.38),
    ("Elastoplastic", "point"): (31.40, 0.98, 0.01, 98.36, 26.8), ("Elastoplastic", "kplanes"): (30.14, 0.98, 0.01, 87.81, 61.42),
    ("Elastoplastic", "causal_triplane"): (39.93, 0.99, 0.01, 75.06, 45.50),
    ("Viscoplastic", "point"): (17.49, 0.95, 0.12, 98.30, 92.02), ("Viscoplastic", "kplanes"): (41.73, 0.99, 0.03, 89.04, 33.09),
    ("Viscoplastic", "causal_triplane"): (39.00, 0.99, 0.01, 21.44, 7.50),
}  # fmt: skip
PAPER3 = {
    "image": (37.24, 0.99, 0.01, 86.74, 50.23), "flow_depth": (41.54, 0.99, 0.01, 27.90, 16.07),
    "tracking": (39.79, 0.99, 0.01, 5.14, 4.38),
}  # fmt: skip
KINDS = {"Elastic": "Lego", "Elastoplastic": "Toy", "Viscoplastic": "Hotdog"}
"""The object that stands for each material type in Table 2; Table 3 takes the elastic one."""


def all_rows() -> list[Row]:
    """Every row, in the order of the tables; the default solve stands beside the paper's scheme in Tables 2 and 3."""
    rows = [Row(1, f"{name}, one view", name, "default", (), 1, PAPER1[name], 90) for name in THINGS]
    rows += [Row(1, f"{name}, two views", name, "default", (), 2, PAPER1[name], 110) for name in THINGS]
    for kind, thing in KINDS.items():
        for representation in ("point", "kplanes", "causal_triplane"):
            options = ("--schedule", "paper", "--representation", representation)
            paper = PAPER2[kind, representation]
            rows.append(Row(2, f"{kind}, {representation}", thing, representation, options, 0, paper, 240))
            rows.append(Row(2, f"{kind}, {representation}, true particles", thing, representation, options, 0, paper, 400, own=True))
            if kind == "Elastic":
                rows.append(Row(2, f"{kind}, {representation}, from pixels", thing, representation, options, 1, paper, 150))
        paper = PAPER2[kind, "causal_triplane"]
        rows.append(Row(2, f"{kind}, default", thing, "causal_triplane, default", (), 0, paper, 60))
        rows.append(Row(2, f"{kind}, default, true particles", thing, "causal_triplane, default", (), 0, paper, 400, own=True))
    for objective in ("image", "flow_depth", "tracking"):
        options = ("--schedule", "paper", "--objective", objective)
        rows.append(Row(3, f"{objective}", "Lego", objective, options, 1, PAPER3[objective], 300))
    rows.append(Row(3, "tracking, default", "Lego", "tracking, default", (), 1, PAPER3["tracking"], 90))
    return sorted(rows, key=lambda row: row.table)


def short_rows() -> list[Row]:
    """A row from pixels and one through the paper's scheme with few iterations, for a first look and for CI."""
    rows = {row.key: row for row in all_rows()}
    one, two = rows["1_sunflower_one_view"], rows["2_elastic_causal_triplane"]
    return [
        replace(one, name="Sunflower, one view, short", options=("--particles", "150"), seconds=30),
        replace(
            two, name="Elastic, causal_triplane, short", thing="Sunflower", options=(*two.options, "--frame-iterations", "10"), seconds=40
        ),
    ]


def engine(arguments: list[str | Path], say: Callable[[str], None]) -> dict:
    """Run a verb of the engine as a user would; its progress goes to `say`. Raises RuntimeError with the engine's own message."""
    command = [sys.executable, "-m", "seeing_wind.engine", *map(str, arguments)]
    last: dict = {}
    # stderr goes to a file: a full pipe that nobody reads would stop the worker.
    with tempfile.TemporaryFile("w+") as log, subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            message = json.loads(line)
            if message["type"] == "progress":
                say(f"{message['stage']} {100 * message['fraction']:.0f} %")
            elif message["type"] in ("error", "result"):
                last = message
        process.wait()
        log.seek(0)
        trouble = log.read()
    if process.returncode:
        raise RuntimeError(f"{last.get('message', '')} {last.get('hint', '')}".strip() or trouble[-1000:])
    return last


def run_row(row: Row, folder: Path, say: Callable[[str], None], frames: int = FRAMES) -> dict:
    """Make the scene (once per object), recover, measure; returns the row's figures and leaves frames in `folder`.

    Raises:
        RuntimeError: with the engine's message.
    """
    began = time.perf_counter()
    say("simulating the truth")
    scene = simulate(THINGS[row.thing](), frames)
    take = folder / "takes" / f"{row.key}.take"
    shutil.rmtree(take, ignore_errors=True)
    if row.views:
        filmed = folder / "clips" / f"{row.thing.lower()}_{frames}"
        if not (filmed / "view1" / "camera.json").is_file():
            say("filming")
            film(scene, filmed)
        result = engine(["recover", *_clip_options(filmed, row, scene), "--take", take], say)
    else:
        source = folder / "clips" / f"{row.thing.lower()}_{frames}{'_own' if row.own else ''}.npz"
        trajectories(scene, source, row.own)
        result = engine(["recover-trajectories", source, "--take", take, *material_options(scene.thing), *row.options], say)
    say("measuring")
    np.save(folder / "points.npy", scene.x[:-1])
    engine(["sample", take, "--points", folder / "points.npy", "--out", folder / "sampled.npz"], say)
    with np.load(folder / "sampled.npz", allow_pickle=False) as data:
        got, confidence = data["force_density"], data["confidence"]
    want, seen = render_frames(scene, 0), _seen_again(scene, row, take)
    free = ~scene.held
    magnitude, direction = field_errors(scene.force, got, free)
    flat_magnitude, flat_direction = uniform_errors(scene.force, free)
    _keep(folder / "frames" / f"{row.key}.npz", scene, want, seen, got)
    return {
        "version": VERSION, "engine": ENGINE, "row": asdict(row), "kind": scene.thing.kind, "field": scene.thing.field, "frames": frames,
        "psnr": psnr(want, seen), "ssim": ssim(want, seen), "lpips": lpips(want, seen),
        "magnitude": magnitude, "direction": direction, "uniform_magnitude": flat_magnitude, "uniform_direction": flat_direction,
        "confidence": float(confidence.mean()), "outcome": result["outcome"], "iterations": result.get("iterations"),
        "engine_seconds": result.get("stage_seconds", {}).get("total"), "seconds": time.perf_counter() - began,
    }  # fmt: skip


def _clip_options(filmed: Path, row: Row, scene: Scene) -> list[str | Path]:
    """What a user of the clip knows: camera, silhouette and depth of the first frame, what is held, what it is made of."""
    one, two = filmed / "view0", filmed / "view1"
    options: list[str | Path] = [one / "clip", "--fps", str(FPS), "--camera", one / "camera.json", "--mask", one / "mask.png"]
    options += ["--depth", one / "depth.npy", "--no-gravity", *material_options(scene.thing), *row.options]
    options += ["--pin", one / "pin.png"] if scene.held.any() else []
    return options + (["--view", two / "clip", two / "camera.json", two / "mask.png"] if row.views == 2 else [])


def _seen_again(scene: Scene, row: Row, take: Path) -> np.ndarray:
    """(T+1, H, W, 3) uint8: the motion simulated with the recovered force, as the first camera would film it.

    From a clip, the recovered Gaussians are splatted, as the paper does; from trajectories, the object's own surface rides on them.
    """
    with np.load(take / "trajectory.npz", allow_pickle=False) as data:
        x, F = data["x"], data["F"]
    if not row.views:
        return render_frames(scene, 0, recovered_vertices(scene, x))
    camera, behind = scene.cameras[0], backdrop(scene.cameras[0])
    body = from_arrays(Body, Take(take).read_arrays("particles.npz"))
    return np.stack([over(*render_gaussians(body.gaussians, camera, 0, x[t], F[t]), behind) for t in range(len(x))])


def _keep(path: Path, scene: Scene, want: np.ndarray, seen: np.ndarray, got: np.ndarray) -> None:
    """Keep what the report's figures need: the last and a middle frame, true and re-simulated, and some arrows."""
    path.parent.mkdir(parents=True, exist_ok=True)
    middle = len(want) // 2
    some = np.linspace(0, len(scene.x[0]) - 1, 60).astype(int)
    pixels = scene.cameras[0].project(scene.x[middle, some], 0)[0]
    tips = [scene.cameras[0].project(scene.x[middle, some] + 4e-4 * f[middle, some], 0)[0] for f in (scene.force, got)]
    np.savez_compressed(path, want=want[[middle, -1]], seen=seen[[middle, -1]], start=pixels, true_tip=tips[0], got_tip=tips[1])
