"""Building a sample clip of something flat and held that a known wind moves: what `flag` and `potted_plant` share.

A scene gives a `Plate` (outlines, picture, what it is made of, where it is held) and a wind; this file lays particles, simulates with the
engine's own solver, writes the files and has Blender render the clip.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from backdrop import make_backdrop
from in_blender import BlenderFailed, run
from outlines import flat_mesh, inside_any

from seeing_wind.engine.conventions import GRAVITY, front_view
from seeing_wind.engine.errors import SeeingWindError
from seeing_wind.engine.field.analytic import ForceFieldAnalytic
from seeing_wind.engine.materials import adjusted, find
from seeing_wind.engine.mpm.model import model_for
from seeing_wind.engine.mpm.rollout import advance
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.object.control import attach
from seeing_wind.engine.records import Camera, Material, Particles
from seeing_wind.engine.report.accuracy import uniform_errors


@dataclass(frozen=True)
class Plate:
    """Something flat in the picture's plane. Plate coordinates: u right, v up [m]; (0, 0) is at `place` in the world."""

    name: str
    outlines: list[np.ndarray]
    """Closed polygons (P, 2); their union is the body."""
    held: Callable[[np.ndarray], np.ndarray]
    """(N, 2) -> (N,) bool, what never moves."""
    picture: np.ndarray
    """(S, S, 3) uint8 sRGB, row 0 at the top; it covers the square `picture_side` round the plate's (0, 0)."""
    picture_side: float
    material: str
    density: float
    youngs_modulus: float
    thickness: float
    place: tuple[float, float, float] = (0.0, 0.0, 1.0)
    distance: float = 2.0
    """From the camera [m]."""
    view_height: float = 0.9
    """What the picture shows at that distance, top to bottom [m]."""
    view_centre: tuple[float, float] = (0.0, 0.0)
    """Where the camera looks, in plate coordinates."""
    stand: tuple[np.ndarray, np.ndarray, tuple[float, float, float]] | None = None
    """What it is fixed to: vertices (V, 3) [m, world], triangles (M, 3), linear colour."""
    spacing: float = field(default=0.012)
    """Of the particles [m]."""

    def stuff(self) -> Material:
        """The library's material with this plate's numbers."""
        return adjusted(find(self.material), density=self.density, youngs_modulus=self.youngs_modulus)

    def world(self, flat: np.ndarray, depth: float) -> np.ndarray:
        """Plate coordinates (N, 2) at `depth` behind the middle plane -> world (N, 3)."""
        return np.stack([flat[:, 0], np.full(len(flat), depth), flat[:, 1]], 1) + self.place


@dataclass(frozen=True)
class Motion:
    """What the simulation gave."""

    particles: Particles
    wind: ForceFieldAnalytic
    x: np.ndarray
    """(T+1, N, 3) [m]."""
    v: np.ndarray
    acceleration: np.ndarray
    """(T, N, 3) of the wind, f / rho at x[t] [m/s²]."""
    surface: np.ndarray
    """(T+1, V, 3) the side that faces the camera [m]."""
    triangles: np.ndarray
    flat: np.ndarray
    """(V, 2) plate coordinates of the surface."""


WindOf = Callable[[Plate, np.random.Generator, float, int], ForceFieldAnalytic]


def main(plate: Callable[[int], Plate], wind: WindOf, argv: list[str] | None, about: str) -> int:
    """Build everything into --out; returns the exit code."""
    options = parse(argv, about)
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    try:
        body = plate(options.seed)
        motion = simulate(body, wind(body, np.random.default_rng(options.seed), options.fps, options.frames), options.spacing)
        camera = make_camera(body, options.size)
        write(out, body, motion, camera, options.seed, options.samples)
        simulated = time.perf_counter()
        if not options.no_render:
            run(Path(__file__).with_name("render.py"), [str(out.resolve())], options.blender)
    except (SeeingWindError, BlenderFailed) as error:
        print(error, file=sys.stderr)
        return 1
    magnitude, direction = uniform_errors(motion.acceleration, ~motion.particles.pinned)
    farthest = np.linalg.norm(motion.x - motion.x[0], axis=-1).max()
    print(
        f"{len(motion.x)} pictures at {camera.width}x{camera.height}, {len(motion.particles.x)} particles, "
        f"{motion.particles.pinned.sum()} of them held; moved up to {100 * farthest:.0f} cm.\n"
        f"A uniform field with the right net force in every frame would be off by {magnitude:.0f} % and {direction:.0f} degrees.\n"
        f"Simulated in {simulated - started:.0f} s, rendered in {time.perf_counter() - simulated:.0f} s: {out}"
    )
    return 0


