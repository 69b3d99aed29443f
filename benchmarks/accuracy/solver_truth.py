"""Drives the solver with the true force of another simulator: benchmarks/accuracy/solver_truth.py SHARED [NAME ...]

SHARED holds truth/NAME.npz (see its README). Prints, for every body, the mean distance of the free particles from the truth at the end
and over all frames, against the distance that they travelled.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.model import Model
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State, Trajectory
from seeing_wind.engine.records import Particles

NAMES = ("sheet", "banner", "pole", "clay")
SPACING = 0.04 / 3
NEIGHBOURS = 14


def force_gradient(x: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """d a_i / d x_j (T, N, 3, 3) [1/s²] of accelerations (T, N, 3) at x (T, N, 3) [m], by least squares over neighbours."""
    _, near = cKDTree(x[0]).query(x[0], k=NEIGHBOURS)
    gradient = []
    for positions, a in zip(x, acceleration):
        offset, change = positions[near] - positions[:, None], a[near] - a[:, None]
        square = np.einsum("nki,nkj->nij", offset, offset) + 1e-7 * np.eye(3)
        gradient.append(np.einsum("nki,nkj->nij", change, offset) @ np.linalg.inv(square))
    return np.stack(gradient)


def drive(
    truth: Mapping[str, np.ndarray], *, kinematic: bool = True, dx: float | None = None, clamp_depth: float = 0.0
) -> tuple[Trajectory, Model]:
    """The body of a truth file under its true force, its held particles on their true path (or standing still)."""
    x, fixed, yields = truth["x"], truth["fixed"], float(truth["yield_stress"])
    particles = Particles(x[0], np.full(x.shape[1], SPACING**3), fixed, SPACING)
    # The other simulator compares |dev tau| with its yield stress; in tension that is sqrt(3/2) of it.
    flow = {"law": "von_mises", "yield_stress": float(np.sqrt(1.5)) * yields} if yields > 0.0 else {"law": "corotated"}
    material = Material("truth", density=float(truth["rho"]), youngs_modulus=float(truth["E"]), poisson_ratio=float(truth["nu"]), **flow)
    model, _ = model_for(
        particles, material, float(truth["fps"]), gravity=truth["gravity"], dx=dx, clamp_depth=clamp_depth,
        pin_path=x[:, fixed] if kinematic and fixed.any() else None,
    )  # fmt: skip
    return rollout(model, State.at_rest(x[0], truth["v"][0]), truth["acc"], force_gradient(x, truth["acc"])), model


def travelled(truth: Mapping[str, np.ndarray]) -> float:
    """Mean length [m] of the free particles' paths."""
    return float(np.linalg.norm(np.diff(truth["x"], axis=0), axis=-1).sum(axis=0)[~truth["fixed"]].mean())


def main() -> int:
    """Print a row per body; exit code 1 if one ends more than 2 % of its path's length away from the truth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shared", type=Path, metavar="SHARED")
    parser.add_argument("names", nargs="*", default=NAMES, metavar="NAME", help=f"default: {' '.join(NAMES)}")
    arguments, missed = parser.parse_args(), 0
    for name in arguments.names:
        with np.load(arguments.shared / f"truth/{name}.npz", allow_pickle=False) as data:
            truth = dict(data)
        started = time.perf_counter()
        path, model = drive(truth)
        error, way = np.linalg.norm(path.x - truth["x"], axis=-1)[:, ~truth["fixed"]], travelled(truth)
        end, rms = error[-1].mean(), np.sqrt((error**2).mean())
        missed += end > 0.02 * way
        print(
            f"{name:7} {1e3 * end:6.2f} mm at the end ({100 * end / way:.2f} %), {1e3 * rms:5.2f} mm rms ({100 * rms / way:.2f} %) of "
            f"{1e3 * way:.0f} mm, {model.substeps} substeps a frame, dx {1e3 * model.dx:.1f} mm, {time.perf_counter() - started:.1f} s",
            flush=True,
        )
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
