"""What a change of a motion costs, carried along (`mpm.tangent`) and by a simulation of its own:
benchmarks/speed/tangents.py [--changes B].

A block of rubber and one of clay, held at their feet, bend under a random force. Both ways give the motions after the same B changes of
the force; they take turns, and the ratio is that of the least processor time of each, with all that they do.

Then all changes of a block of frames, each as large as a recovery expects it: as mixtures of few columns (`mpm.body.columns`) and, with
none left out of the singular value decomposition, each by itself.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from seeing_wind.engine.materials import MATERIALS  # noqa: E402
from seeing_wind.engine.mpm.batch import rollout_batch  # noqa: E402
from seeing_wind.engine.mpm.body import columns  # noqa: E402
from seeing_wind.engine.mpm.model_for import model_for  # noqa: E402
from seeing_wind.engine.mpm.state import State  # noqa: E402
from seeing_wind.engine.mpm.tangent import Changes, tangents  # noqa: E402
from seeing_wind.engine.progress import NoProgress  # noqa: E402
from seeing_wind.engine.records import Particles  # noqa: E402
from seeing_wind.engine.recovery.prior.basis import SpatialBasis, spatial_basis  # noqa: E402
from seeing_wind.engine.recovery.prior.kernel import Kernel, Places  # noqa: E402

FRAMES, MODES, SPACING, SIZE = 2, 8, 0.01, (10, 8, 16)
BLOCK, KNOT, FULL = 24, 2, 16
"""Frames of a block, those between the knots of a recovery's force, and its modes."""
STEP = 1e-3
"""Of the change, for the simulations."""
TURNS = 3


Way = Callable[[np.ndarray], np.ndarray]


def bent(law: str, frames: int = FRAMES, modes: int = MODES) -> tuple[Way, Way, np.ndarray, SpatialBasis]:
    """Functions that give changed positions (B, T+1, N, 3) [m] for changes (B, T, P, 3) [m/s²]: carried, simulated; x (N, 3), modes."""
    x = np.stack(np.meshgrid(*(SPACING * (np.arange(count) + 0.5) for count in SIZE), indexing="ij"), axis=-1).reshape(-1, 3)
    body = Particles(x, np.full(len(x), SPACING**3), x[:, 2] < 0.015, SPACING)
    soft = replace(MATERIALS["rubber"], density=1000.0, youngs_modulus=2e4, poisson_ratio=0.3)
    material = replace(soft, law=law, yield_stress=400.0, viscosity=0.0)
    model, _ = model_for(body, material, 30.0, gravity=(0.0, 0.0, -2.0))
    basis, start = spatial_basis(x, model.mass * ~body.pinned, modes), State.at_rest(x)
    force = 3.0 * np.random.default_rng(0).standard_normal((frames, modes, 3))

    def carried(change: np.ndarray) -> np.ndarray:
        return tangents(model, start, basis.phi, basis.gradient, force, Changes(change), NoProgress())[1]

    def simulated(change: np.ndarray) -> np.ndarray:
        every = np.concatenate([force[None], force + STEP * change])
        points = rollout_batch(model, start, basis.phi, basis.gradient, every, strict=True).x
        return (points[1:] - points[0]) / STEP

    return carried, simulated, x, basis


def least_seconds(ways: list[Callable[[], np.ndarray]]) -> tuple[list[float], float]:
    """Processor seconds of each of two ways, taking turns, and how far apart what they give is [1]."""
    found = [way() for way in ways]  # compiles, too
    apart = float(np.linalg.norm(found[0] - found[1]) / np.linalg.norm(found[1]))
    least = [np.inf, np.inf]
    for _turn in range(TURNS):
        for k, way in enumerate(ways):
            began = time.process_time()
            way()
            least[k] = min(least[k], time.process_time() - began)
    return least, apart


def block_of(law: str) -> str:
    """The row of a whole block of frames."""
    carried, _, x, basis = bent(law, BLOCK, FULL)
    knots, modes = BLOCK // KNOT, basis.phi.shape[1]
    still = np.repeat(x[None], BLOCK + 1, axis=0)
    size = np.sqrt(np.diag(Places.along(basis, still, KNOT * np.arange(knots)).covariance(Kernel(np.eye(3)))))
    change = np.repeat(np.diag(np.repeat(size, 3)).reshape(-1, knots, modes, 3), KNOT, axis=1)

    def each() -> np.ndarray:
        usual, columns.LEAST = columns.LEAST, 0.0
        try:
            return carried(change)
        finally:
            columns.LEAST = usual

    (mixed, apart), differ = least_seconds([partial(carried, change), each])
    return (
        f"{law}, {len(x)} particles, {len(change)} changes of {BLOCK} frames: as mixtures {mixed:.2f} s, each by itself {apart:.2f} s, "
        f"ratio {apart / mixed:.1f}; {100.0 * differ:.2g} % apart"
    )


def main() -> None:
    """Both laws, both ways, in turns."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--changes", type=int, default=96, metavar="B")
    count = parser.parse_args().changes
    for law in ("corotated", "von_mises"):
        carried, simulated, x, _ = bent(law)
        change = np.random.default_rng(1).standard_normal((count, FRAMES, MODES, 3))
        least, apart = least_seconds([partial(carried, change), partial(simulated, change)])
        print(
            f"{law}, {len(x)} particles, {count} changes: carried {least[0]:.2f} s, simulated {least[1]:.2f} s, "
            f"ratio {least[1] / least[0]:.1f}; {100.0 * apart:.2g} % apart"
        )
        print(block_of(law), flush=True)


if __name__ == "__main__":
    main()
