"""What the recovery should follow, tracks in pixels or the points lifted from them: benchmarks/footage/targets.py SHARED TAKES CASE ...

For takes that `truth.py SHARED --takes TAKES CASE ...` left ("sheet from pixels", "banner from pixels", "sheet from the side" ...): the
same body and the same tracks once as they were seen, residual = projection of the simulated points less the track, and twice lifted to 3D
(`observe/object/motion/lifting.py`): as points whose noise is measured, and as points with a covariance, ALONG times as uncertain along
the view as across it, where it is the tracks' own. All solves run here and are scored on the stored field.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT)]  # a script of the source tree: it runs with the package installed or not

from seeing_wind.engine.field.distillation import distill  # noqa: E402
from seeing_wind.engine.look.report.accuracy import field_errors, uniform_errors  # noqa: E402
from seeing_wind.engine.progress import NoProgress  # noqa: E402
from seeing_wind.engine.record_arrays import from_arrays, read_body  # noqa: E402
from seeing_wind.engine.records import Body, Observation, PointTargets, TrackTargets  # noqa: E402
from seeing_wind.engine.recovery.recover import recover  # noqa: E402
from seeing_wind.engine.settings import RecoverSettings  # noqa: E402
from seeing_wind.engine.stages import track_targets  # noqa: E402
from seeing_wind.engine.take import Take  # noqa: E402

ALONG = 10.0
"""Standard deviation of a lifted point along the view, over that across it."""


def main() -> int:
    """A row per case; 1 when points did better, as tracks are the default of `recover`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shared", type=Path, metavar="SHARED")
    parser.add_argument("takes", type=Path, metavar="TAKES")
    parser.add_argument("case", nargs="+", metavar="CASE")
    options = parser.parse_args()
    sums = np.zeros((3, 2))
    for case in options.case:
        truth = np.load(options.shared / f"truth/{case.split()[0]}.npz", allow_pickle=False)
        take = Take(options.takes / f"{case.replace(' ', '_')}.take")
        body, observation = read_body(take), from_arrays(Observation, take.read_arrays("observation.npz"))
        tracks = track_targets(observation, body)
        seen = tracks.visible
        points = PointTargets(np.where(seen[..., None], body.lifted, np.nan), seen, tracks.attachment)
        told = replace(points, covariance=covariance(tracks, body))
        found = np.array([errors(truth, body, targets, observation.fps) for targets in ([tracks], points, told)])
        flat = uniform_errors(truth["acc"] * float(truth["rho"]), ~truth["fixed"])
        sums += found
        row = "   ".join(f"{name} {e[0]:5.1f} % {e[1]:5.1f} deg" for name, e in zip(("tracks", "lifted points", "with covariance"), found))
        print(f"{case:20} {row}   uniform field {flat[0]:.1f} % {flat[1]:.1f} deg", flush=True)
    return 0 if (sums[0] <= sums[1:]).all() else 1


def covariance(tracks: TrackTargets, body: Body) -> np.ndarray:
    """(K, 3, 3) [m²] of the lifted points: the tracks' noise at their depth, ALONG times as much along the view of the first frame."""
    ray = np.nanmean(body.lifted, axis=0) - tracks.camera.pose(0)[:3, 3]
    distance = np.linalg.norm(ray, axis=1)
    ray, across = ray / distance[:, None], np.nanmedian(tracks.sigma, axis=0) * distance / tracks.camera.fx
    return across[:, None, None] ** 2 * (np.eye(3) + (ALONG**2 - 1.0) * ray[:, :, None] * ray[:, None, :])


def errors(truth: np.lib.npyio.NpzFile, body: Body, targets: list[TrackTargets] | PointTargets, fps: float) -> tuple[float, float]:
    """Magnitude [%] and direction error [degrees] of the field recovered from `targets`, at the true particles."""
    settings = replace(RecoverSettings(), gravity=(0.0, 0.0, 0.0))
    found = recover(body.particles, body.material, targets, fps, settings, NoProgress())
    field = distill(found, body.particles, fps)
    got = np.stack([field.sample(x, t)[0] for t, x in enumerate(truth["x"][:-1].astype(np.float64))])
    return field_errors(truth["acc"] * float(truth["rho"]), got, ~truth["fixed"])


if __name__ == "__main__":
    sys.exit(main())
