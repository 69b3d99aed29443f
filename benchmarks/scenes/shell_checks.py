"""Newton's cloth, as benchmarks/scenes/shell_scenes.py uses it, beside closed forms: benchmarks/scenes/shell_checks.py

Needs what shell_scenes.py needs. Prints

- how far the lower end of a hanging strip comes down by its own weight, beside areal density g length² / (2 E thickness);
- how far the end of a strip that is held level droops, along two directions of the lattice, beside the heavy elastica of the beam rigidity
  E thickness³ / 12 from the clamp, half a height of a triangle behind the last held vertex;
- a flag and a leaf in still air: their fastest vertex in the first two seconds and in the last of six;
- how far each heavy sheet of shell_scenes.py strays from itself if its substeps are halved, and if the wind's mean is 1 % stronger, by the
  measure of shell_truth.py: as sheets in the wind are chaotic, no prediction can be expected to come nearer.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from shell_cloth import FPS, NU, Mesh, Scene, Wind, cloth, hanging, lattice, rigidity, simulate
from shell_scenes import FRAMES, SCENES

STILL = Wind((0.0, 0.0, 0.0))
WEIGHT = 9.81
"""N/kg."""


def settled(scene: Scene, seconds: float = 3.0) -> np.ndarray:
    """Vertices (V, 3) [m] at rest: there is no air, but all velocities lose 2 % in every millisecond."""
    import newton

    vertices, faces = scene.mesh()
    model, count, _ = cloth(scene, vertices, faces, scene.held(vertices))
    solver = newton.solvers.SolverSemiImplicit(model, enable_tri_contact=False)
    state, after, control = model.state(), model.state(), model.control()
    every = max(1, round(count * FPS / 1000.0))
    for substep in range(round(seconds * FPS * count)):
        state.clear_forces()
        if substep % every == 0:
            state.particle_qd.assign(0.98 * state.particle_qd.numpy())
        solver.step(state, after, control, None, 1.0 / FPS / count)
        state, after = after, state
    return state.particle_q.numpy().astype(float)


def elastica(weight: float, stiffness: float, length: float) -> float:
    """How far [m] the end of a heavy strip droops, from its weight [N/m²] and its beam rigidity per width [N m]."""
    from scipy.integrate import solve_bvp

    s = np.linspace(0.0, length, 200)
    angle = solve_bvp(
        lambda s, y: np.stack([y[1], -weight * (length - s) * np.cos(y[0]) / stiffness]),
        lambda a, b: np.array([a[0], b[1]]), s, np.stack([0.5 * s / length, 0.5 * np.ones_like(s)]),
    ).sol(s)[0]  # fmt: skip
    return float(np.trapezoid(np.sin(angle), s))


def across(mesh: Mesh) -> Mesh:
    """The strip with its length along the rows of the lattice: x and z are swapped."""
    return mesh[0][:, [2, 1, 0]], mesh[1][:, ::-1]


def strays(path: np.ndarray, reference: np.ndarray, held: np.ndarray) -> float:
    """Mean distance of the free vertices on `path` (T+1, V, 3) from `reference`, relative to their mean distance from the start [%]."""
    free = reference[:, ~held]
    travel = np.linalg.norm(free - free[0], axis=2).max(axis=0).mean()
    return 100.0 * float(np.linalg.norm(path[:, ~held] - free, axis=2).mean() / travel)


def print_repeats() -> None:
    """Compare the heavy sheets with repetitions of themselves."""
    for name in (name for name in SCENES if name.endswith("_heavy")):
        scene = SCENES[name]
        stronger = replace(scene, wind=replace(scene.wind, mean=tuple(1.01 * part for part in scene.wind.mean)))
        reference = simulate(scene, FRAMES)
        finer, blown = (strays(moved["x"], reference["x"], reference["fixed"])
                        for moved in (simulate(scene, FRAMES, finer=2), simulate(stronger, FRAMES)))  # fmt: skip
        print(f"{name}: half the substep moves it by {finer:.1f} % of its way, 1 % more mean wind by {blown:.1f} %", flush=True)


def main() -> None:
    """All checks."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    strip = Scene(lambda: hanging(0.6, 0.15, 0.03), lambda x: x[:, 2] > -1e-6, STILL, 0.12, 2000.0, 4e-4)
    rest = strip.mesh()[0]
    down = -(settled(strip) - rest)[np.isclose(rest[:, 2], rest[:, 2].min()), 2].mean()
    length = -rest[:, 2].min()
    wanted = strip.areal_density * WEIGHT * length**2 / (2.0 * strip.tensile_stiffness)
    print(f"hanging strip: {1e3 * down:.4f} mm, closed form {1e3 * wanted:.4f} mm ({100.0 * (down / wanted - 1.0):+.1f} %)")
    for edge in (0.016, 0.008):
        for name, mesh in (("lines", lambda: lattice(0.2, 0.08, edge)), ("rows", lambda: across(lattice(0.08, 0.2, edge)))):  # noqa: B023
            beam = Scene(lambda: (lambda v, f: (v[:, [0, 2, 1]], f))(*mesh()), lambda x: x[:, 0] < 1.01 * edge, STILL, 0.3, 3000.0, 5e-3)  # noqa: B023
            rest = beam.mesh()[0]
            held = rest[beam.held(rest), 0].max()
            end = rest[:, 0] > rest[:, 0].max() - 0.6 * edge
            drop = -(settled(beam) - rest)[end, 2].mean()
            tip = rest[end, 0].mean()
            wanted = elastica(beam.areal_density * WEIGHT, rigidity(beam) * (1.0 - NU**2), tip - held + 0.5 * np.sqrt(0.75) * edge)
            print(
                f"strip along the {name}, edges of {1e3 * edge:.0f} mm: {1e3 * drop:.1f} mm, elastica {1e3 * wanted:.1f} mm"
                f" ({100.0 * (drop / wanted - 1.0):+.1f} %)"
            )
    for name in ("dev_flag", "dev_leaf"):
        scene = SCENES[name]
        x = simulate(Scene(scene.mesh, scene.held, STILL, scene.areal_density, scene.tensile_stiffness, scene.thickness), 180)["x"]
        speed = FPS * np.linalg.norm(np.diff(x, axis=0), axis=2).max(axis=1)
        print(f"{name} in still air: fastest vertex {speed[:60].max():.2f} m/s, in the last second {speed[-30:].max():.3f} m/s")
    print_repeats()


if __name__ == "__main__":
    main()
