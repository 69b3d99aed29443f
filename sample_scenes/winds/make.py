"""The library of recovered winds: flown, recovered, put on a shelf. `make winds` runs it; twenty minutes on two idle cores.

    python sample_scenes/winds/make.py --out DIR --takes DIR [--only NAME ...] [--blender PATH]

1. A plate flies in each known wind (`flight.py`); its particles' motion is all that the recovery is given.
2. `seeing_wind.engine recover-trajectories --field wind` finds the wind; what is done stays in the folder of takes.
3. The wind is asked for on a lattice, and compared with the known one where the plate was.
4. shelve.py, in Blender, makes OUT/winds.blend with an asset for each, its catalogs, and OUT/winds.json, which the panel lists.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(HERE.parent / "common"), str(ROOT)]  # a script of the source tree: it runs with the package installed or not

if __name__ == "__main__":
    from needs import tell_missing_packages

    tell_missing_packages()

import numpy as np  # noqa: E402
from in_blender import BlenderFailed, run  # noqa: E402
from winds import FPS, FRAMES, OVERLAP, WINDS, Shelved  # noqa: E402

from seeing_wind.engine.field.storage import load_field  # noqa: E402
from seeing_wind.engine.reading import read_arrays  # noqa: E402

YOUNGS_MODULUS = 5e4
"""Pa: the plates hardly bend."""
NODES = 9
"""Of the lattice, along the box's longest side."""
SAMPLED = "on_the_shelf.npz"


def main(argv: list[str] | None = None) -> int:
    """Make the library; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="of the library")
    parser.add_argument("--takes", required=True, type=Path, metavar="DIR", help="keeps what was recovered: a second run goes on from it")
    parser.add_argument("--only", nargs="+", default=[each.name for each in WINDS], metavar="NAME", help="these winds")
    parser.add_argument("--iterations", type=int, metavar="N", help="of the recovery, instead of its own number; 1 gives a draft")
    parser.add_argument("--blender", metavar="PATH", help="instead of BLENDER=, the one on the PATH, or the bpy wheel")
    options = parser.parse_args(argv)
    shelf, takes = [each for each in WINDS if each.name in options.only], options.takes.resolve()
    try:
        for each in shelf:
            folder = takes / each.name.replace(" ", "_").lower()
            print(f"{each.name}: {recovered(each, folder, options.iterations)}", flush=True)
        print(run(HERE / "shelve.py", [str(options.out.resolve()), str(takes), *(each.name for each in shelf)], options.blender))
    except (BlenderFailed, subprocess.CalledProcessError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


def recovered(each: Shelved, folder: Path, iterations: int | None) -> str:
    """Fly, recover and sample a wind into `folder`, unless that was done; says how near it came."""
    take = folder / "wind.take"
    if not (folder / SAMPLED).is_file():
        from flight import flown  # needs SciPy, which Blender's Python need not have

        folder.mkdir(parents=True, exist_ok=True)
        x, flight = flown(each.flight, each.wind), each.flight
        density = flight.areal_density / (flight.spacing * flight.counts[2])
        np.savez(folder / "flight.npz", x=x, fps=FPS, rho=density, E=YOUNGS_MODULUS, nu=0.3, gravity=np.array(flight.gravity))
        draft = () if iterations is None else ("--iterations", iterations)
        engine("recover-trajectories", folder / "flight.npz", "--take", take, "--field", "wind", "--report", "none", *draft)
        low, high = np.asarray(load_field(take / "wind.safetensors").box, dtype=float)
        side = high - low
        axes = [np.linspace(low[k], high[k], max(3, round((NODES - 1) * side[k] / side.max()) + 1)) for k in range(3)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        points = np.concatenate([np.broadcast_to(nodes, (FRAMES, *nodes.shape)), x[:-1]], axis=1)
        np.save(folder / "points.npy", points)
        engine("sample", take, "--points", folder / "points.npy", "--out", folder / "sampled.npz")
        found, count = read_arrays(folder / "sampled.npz"), len(nodes)
        size, angle = errors(found["wind_velocity"][:, count:], np.stack([each.wind(x[t], (t + 0.5) / FPS) for t in range(FRAMES)]))
        cut = {name: found[name][:, :count] for name in ("force_density", "wind_velocity", "wind_confidence")}
        if each.loops:
            cut = {name: gone_round(rows) for name, rows in cut.items()}
        np.savez(folder / SAMPLED, nodes=nodes, density=density, off=np.array([size, angle]), **cut)
    size, angle = read_arrays(folder / SAMPLED)["off"]
    return f"{size:.1f} % and {angle:.1f} degrees off the known wind, at the plate"


def engine(*arguments: object) -> None:
    """Run a verb of the engine in its own Python. Raises CalledProcessError where it fails."""
    python = os.environ.get("SEEING_WIND_PYTHON", sys.executable)
    subprocess.run([python, "-m", "seeing_wind.engine", *map(str, arguments)], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)


def gone_round(rows: np.ndarray) -> np.ndarray:
    """Rows (T, ...) whose first `OVERLAP` are mixed with the last ones, which are cut off: the end then goes on into the beginning."""
    kept = rows[: len(rows) - OVERLAP].copy()
    share = ((np.arange(OVERLAP) + 0.5) / OVERLAP).reshape(-1, *[1] * (rows.ndim - 1))
    kept[:OVERLAP] = share * rows[:OVERLAP] + (1.0 - share) * rows[len(rows) - OVERLAP :]
    return kept


def errors(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Mean error of vectors (..., 3) in size [% of the mean] and direction [degrees]; where the true ones are weak, neither is told."""
    size, wanted = np.linalg.norm(found, axis=-1), np.linalg.norm(true, axis=-1)
    strong = wanted > 0.2 * np.sqrt((wanted**2).mean())
    cosine = (found * true).sum(axis=-1) / np.maximum(size * wanted, 1e-12)
    off = 100.0 * float(np.abs(size - wanted)[strong].mean() / wanted[strong].mean())
    return off, float(np.degrees(np.arccos(np.clip(cosine[strong], -1.0, 1.0))).mean())


if __name__ == "__main__":
    sys.exit(main())
