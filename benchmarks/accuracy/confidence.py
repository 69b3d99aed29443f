"""What a recovered field knows of itself, and where it leads a body: benchmarks/accuracy/confidence.py SHARED TAKES [SCENE ...]

For takes that `truth.py SHARED --takes TAKES sheet banner pole clay` left in TAKES, against SHARED/truth/SCENE.npz:

    by confidence   mean relative error of the force at the true particles, in fifths from the least to the most confident query
    outside         the largest confidence farther from where the body passed than it is known for, anywhere in twice the field's box
    free run        the body simulated anew from the recovered start in the stored field: how far its particles are off in the last frame,
                    over how far they travelled
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT)]  # a script of the source tree: it runs with the package installed or not

from seeing_wind.engine.command.trajectories.bodies import Trajectories, read_trajectories  # noqa: E402
from seeing_wind.engine.field import ForceField, load_field  # noqa: E402
from seeing_wind.engine.mpm.model_for import model_for  # noqa: E402
from seeing_wind.engine.mpm.rollout import advance  # noqa: E402
from seeing_wind.engine.mpm.state import State  # noqa: E402
from seeing_wind.engine.record_arrays import read_recovery  # noqa: E402
from seeing_wind.engine.records import as_found  # noqa: E402
from seeing_wind.engine.recovery.resimulate.in_field import extrapolate  # noqa: E402
from seeing_wind.engine.take import Take  # noqa: E402

SCENES = ("sheet", "banner", "pole", "clay")
FIFTHS, RATIO = 5, 2.0
AWAY, UNKNOWN = 3.0, 0.1
"""Distance from all places where a particle ever was, in particle spacings, beyond which a query is outside; largest confidence there."""
QUERIES = 4000
DRIFT = 2.0
"""Largest error of a free run [% of the distance travelled]."""


def main() -> int:
    """A row per scene and one for all; 1 when a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shared", type=Path, metavar="SHARED")
    parser.add_argument("takes", type=Path, metavar="TAKES")
    parser.add_argument("scene", nargs="*", default=SCENES)
    options = parser.parse_args()
    good, errors, confidences = True, [], []
    for name in options.scene:
        file, take = options.shared / f"truth/{name}.npz", options.takes / f"{name}.take"
        truth, field = np.load(file, allow_pickle=False), load_field(take / "field.safetensors")
        want, free = truth["acc"] * float(truth["rho"]), ~truth["fixed"]
        got, confidence = zip(*(field.sample(places, t) for t, places in enumerate(truth["x"][:-1].astype(np.float64))))
        error = np.linalg.norm(np.stack(got) - want, axis=-1) / np.linalg.norm(want, axis=-1)
        errors.append(error[:, free].ravel())
        confidences.append(np.stack(confidence)[:, free].ravel())
        most, off = outside(field, truth["x"]), drift(field, read_trajectories(file), take)
        good &= most < UNKNOWN and off < DRIFT
        fifths = by_confidence(errors[-1], confidences[-1])
        print(f"{name:8} {fifths}   outside {most:.3f}   free run {off:.1f} % of the way off", flush=True)
    together, ratio = np.concatenate(errors), 0.0
    order = np.array_split(np.argsort(np.concatenate(confidences)), FIFTHS)
    ratio = together[order[0]].mean() / together[order[-1]].mean()
    print(f"all      {by_confidence(together, np.concatenate(confidences))}   least over most confident fifth: {ratio:.1f}")
    return 0 if good and ratio >= RATIO else 1


def by_confidence(error: np.ndarray, confidence: np.ndarray) -> str:
    """Mean error [%] of each fifth, the least confident first."""
    return " ".join(f"{100 * error[part].mean():5.1f}" for part in np.array_split(np.argsort(confidence), FIFTHS)) + " %"


def outside(field: ForceField, x: np.ndarray) -> float:
    """Largest confidence at random points in twice the box that no particle of x (T+1, N, 3) [m] ever came near."""
    middle, half = field.box.mean(axis=0), field.box[1] - field.box[0]
    points = np.random.default_rng(0).uniform(middle - half, middle + half, (QUERIES, 3))
    spacing = float(np.median(cKDTree(x[0]).query(x[0], k=2)[0][:, 1]))
    far = cKDTree(x.reshape(-1, 3)).query(points)[0] > AWAY * spacing
    return max(float(field.sample(points[far], t)[1].max()) for t in range(field.frames))


def drift(field: ForceField, body: Trajectories, take: Path) -> float:
    """Distance of a free run's end from the true particles, in percent of how far these travelled; both are root mean squares."""
    found = read_recovery(Take(take))
    particles, material = replace(body.particles, stiffness=found.stiffness), as_found(body.material, found)
    model, _ = model_for(particles, material, body.fps, gravity=body.gravity, clamp_depth=found.clamp_depth)
    model = replace(model, substeps=found.substeps or model.substeps)
    start = State.at_rest(body.particles.x)
    state, density = State(start.x, found.v0, start.C, start.F), body.material.density
    for t in range(field.frames):
        force, gradient = extrapolate(field, state.x, t)
        state = advance(model, state, force / density, gradient / density, frame=t)
    free, path = ~body.particles.pinned, body.targets.x
    way = np.linalg.norm(np.diff(path[:, free], axis=0), axis=-1).sum(axis=0)
    return float(100.0 * np.sqrt(((state.x - path[-1])[free] ** 2).sum(axis=-1).mean() / (way**2).mean()))


if __name__ == "__main__":
    sys.exit(main())
