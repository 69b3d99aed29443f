"""What wrong guesses cost: benchmarks/accuracy/robustness.py TRUTH.npz [CASE ...]

Recovers the field of TRUTH.npz (another simulator's trajectories, keys as in its README) with a wrong stiffness or density, with wild
points, or with a third of the body unseen, and prints a row per case: magnitude and direction error. A density that is off by 1.5 makes
every force density off by 1.5, which no method can know; that row is scored as a ratio to the wrong density beside the plain score.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from seeing_wind.engine.command.trajectories.bodies import Trajectories, read_trajectories
from seeing_wind.engine.look.report.accuracy import field_errors, uniform_errors
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.recovery.recover import recover
from seeing_wind.engine.settings import RecoverSettings

Variant = Callable[[Trajectories], Trajectories]


def as_given(source: Trajectories) -> Trajectories:
    return source


def stiffness(factor: float) -> Variant:
    return lambda source: replace(source, material=replace(source.material, youngs_modulus=factor * source.material.youngs_modulus))


def density(factor: float) -> Variant:
    return lambda source: replace(source, material=replace(source.material, density=factor * source.material.density))


def wild_points(source: Trajectories) -> Trajectories:
    """In every frame after the first, a tenth of the points, drawn anew, are off by 5 cm along each axis on average, with scatter."""
    rng, x = np.random.default_rng(0), source.targets.x.copy()
    lost = rng.random(x.shape[:2]) < 0.1
    lost[0] = False
    x[lost] += 0.05 + 0.05 * rng.standard_normal((int(lost.sum()), 3))
    return replace(source, targets=replace(source.targets, x=x))


def slipped_points(source: Trajectories) -> Trajectories:
    """In the middle of the clip, a tenth of the points jump by 5 cm, each in its own direction, and then move with the body from there."""
    rng, x = np.random.default_rng(0), source.targets.x.copy()
    lost = rng.random(x.shape[1]) < 0.1
    aside = rng.standard_normal((int(lost.sum()), 3))
    x[len(x) // 2 :, lost] += 0.05 * aside / np.linalg.norm(aside, axis=1)[:, None]
    return replace(source, targets=replace(source.targets, x=x))


def a_third_unseen(source: Trajectories) -> Trajectories:
    """The third of the body at one end of its longest axis is never seen."""
    rest = source.particles.x
    along = (rest - rest.mean(axis=0)) @ np.linalg.svd(rest - rest.mean(axis=0), full_matrices=False)[2][0]
    visible = np.broadcast_to(along < np.quantile(along, 2.0 / 3.0), source.targets.visible.shape)
    return replace(source, targets=replace(source.targets, visible=visible.copy()))


CASES: dict[str, tuple[Variant, float]] = {
    # name: what is done to the input, factor on the truth that the wrong guess implies
    "as given": (as_given, 1.0),
    "Young's modulus x 2": (stiffness(2.0), 1.0),
    "Young's modulus / 2": (stiffness(0.5), 1.0),
    "density x 1.5": (density(1.5), 1.5),
    "density / 1.5": (density(1.0 / 1.5), 1.0 / 1.5),
    "10 % of the points wild": (wild_points, 1.0),
    "10 % of the points slip and stay": (slipped_points, 1.0),
    "a third of the body unseen": (a_third_unseen, 1.0),
}


def main() -> int:
    """All cases, or those named; prints Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth", type=Path, metavar="TRUTH.npz")
    parser.add_argument("cases", nargs="*", metavar="CASE", help="; ".join(CASES).replace("%", "%%") + "; default: all")
    arguments = parser.parse_args()
    unknown = set(arguments.cases) - set(CASES)
    if unknown:
        parser.error(f"there is no case {unknown.pop()!r}; choose among {', '.join(CASES)}")
    path = arguments.truth
    with np.load(path, allow_pickle=False) as data:
        truth, free = data["acc"] * float(data["rho"]), ~data["fixed"]
    print(f"| {path.stem} | magnitude | direction | against what the guess implies | seconds |\n|---|---|---|---|---|")
    for name in arguments.cases or CASES:
        change, implied = CASES[name]
        source, started = change(read_trajectories(path)), time.perf_counter()
        settings = RecoverSettings(gravity=source.gravity, clamp_depth=source.clamp_depth)
        found = recover(source.particles, source.material, source.targets, source.fps, settings, NoProgress())
        plain, fair = (field_errors(scale * truth, found.force_density, free) for scale in (1.0, implied))
        print(
            f"| {name} | {plain[0]:.1f} % | {plain[1]:.1f}° | {fair[0]:.1f} % / {fair[1]:.1f}° | {time.perf_counter() - started:.0f} |",
            flush=True,
        )
    flat = uniform_errors(truth, free)
    print(f"| *a uniform field with the true net force* | {flat[0]:.1f} % | {flat[1]:.1f}° | | |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
