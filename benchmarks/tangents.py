"""What a change of a motion costs, carried along (`mpm.tangent`) and by a simulation of its own: benchmarks/tangents.py [--changes B].

A block of rubber and one of clay, held at their feet, bend under a random force. Both ways give the motions after the same B changes of
the force; they take turns, and the ratio is that of the least processor time of each, with all that they do.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from seeing_wind.engine.materials import MATERIALS  # noqa: E402
from seeing_wind.engine.mpm.batch import rollout_batch  # noqa: E402
from seeing_wind.engine.mpm.model_for import model_for  # noqa: E402
from seeing_wind.engine.mpm.state import State  # noqa: E402
from seeing_wind.engine.mpm.tangent import Changes, tangents  # noqa: E402
from seeing_wind.engine.progress import NoProgress  # noqa: E402
from seeing_wind.engine.records import Particles  # noqa: E402
from seeing_wind.engine.recovery.prior.basis import spatial_basis  # noqa: E402

FRAMES, MODES, SPACING, SIZE = 2, 8, 0.01, (10, 8, 16)
STEP = 1e-3
"""Of the change, for the simulations."""
TURNS = 3


def bent(law: str) -> tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray], int]:
    """Functions that give changed positions (B, T+1, N, 3) [m] for changes (B, T, P, 3) [m/s²]: carried, simulated; and N."""
    x = np.stack(np.meshgrid(*(SPACING * (np.arange(count) + 0.5) for count in SIZE), indexing="ij"), axis=-1).reshape(-1, 3)
    body = Particles(x, np.full(len(x), SPACING**3), x[:, 2] < 0.015, SPACING)
    soft = replace(MATERIALS["rubber"], density=1000.0, youngs_modulus=2e4, poisson_ratio=0.3)
    material = replace(soft, law=law, yield_stress=400.0, viscosity=0.0)
    model, _ = model_for(body, material, 30.0, gravity=(0.0, 0.0, -2.0))
    basis, start = spatial_basis(x, model.mass * ~body.pinned, MODES), State.at_rest(x)
    force = 3.0 * np.random.default_rng(0).standard_normal((FRAMES, MODES, 3))

    def carried(change: np.ndarray) -> np.ndarray:
        return tangents(model, start, basis.phi, basis.gradient, force, Changes(change), NoProgress())[1]

    def simulated(change: np.ndarray) -> np.ndarray:
        every = np.concatenate([force[None], force + STEP * change])
        points = rollout_batch(model, start, basis.phi, basis.gradient, every, strict=True).points
        return (points[1:] - points[0]) / STEP

    return carried, simulated, len(x)


def main() -> None:
    """Both laws, both ways, in turns."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--changes", type=int, default=96, metavar="B")
    count = parser.parse_args().changes
    for law in ("corotated", "von_mises"):
        *ways, particles = bent(law)
        change = np.random.default_rng(1).standard_normal((count, FRAMES, MODES, 3))
        found = [way(change) for way in ways]  # compiles, too
        apart = np.linalg.norm(found[0] - found[1]) / np.linalg.norm(found[1])
        least = [np.inf, np.inf]
        for _turn in range(TURNS):
            for k, way in enumerate(ways):
                began = time.process_time()
                way(change)
                least[k] = min(least[k], time.process_time() - began)
        print(
            f"{law}, {particles} particles, {count} changes: carried {least[0]:.2f} s, simulated {least[1]:.2f} s, "
            f"ratio {least[1] / least[0]:.1f}; {100.0 * apart:.2g} % apart"
        )


if __name__ == "__main__":
    main()
