"""Long scenes of held bodies in gusts of a known spectrum: benchmarks/scenes/held_scenes.py FOLDER KIND-SEED ...

Needs Genesis, as `genesis_scenes.py` does, and writes the same files: FOLDER/truth/KIND-SEED.npz. A seed draws the body's size, stiffness
and density and the gusts, so that there are as many scenes as are wanted. Seeds below 100 are for development: settings may be chosen on
them. Those from 100 on are for reports. With a c after it (stalk-1c) the field acts on what is held, too, which creeps in Genesis.

Kinds: stalk (gusts longer than the body), waves (gusts as long as the body), reed (swings by half its length), struck (two frames of
force, then still air), banner (a thick sheet, held along an edge), foam (a plastic post, one second).
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from genesis_scenes import CENTRE, FPS, Scene, Wave, write

SECONDS = 4

TALL = 0.44
"""Height of posts [m], of which the uppermost CLAMPED is held."""
CLAMPED = 0.06
LAYERS = 0.055
"""Smallest thickness [m]: a body of fewer than four layers of particles creeps in Genesis."""
ROUGHNESS = 5.0 / 6.0
"""Exponent of the von Kármán spectrum of gusts along the wind, S(f) ~ (1 + 70.8 (f T)²)^(-5/6)."""


def main() -> None:
    """Simulate the scenes named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("name", nargs="+", metavar="KIND-SEED")
    options = parser.parse_args()
    scenes = {}
    for name in options.name:
        match = re.fullmatch(r"([a-z]+)-(\d+)(c?)", name)
        if match is None or match[1] not in KINDS:
            parser.error(f"no scene {name}; it is KIND-SEED, such as stalk-1, and the kinds are {', '.join(KINDS)}")
        scene = KINDS[match[1]](np.random.default_rng([int(match[2]), list(KINDS).index(match[1])]))
        scenes[name] = replace(scene, calm_clamp=not match[3])
    write(options.folder, scenes)


def gusts(rng: np.random.Generator, size: float, period: float, length: float, count: int = 10) -> tuple[Wave, ...]:
    """A steady wind of `size` [m/s²] and gusts of 0.6 of it (rms), of von Kármán's spectrum.

    Args:
        period: integral time scale T of the gusts [s].
        length: shortest wavelength [m].
        count: waves, at frequencies that are log-uniform from 0.1 to 4 Hz.
    """
    turn = rng.uniform(0.0, 2.0 * np.pi)
    steady = size * np.array([np.cos(turn), np.sin(turn), 0.2 * rng.normal()])
    edges = np.geomspace(0.1, 4.0, count + 1)
    rates = edges[:-1] * (edges[1:] / edges[:-1]) ** rng.uniform(size=count)
    power = np.diff(edges) * (1.0 + 70.8 * (rates * period) ** 2) ** -ROUGHNESS
    amplitudes = 0.6 * size * np.sqrt(2.0 * power / power.sum())
    waves = [Wave(tuple(steady), (0.0, 0.0, 0.0), 0.0, np.pi / 2)]
    for rate, amplitude in zip(rates, amplitudes):
        towards = rng.normal(size=3) * (1.0, 1.0, 0.5)  # half as much along the body
        k = rng.normal(size=3)
        k *= 2.0 * np.pi / (length * np.linalg.norm(k)) * rng.uniform(0.5, 1.0)
        towards *= amplitude / np.linalg.norm(towards)
        waves.append(Wave(tuple(towards), tuple(k), 2.0 * np.pi * rate * rng.choice((-1, 1)), rng.uniform(0.0, 2.0 * np.pi)))
    return tuple(waves)


def post(rng: np.random.Generator, frequency: float, waves: tuple[Wave, ...], **more) -> Scene:
    """A held post of random section and density whose first natural frequency [Hz] is about `frequency`."""
    sides = rng.uniform(1.0, 1.5, 2) * LAYERS
    rho, free = rng.uniform(250.0, 600.0), TALL - CLAMPED
    # Euler and Bernoulli's cantilever: f = 1.875² / (2 pi L²) sqrt(E h² / (12 rho))
    slender = (2.0 * np.pi * frequency * free**2 / 1.875**2) ** 2
    stiffness = 12.0 * rho * slender / min(sides) ** 2
    return Scene(
        ("box", (*map(float, sides), TALL)), float(stiffness), float(rho), waves,
        held_above=float(CENTRE[2] + TALL / 2 - CLAMPED), frames=round(SECONDS * FPS), **more,
    )  # fmt: skip


def stalk(rng: np.random.Generator) -> Scene:
    """Gusts of 2 m on a post of 0.44 m."""
    return post(rng, rng.uniform(0.8, 1.4), gusts(rng, rng.uniform(0.6, 1.2), 0.5, 2.0))


def waves(rng: np.random.Generator) -> Scene:
    """Gusts of 0.5 m on the same."""
    return post(rng, rng.uniform(0.8, 1.4), gusts(rng, rng.uniform(0.6, 1.2), 0.3, 0.5))


def reed(rng: np.random.Generator) -> Scene:
    """A post so soft that it swings by about half its length."""
    return post(rng, rng.uniform(0.45, 0.6), gusts(rng, rng.uniform(0.8, 1.2), 0.6, 2.0))


def struck(rng: np.random.Generator) -> Scene:
    """A blow of two frames and nothing after it."""
    turn, strength = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(8.0, 14.0)
    force = (float(strength * np.cos(turn)), float(strength * np.sin(turn)), 0.0)
    blow = Wave(force, (0.0, 0.0, float(rng.uniform(2, 4))), 0.0, 0.5 * np.pi)
    return post(rng, rng.uniform(1.0, 1.6), (blow,), blows=2)


def banner(rng: np.random.Generator) -> Scene:
    """A square of 0.3 m, as thin as it may be, held along its upper edge."""
    side, rho = 0.3, rng.uniform(200.0, 350.0)
    return Scene(
        ("box", (side, LAYERS, side)), float(rho * rng.uniform(60.0, 120.0)), float(rho), gusts(rng, rng.uniform(0.8, 1.4), 0.4, 0.6),
        held_above=float(CENTRE[2] + side / 2 - 0.04), frames=round(SECONDS * FPS),
    )  # fmt: skip


def foam(rng: np.random.Generator) -> Scene:
    """A post that yields at its foot."""
    scene = post(rng, rng.uniform(1.5, 2.0), gusts(rng, rng.uniform(3.0, 4.0), 0.4, 1.0), yield_stress=1.0)
    strain = rng.uniform(0.008, 0.014)
    return replace(scene, yield_stress=float(strain * scene.E), frames=round(FPS))


KINDS: dict[str, Callable[[np.random.Generator], Scene]] = {
    "stalk": stalk, "waves": waves, "reed": reed, "struck": struck, "banner": banner, "foam": foam,
}  # fmt: skip


if __name__ == "__main__":
    main()
