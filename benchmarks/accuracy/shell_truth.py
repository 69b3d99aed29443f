"""How well the wind on another engine's cloth is recovered: benchmarks/accuracy/shell_truth.py FOLDER [SCENE ...] [--work DIR]

FOLDER has the scenes of benchmarks/scenes/shell_scenes.py. Printed per scene, over free vertices and frames: the error of the wind that
`recover-trajectories --field wind` finds, in size [%] and direction [degrees]; the same of two answers that know the true wind but not
its shape: its mean over the sheet in every frame, and over the clip. Then the transfer: the sheet of twice the areal density (the scene
SCENE_heavy) is re-simulated in the recovered wind, and for comparison in the recovered force, and by the engine's own solver in the true
wind, which shows how far the two engines' cloth goes apart by itself. Its error is the mean distance of the free vertices from where the
other engine has them, over the mean of how far these get from where they began [%].
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from wind_truth import engine, errors

from seeing_wind.engine.materials import Sheet
from seeing_wind.engine.mpm.shell import advance_frame, at_rest, shell_of, substeps_for
from seeing_wind.engine.reading import read_arrays
from seeing_wind.engine.recovery.wind.drag import vertex_drag

Truth = dict[str, np.ndarray]


def off(x: np.ndarray, truth: Truth) -> float:
    """Error [%] of a sheet's path x (T+1, V, 3) [m], as defined at the top of the file."""
    free = ~truth["fixed"].astype(bool)
    wanted = truth["x"][:, free].astype(float)
    travel = np.linalg.norm(wanted - wanted[0], axis=2).max(axis=0).mean()
    return 100.0 * float(np.linalg.norm(x[:, free] - wanted, axis=2).mean() / travel)


def stiffnesses(truth: Truth) -> dict[str, float]:
    """A sheet's properties by the keys of an edit."""
    E, h = float(truth["E"]), float(truth["thickness"])
    return {
        "areal_density": float(truth["areal_density"]), "thickness": h, "tensile_stiffness": E * h, "bending_stiffness": E * h**3 / 12.0,
        "poisson_ratio": float(truth["nu"]), "loss_factor": float(truth["damping"]),
    }  # fmt: skip


def in_true_wind(truth: Truth) -> np.ndarray:
    """Path (T+1, V, 3) [m] of a scene's sheet in the engine's own solver, with the wind at the other engine's vertices in every frame."""
    shell = shell_of(truth["x"][0].astype(float), truth["faces"], Sheet(**stiffnesses(truth)), pinned=truth["fixed"].astype(bool))
    fps, gravity, wind = float(truth["fps"]), truth["gravity"].astype(float), truth["wind"].astype(float)
    substeps = substeps_for(fps)

    def load(x: np.ndarray, v: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        return vertex_drag(wind[frame], x, v, shell.surface.faces)

    first = gravity + load(shell.surface.x, np.zeros_like(shell.surface.x), 0)[0] / shell.mass[:, None]
    state, path = at_rest(shell, None, first, dt=1.0 / fps / substeps), [shell.surface.x]
    for frame in range(len(wind)):
        state = advance_frame(shell, state, frame=frame, fps=fps, substeps=substeps, gravity=gravity, load=load)
        path.append(state.x)
    return np.stack(path)


def resimulated(take: Path, truth: Truth, kind: str) -> np.ndarray:
    """Path (T+1, V, 3) [m] of a scene's sheet, re-simulated in the take's field of this kind ("wind" or "force")."""
    out = take.parent / f"heavy_{kind}"
    np.savez(take.parent / "sheet.npz", vertices=truth["x"][0].astype(float), triangles=truth["faces"])
    held = np.flatnonzero(truth["fixed"])
    lines = [
        f'field = "{kind}"',
        f"gravity = {truth['gravity'].astype(float).tolist()}",
        "[[body]]",
        'name = "sheet"',
        'mesh = "sheet.npz"',
    ]
    lines += ["shell = true", *(f"{name} = {value}" for name, value in stiffnesses(truth).items())]
    if len(held):
        np.save(take.parent / "pin.npy", held)
        lines.append('pin = "pin.npy"')
    (take.parent / "heavy.toml").write_text("\n".join(lines) + "\n")
    engine("resimulate", take, "--edit", take.parent / "heavy.toml", "--take", out)
    return read_arrays(out / "bodies" / "sheet.npz")["vertices"]


def row(name: str, folder: Path, work: Path) -> str:
    """A line of the table."""
    truth, aside = read_arrays(folder / f"{name}.npz"), work / name
    aside.mkdir(parents=True, exist_ok=True)
    begun = time.perf_counter()
    try:
        engine("recover-trajectories", folder / f"{name}.npz", "--take", aside / "take", "--field", "wind", "--report", "none")
    except subprocess.CalledProcessError as error:
        return f"| {name} | failed (exit code {error.returncode}) |"
    minutes = (time.perf_counter() - begun) / 60.0
    np.save(aside / "points.npy", truth["x"][:-1].astype(float))
    engine("sample", aside / "take", "--points", aside / "points.npy", "--out", aside / "sampled.npz")
    free, true = ~truth["fixed"].astype(bool), truth["wind"].astype(float)
    true = true[:, free]
    guesses = [read_arrays(aside / "sampled.npz")["wind_velocity"][:, free], true.mean(axis=1, keepdims=True), true.mean(axis=(0, 1))]
    pairs = [errors(np.broadcast_to(guess, true.shape), true) for guess in guesses]
    figures = [f"{minutes:.1f}", *(f"{size:.1f} / {direction:.1f}" for size, direction in pairs)]
    if (folder / f"{name}_heavy.npz").exists():
        heavy = read_arrays(folder / f"{name}_heavy.npz")
        figures += [f"{off(resimulated(aside / 'take', heavy, kind), heavy):.1f}" for kind in ("wind", "force")]
        figures.append(f"{off(in_true_wind(heavy), heavy):.1f}")
    return " | ".join([f"| {name}", *figures]) + " |"


def main() -> None:
    """The table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help="those in FOLDER, without the heavy ones, if none is named")
    parser.add_argument("--work", type=Path, help="folder that keeps the takes; an interrupted run goes on from them")
    options = parser.parse_args()
    names = options.scenes or sorted(path.stem for path in options.folder.glob("*.npz") if not path.stem.endswith("_heavy"))
    print(
        "| scene | minutes | wind: size % / degrees | best uniform wind of each frame | best constant wind"
        " | twice as heavy: by the wind % | by the force % | in the true wind % |"
    )
    print("|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as aside:
        for name in names:
            print(row(name, options.folder, options.work or Path(aside)), flush=True)


if __name__ == "__main__":
    main()
