"""Building a sample clip of something flat and held that a known wind moves: what `flag` and `potted_plant` share.

A scene gives a `Plate` (outlines, frame, what it is made of, where it is held) and a wind; this file lays particles and simulates with
the engine's own solver; `clip_files` writes the files and has Blender render the clip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import clip_files
import numpy as np
from clip_files import Filmed
from outlines import flat_mesh, inside_any

from seeing_wind.engine.conventions import GRAVITY, NO_GRAVITY
from seeing_wind.engine.field.analytic import ForceFieldAnalytic
from seeing_wind.engine.look.report.accuracy import uniform_errors
from seeing_wind.engine.materials import Material, adjust, find
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import advance
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.observe.object.motion.control import attach
from seeing_wind.engine.records import Particles

SPACING = 0.012
"""Of the particles [m], unless told otherwise."""


@dataclass(frozen=True)
class Plate:
    """Something flat in the frame's plane. Plate coordinates: u right, v up [m]; (0, 0) is at `place` in the world."""

    name: str
    outlines: list[np.ndarray]
    """Closed polygons (P, 2); their union is the body."""
    held: Callable[[np.ndarray], np.ndarray]
    """(N, 2) -> (N,) bool, what never moves."""
    texture: np.ndarray
    """(S, S, 3) uint8 sRGB, row 0 at the top; it covers the square `texture_side` round the plate's (0, 0)."""
    texture_side: float
    material: str
    density: float
    youngs_modulus: float
    thickness: float
    place: tuple[float, float, float] = (0.0, 0.0, 1.0)
    distance: float = 2.0
    """From the camera [m]."""
    view_height: float = 0.9
    """What the frame shows at that distance, top to bottom [m]."""
    view_centre: tuple[float, float] = (0.0, 0.0)
    """Where the camera looks, in plate coordinates."""
    bears_weight: bool = True
    """Whether the outlines show it as its weight has bent it, so that it is simulated without gravity; False: the wind has to carry it."""
    stand: tuple[np.ndarray, np.ndarray, tuple[float, float, float]] | None = None
    """What it is fixed to: vertices (V, 3) [m, world], triangles (M, 3), linear colour."""

    def stuff(self) -> Material:
        """The library's material with this plate's numbers."""
        return adjust(find(self.material), density=self.density, youngs_modulus=self.youngs_modulus)

    def world(self, flat: np.ndarray, depth: float) -> np.ndarray:
        """Plate coordinates (N, 2) at `depth` behind the middle plane -> world (N, 3)."""
        return np.stack([flat[:, 0], np.full(len(flat), depth), flat[:, 1]], 1) + self.place


WindOf = Callable[[Plate, np.random.Generator, float, int], ForceFieldAnalytic]


def main(plate: Callable[[int], Plate], wind: WindOf, argv: list[str] | None, about: str, frames: int) -> int:
    """Build everything into --out; returns the exit code."""
    chosen = clip_files.options(about, argv, seed=3, frames=frames, fps=24.0, size="480x360", samples=8, spacing=SPACING)

    def film() -> Filmed:
        body = plate(chosen.seed)
        return simulate(body, wind(body, np.random.default_rng(chosen.seed), chosen.fps, chosen.frames), chosen.size, chosen.spacing)

    return clip_files.build(chosen, film, summary)


def summary(filmed: Filmed) -> str:
    """How far it moves, and how hard it is."""
    held = filmed.truth["fixed"]
    magnitude, direction = uniform_errors(filmed.truth["acc"], ~held)
    farthest = np.linalg.norm(filmed.x - filmed.x[0], axis=-1).max()
    return (
        f"{held.sum()} particles are held; moved up to {100 * farthest:.0f} cm.\n"
        f"A uniform field with the right net force in every frame would be off by {magnitude:.0f} % and {direction:.0f} degrees."
    )


def lay_particles(plate: Plate, spacing: float) -> Particles:
    """Particles on a square lattice inside the outlines, in as many layers as the thickness holds: one would hardly resist bending."""
    every = np.concatenate(plate.outlines)
    low, high = every.min(0), every.max(0)
    axes = [(np.arange(np.floor(low[c] / spacing), np.ceil(high[c] / spacing)) + 0.5) * spacing for c in range(2)]
    flat = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    flat = flat[inside_any(plate.outlines, flat)]
    layers = max(round(plate.thickness / spacing), 2)
    depth = (np.arange(layers) + 0.5) * plate.thickness / layers - plate.thickness / 2
    x = np.concatenate([plate.world(flat, y) for y in depth])
    volume = np.full(len(x), spacing**2 * plate.thickness / layers)
    return Particles(x=x, volume=volume, pinned=np.tile(plate.held(flat), layers), spacing=spacing)


def simulate(plate: Plate, wind: ForceFieldAnalytic, size: tuple[int, int], spacing: float = SPACING) -> Filmed:
    """Let the plate go, at rest, in the wind, and in gravity unless it bears its weight as it is."""
    particles, material = lay_particles(plate, spacing), plate.stuff()
    model, _ = model_for(particles, material, wind.fps, gravity=NO_GRAVITY if plate.bears_weight else GRAVITY)
    state = State.at_rest(particles.x)
    x, v, acceleration = [state.x], [state.v], []
    for t in range(wind.frames):
        a = wind.sample(state.x, t)[0] / material.density
        state = advance(model, state, a, wind.gradient(state.x, t) / material.density, frame=t)
        acceleration.append(a)
        x.append(state.x)
        v.append(state.v)
    flat, triangles = flat_mesh(plate.outlines, 0.6 * SPACING)
    front = -plate.thickness / 2
    centre = (plate.place[0] + plate.view_centre[0], plate.place[2] + plate.view_centre[1])
    stand = {} if plate.stand is None else dict(zip(("stand_vertices", "stand_triangles", "stand_colour"), map(np.asarray, plate.stand)))
    return Filmed(
        name=plate.name, x=np.stack(x), wind=wind, known=clip_files.known_of_solid(material, plate.thickness),
        truth=clip_files.truth_of_solid(material, particles.pinned, np.stack(v), np.stack(acceleration)),
        surface=attach(plate.world(flat, front), particles.x).follow(np.stack(x)),
        triangles=triangles, uv=flat / plate.texture_side + 0.5, texture=plate.texture,
        camera=clip_files.level_camera(size, plate.distance, plate.view_height, centre, plate.place[1] + front),
        distance=plate.distance, held=plate.held(flat[triangles].mean(1)), more=stand,
    )  # fmt: skip
