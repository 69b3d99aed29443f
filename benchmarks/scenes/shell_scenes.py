"""Sheets of cloth that another engine moves in known winds: benchmarks/scenes/shell_scenes.py FOLDER [SCENE ...] [--frame]

Needs Newton 1.8 and SciPy (`pip install newton scipy`, in an environment of their own) and nothing of this project. Newton's cloth feels
gravity and the drag of the air, which benchmarks/scenes/shell_cloth.py computes for each face, 64 times a frame, and adds as a force.

Writes FOLDER/SCENE.npz: what `recover-trajectories` reads of a shell (x (T+1,V,3) m, faces (F,3), areal_density kg/m², thickness m, E Pa,
nu, damping, fixed (V,), fps, gravity, name), and the truth: wind (T,V,3) m/s at the vertices and force (T,V,3) N of the air on them, both
as means over each frame. Every sheet begins flat, unstrained and at rest.

The scenes dev_... are for development, r_... for reports: nothing in the engine was chosen on these. `KIND-SEED` is a random flag,
curtain, fall or leaf in a random wind; seeds from 100 on are for reports. A scene's name with `_heavy` is the same sheet with twice the
areal density in the same wind. `benchmarks/scenes/shell_checks.py` compares Newton's cloth with closed forms.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from shell_cloth import Scene, Vortex, Wave, Wind, hanging, lattice, leaf, simulate, turned

FRAMES = 90


def none(x: np.ndarray) -> np.ndarray:
    """Nothing is held."""
    return np.zeros(len(x), bool)


LIGHT = {
    "dev_flag": Scene(
        lambda: lattice(0.6, 0.4, 0.03), lambda x: x[:, 0] < 1e-6,
        Wind((4.0, 0.8, 0.2), (
            Wave((0.5, 1.2, 0.2), (3.0, 0.0, 1.0), 8.0, 0.4), Wave((0.3, 0.7, -0.3), (1.0, 2.0, 5.0), 13.0, 2.0),
            Wave((0.8, -0.5, 0.0), (0.5, 1.0, 0.0), 4.0, 1.0))),
        0.12, 2000.0, 4e-4),
    "dev_curtain": Scene(
        lambda: hanging(0.8, 0.6, 0.036), lambda x: x[:, 2] > -1e-6,
        Wind((0.3, 1.6, 0.0), (
            Wave((0.1, 1.3, 0.2), (4.0, 0.0, 2.0), 5.0, 0.3), Wave((0.3, 0.8, 0.1), (0.0, 0.0, 4.0), -7.0, 1.2),
            Wave((0.2, 0.9, 0.1), (0.0, 0.0, 0.0), 3.0, 0.0))),
        0.18, 2500.0, 5e-4),
    "dev_fall": Scene(
        lambda: turned(lattice(0.45, 0.3, 0.022), (1.2, 0.2, 0.3)), none,
        Wind((0.8, 0.5, 0.6), (
            Wave((0.6, 0.4, 0.5), (2.5, 0.0, 1.5), 5.0, 0.4), Wave((-0.3, 0.6, 0.4), (0.0, 3.0, -2.0), 8.0, 1.5))),
        0.1, 1500.0, 1.5e-3),
    "dev_leaf": Scene(
        lambda: turned(leaf(0.20, 0.12, 0.0085), (1.0, 0.0, 0.0)), lambda x: x[:, 0] < 0.01,
        Wind((0.6, 1.6, 1.2), (
            Wave((0.4, 0.9, 0.9), (3.0, 1.0, 0.0), 7.0, 0.2), Wave((0.5, -0.3, 0.8), (0.0, 5.0, 6.0), 10.0, 1.7))),
        0.3, 3000.0, 5e-3),
    "r_flag": Scene(
        lambda: lattice(0.9, 0.6, 0.034), lambda x: x[:, 0] < 1e-6,
        Wind((5.0, -0.6, 0.3), (
            Wave((0.6, 1.6, 0.1), (2.0, 0.5, -1.5), 9.0, 1.4), Wave((0.2, 0.9, 0.4), (4.5, 0.0, 3.0), 17.0, 0.2),
            Wave((1.0, 0.6, 0.2), (0.3, 0.0, 0.3), 3.0, 2.2)), (Vortex(1.5, 0.3, (-2.0, 0.5, 0.3), (2.5, -0.2, 0.0)),)),
        0.16, 2400.0, 5e-4),
    "r_curtain": Scene(
        lambda: hanging(1.0, 0.5, 0.031), lambda x: x[:, 2] > -1e-6,
        Wind((-0.4, 1.2, 0.1), (
            Wave((0.3, 1.0, 0.2), (2.0, 1.0, 3.0), 4.0, 2.3), Wave((0.1, 1.1, -0.2), (-5.0, 0.0, 1.0), 6.0, 0.5)),
            (Vortex(1.2, 0.25, (-1.0, 0.2, 0.0), (0.9, 0.0, 0.0)),)),
        0.11, 1800.0, 4e-4),
    "r_fall": Scene(
        lambda: turned(lattice(0.32, 0.32, 0.019), (0.9, -0.4, -0.2)), none,
        Wind((-0.5, 0.9, 0.9), (
            Wave((0.5, 0.5, 0.6), (1.5, 3.0, 0.0), 6.0, 1.1), Wave((0.7, -0.4, 0.3), (0.0, 1.0, 3.5), -4.0, 0.3)),
            (Vortex(1.0, 0.35, (0.6, -0.8, 0.0), (-0.4, 0.7, 0.0)),)),
        0.14, 2000.0, 1e-3),
    "r_leaf": Scene(
        lambda: turned(leaf(0.26, 0.12, 0.0090), (0.6, 0.0, 0.4)), lambda x: np.linalg.norm(x, axis=1) < 0.02,
        Wind((1.0, 1.2, 1.6), (
            Wave((0.5, 1.2, 0.6), (1.0, 4.0, 2.0), 9.0, 0.9), Wave((0.4, 0.6, 1.0), (0.5, 0.5, 0.5), 5.0, 2.6)),
            (Vortex(1.3, 0.25, (-1.0, -0.6, 0.2), (1.0, 0.6, 0.0)),)),
        0.24, 3500.0, 6e-3),
}  # fmt: skip
SCENES = LIGHT | {f"{name}_heavy": replace(scene, areal_density=2.0 * scene.areal_density) for name, scene in LIGHT.items()}


def random_flag(seed: int) -> Scene:
    """A flag of random size, weight and stiffness in a wind of three random waves and, if the seed is even, a vortex."""
    rng = np.random.default_rng([seed, sum(map(ord, "flag"))])
    rng.uniform()
    length = rng.uniform(0.6, 0.9)
    mean = (rng.uniform(3.5, 5.5), rng.uniform(-1.0, 1.0), rng.uniform(-0.3, 0.4))
    wind = _random_wind(rng, seed, mean, 3, (1.0, 1.0, 0.5), 1.2)
    return Scene(
        lambda: lattice(length, length * 2.0 / 3.0, length / 25.0), lambda x: x[:, 0] < 1e-6, wind,
        rng.uniform(0.1, 0.18), rng.uniform(1800.0, 2600.0), rng.uniform(3e-4, 6e-4),
    )  # fmt: skip


def random_curtain(seed: int) -> Scene:
    """A random curtain, as `random_flag`; the wind comes mainly from one of its sides."""
    rng = np.random.default_rng([seed, sum(map(ord, "curtain"))])
    length, width = rng.uniform(0.7, 1.0), rng.uniform(0.45, 0.65)
    mean = (rng.uniform(-0.6, 0.6), float(rng.choice([-1, 1])) * rng.uniform(1.0, 1.8), rng.uniform(-0.2, 0.2))
    wind = _random_wind(rng, seed, mean, 2, (0.3, 1.0, 0.3), 1.7)
    return Scene(
        lambda: hanging(length, width, length / 26.0), lambda x: x[:, 2] > -1e-6, wind,
        rng.uniform(0.1, 0.2), rng.uniform(1800.0, 2600.0), rng.uniform(3e-4, 6e-4),
    )  # fmt: skip


def random_fall(seed: int) -> Scene:
    """A free sheet that falls from a random attitude, as `random_flag`."""
    rng = np.random.default_rng([seed, sum(map(ord, "fall"))])
    length, width = rng.uniform(0.3, 0.45), rng.uniform(0.28, 0.34)
    mean = (rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0), rng.uniform(0.4, 1.0))
    wind = _random_wind(rng, seed, mean, 2, (1.0, 1.0, 1.0), 1.3)
    attitude = (rng.uniform(0.8, 1.4), rng.uniform(-0.4, 0.4), rng.uniform(-0.4, 0.4))
    return Scene(
        lambda: turned(lattice(length, width, width / 15.0), attitude), none, wind,
        rng.uniform(0.09, 0.15), rng.uniform(1500.0, 2200.0), rng.uniform(9e-4, 1.6e-3),
    )  # fmt: skip


def random_leaf(seed: int) -> Scene:
    """A leaf that is held at its base, as `random_flag`."""
    rng = np.random.default_rng([seed, sum(map(ord, "leaf"))])
    length, width = rng.uniform(0.18, 0.27), rng.uniform(0.11, 0.13)
    mean = (rng.uniform(0.4, 1.2), rng.uniform(0.9, 1.8), rng.uniform(0.9, 1.8))
    wind = _random_wind(rng, seed, mean, 2, (0.6, 1.0, 1.0), 1.6)
    attitude = (rng.uniform(0.3, 1.1), rng.uniform(-0.2, 0.2), rng.uniform(-0.4, 0.4))
    return Scene(
        lambda: turned(leaf(length, width, length / 24.0), attitude), lambda x: np.linalg.norm(x, axis=1) < 0.02, wind,
        rng.uniform(0.22, 0.32), rng.uniform(2800.0, 3600.0), rng.uniform(4.5e-3, 6.5e-3),
    )  # fmt: skip


def _random_wind(rng: np.random.Generator, seed: int, mean: tuple[float, ...], waves: int, way: tuple[float, ...], size: float) -> Wind:
    """A random wind with waves of 0.3 to 0.8 times `size` [m/s], whose directions have the spread `way`."""
    several = []
    for _ in range(waves):
        along = rng.normal(size=3) * way
        amplitude = size * rng.uniform(0.3, 0.8) * along / np.linalg.norm(along)
        wave = rng.normal(size=3) * rng.uniform(0.5, 4.0)
        several.append(Wave(tuple(amplitude), tuple(wave), float(rng.choice([-1, 1]) * rng.uniform(3.0, 12.0)), rng.uniform(0.0, 6.28)))
    if seed % 2:
        return Wind(mean, tuple(several))
    speed, start = rng.uniform(0.8, 1.5), rng.uniform(-1.5, -0.5, 3) * [1.0, 1.0, 0.2]
    return Wind(mean, tuple(several), (Vortex(speed, 0.3, tuple(start), tuple(np.array([1.2, 0.6, 0.0]) * rng.uniform(0.6, 1.4))),))


RANDOM = {"flag": random_flag, "curtain": random_curtain, "fall": random_fall, "leaf": random_leaf}
"""KIND in a name KIND-SEED -> the function that makes the scene from the seed."""


def named(name: str) -> Scene | None:
    """The scene with that name; None if there is none."""
    kind, _, seed = name.partition("-")
    return RANDOM[kind](int(seed)) if kind in RANDOM and seed.isdecimal() else SCENES.get(name)


def draw(found: dict[str, np.ndarray], path: Path) -> None:
    """Five moments of the scene, with the wind at some vertices."""
    from matplotlib import pyplot

    x, wind = found["x"], found["wind"]
    figure = pyplot.figure(figsize=(20, 4.5))
    for number, t in enumerate(np.linspace(0, len(wind) - 1, 5).round().astype(int)):
        axes = figure.add_subplot(1, 5, number + 1, projection="3d", title=f"frame {t}")
        axes.plot_trisurf(*x[t].T, triangles=found["faces"], color="tab:orange", edgecolor="black", linewidth=0.15)
        some = slice(None, None, max(1, len(x[t]) // 40))
        axes.quiver(*x[t][some].T, *(0.04 * wind[t][some]).T, color="tab:blue", linewidth=0.8)
        axes.set_aspect("equal")
    figure.tight_layout()
    figure.savefig(path, dpi=70)
    pyplot.close(figure)


def main() -> None:
    """Simulate the scenes named, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("scenes", nargs="*", metavar="SCENE", default=list(SCENES), help=f"KIND-SEED, or some of: {', '.join(SCENES)}")
    parser.add_argument("--image", action="store_true", help="also FOLDER/SCENE.png (needs Matplotlib)")
    options = parser.parse_args()
    unknown = sorted(name for name in options.scenes if named(name) is None)
    if unknown:
        parser.error(f"no scene {', '.join(unknown)}; there are {'-SEED, '.join(RANDOM)}-SEED and {', '.join(SCENES)}")
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in options.scenes:
        scene = named(name)
        assert scene is not None
        found = simulate(scene, FRAMES)
        np.savez_compressed(options.folder / f"{name}.npz", name=name, **found)
        if options.image:
            draw(found, options.folder / f"{name}.png")
        way = np.linalg.norm(np.diff(found["x"], axis=0), axis=2).sum(axis=0).mean()
        print(f"{name}: {len(found['fixed'])} vertices, {found['fixed'].sum()} held; way of a vertex {way:.2f} m", flush=True)


if __name__ == "__main__":
    main()