def parse(argv: list[str] | None, about: str) -> argparse.Namespace:
    """The options, checked."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, metavar="DIR")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--frames", type=int, default=28, metavar="T", help="frame intervals: the clip has one picture more")
    parser.add_argument("--fps", type=float, default=24.0)
    parser.add_argument("--size", default="480x360", metavar="WxH")
    parser.add_argument("--spacing", type=float, default=None, metavar="M", help="of the particles [m]")
    parser.add_argument("--samples", type=int, default=8, help="of Cycles, per pixel")
    parser.add_argument("--blender", metavar="PATH", help="instead of BLENDER=, the one on the PATH, or the bpy wheel")
    parser.add_argument("--no-render", action="store_true", help="all but clip.mp4")
    options = parser.parse_args(argv)
    try:
        options.size = tuple(int(part) for part in options.size.lower().split("x"))
    except ValueError:
        parser.error(f"--size {options.size} is not of the form 480x360")
    if len(options.size) != 2 or min(options.size) < 64 or any(side % 2 for side in options.size):
        parser.error("--size needs two even numbers of at least 64")
    if options.seed < 0 or options.frames < 3 or options.fps <= 0 or options.samples < 1:
        parser.error("--seed must not be negative, --frames at least 3, --fps and --samples above zero")
    if options.spacing is not None and not 0.002 <= options.spacing <= 0.05:
        parser.error("--spacing must be between 0.002 and 0.05")
    return options


def lay_particles(plate: Plate, spacing: float) -> Particles:
    """Particles on a square lattice inside the outlines, in as many layers as the thickness holds."""
    every = np.concatenate(plate.outlines)
    low, high = every.min(0), every.max(0)
    axes = [(np.arange(np.floor(low[c] / spacing), np.ceil(high[c] / spacing)) + 0.5) * spacing for c in range(2)]
    flat = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    flat = flat[inside_any(plate.outlines, flat)]
    layers = max(round(plate.thickness / spacing), 1)
    depth = (np.arange(layers) + 0.5) * plate.thickness / layers - plate.thickness / 2
    x = np.concatenate([plate.world(flat, y) for y in depth])
    volume = np.full(len(x), spacing**2 * plate.thickness / layers)
    return Particles(x=x, volume=volume, pinned=np.tile(plate.held(flat), layers), spacing=spacing)


def simulate(plate: Plate, wind: ForceFieldAnalytic, spacing: float | None = None) -> Motion:
    """Let the plate go, at rest, in the wind and in gravity."""
    particles, material = lay_particles(plate, spacing or plate.spacing), plate.stuff()
    model, _ = model_for(particles, material, wind.fps, gravity=GRAVITY)
    state = State.at_rest(particles.x)
    x, v, acceleration = [state.x], [state.v], []
    for t in range(wind.frames):
        a = wind.sample(state.x, t)[0] / material.density
        state = advance(model, state, a, wind.gradient(state.x, t) / material.density, frame=t)
        acceleration.append(a)
        x.append(state.x)
        v.append(state.v)
    flat, triangles = flat_mesh(plate.outlines, 0.6 * plate.spacing)
    surface = attach(plate.world(flat, -plate.thickness / 2), particles.x).follow(np.stack(x))
    return Motion(particles, wind, np.stack(x), np.stack(v), np.stack(acceleration), surface, triangles, flat)


def make_camera(plate: Plate, size: tuple[int, int]) -> Camera:
    """A level camera in front of the plate."""
    width, height = size
    pose = front_view(plate.distance)
    pose[0, 3], pose[2, 3] = plate.place[0] + plate.view_centre[0], plate.place[2] + plate.view_centre[1]
    pose[1, 3] += plate.place[1] - plate.thickness / 2
    focal = height / plate.view_height * plate.distance
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, pose)


def first_mask(camera: Camera, motion: Motion, chosen: np.ndarray | None = None) -> np.ndarray:
    """(H, W) uint8, 255 where the body is seen in picture 0; with `chosen` (M,) bool only where those triangles are."""
    pixels, _ = camera.project(motion.surface[0])
    mask = np.zeros((camera.height, camera.width), np.uint8)
    triangles = motion.triangles if chosen is None else motion.triangles[chosen]
    for triangle in np.round(pixels[triangles] * 16).astype(np.int32):  # fixed point with four bits behind the point
        cv2.fillConvexPoly(mask, triangle, 255, shift=4)
    return mask


def write(out: Path, plate: Plate, motion: Motion, camera: Camera, seed: int, samples: int) -> None:
    """All files but the clip."""
    mask = first_mask(camera, motion)
    held = first_mask(camera, motion, plate.held(motion.flat[motion.triangles].mean(1)))
    if not (held > 0).any():
        raise SeeingWindError("What is held is not in the picture.", "Choose a larger --size.")
    rows, columns = np.nonzero(mask)
    box = [int(columns.min()) - 2, int(rows.min()) - 2, int(columns.max()) + 2, int(rows.max()) + 2]
    values = {key: getattr(camera, key) for key in ("width", "height", "fx", "fy", "cx", "cy")}
    write_json(out / "camera.json", values | {"camera_to_world": camera.camera_to_world.tolist()})
    known = {"material": plate.material, "density": plate.density, "youngs_modulus": plate.youngs_modulus, "thickness": plate.thickness}
    write_json(out / "box.json", {"box": box, "distance": plate.distance, **known})
    pictures = {"mask_0000": mask, "held_0000": held, "texture": plate.picture[:, :, ::-1], "backdrop": make_backdrop(seed)[:, :, ::-1]}
    for name, picture in pictures.items():
        if not cv2.imwrite(str(out / f"{name}.png"), picture):
            raise SeeingWindError(f"Cannot write {out / name}.png.", "Choose another folder.")
    shape = {"vertices": motion.surface.astype(np.float32), "triangles": motion.triangles, "uv": motion.flat / plate.picture_side + 0.5}
    if plate.stand is not None:
        vertices, triangles, colour = plate.stand
        shape |= {"stand_vertices": vertices, "stand_triangles": triangles, "stand_colour": np.array(colour)}
    np.savez_compressed(out / "scene.npz", **shape, fps=motion.wind.fps, samples=samples)
    motion.wind.save(out / "known_wind.safetensors")
    material = plate.stuff()
    np.savez_compressed(
        out / "truth.npz",
        x=motion.x, v=motion.v, acc=motion.acceleration, rho=material.density, E=material.youngs_modulus, nu=material.poisson_ratio,
        yield_stress=0.0, fixed=motion.particles.pinned, fps=motion.wind.fps, gravity=np.array(GRAVITY),
        material="elastic", name=plate.name,
    )  # fmt: skip


def write_json(path: Path, values: dict) -> None:
    path.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
