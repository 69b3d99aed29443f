"""One scene of the tables: an object moved by a known field, filmed from two sides.

The truth is simulated with particles 1.4 to 1.7 times finer than those of the recovery (so are grid and substeps), on a
lattice that is shifted, so the recovery never meets its own discretisation; the solver is the same. `benchmarks/accuracy/truth.py` scores
against another simulator.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import advance
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.observe.object.motion.control import attach
from seeing_wind.engine.records import Camera, Particles

from .fields import FIELDS, gradient
from .objects import Thing
from .painter import backdrop, depth_of, look_at, over, paint

FPS, FRAMES = 30.0, 20
WIDTH, HEIGHT = 480, 400
DISTANCE, FOCAL = 2.0, 900.0
VIEWS = ((-18.0, 12.0), (47.0, 16.0))
"""Azimuth and elevation of the cameras [degrees]; at azimuth 0 a camera looks along +Y."""
MESH_CELL = 0.0075
SUBSTEPS = 500
"""Limit of the truth's substeps, high enough that no material is softened."""
COARSER = 1.7


@dataclass(frozen=True)
class Scene:
    """What happened."""

    thing: Thing
    x: np.ndarray
    """(T+1, N, 3) true particles [m]."""
    force: np.ndarray
    """(T, N, 3) true force density at x[t] [N/m³]."""
    held: np.ndarray
    """(N,) bool."""
    vertices: np.ndarray
    """(T+1, V, 3) of the surface [m]."""
    triangles: np.ndarray
    colours: np.ndarray
    """(V, 3) in 0..1."""
    rest: np.ndarray
    """(V, 3) surface at rest [m]."""
    cameras: tuple[Camera, ...]


def simulate(thing: Thing, frames: int = FRAMES) -> Scene:
    """Let the thing's field blow on it; `frames` intervals."""
    x = thing.solid.fill(thing.spacing)
    held = np.zeros(len(x), bool) if thing.held is None else thing.held(x)
    particles = Particles(x, np.full(len(x), thing.spacing**3), held, thing.spacing)
    model, _ = model_for(particles, thing.material, FPS, gravity=(0.0, 0.0, 0.0), max_substeps=SUBSTEPS)
    field, state, places, forces = FIELDS[thing.field], State.at_rest(x), [x], []
    for t in range(frames):
        acceleration = field(state.x, t / FPS)
        forces.append(thing.material.density * acceleration)
        state = advance(model, state, acceleration, gradient(field, state.x, t / FPS), frame=t)
        places.append(state.x)
    path = np.stack(places)
    rest, triangles, colours = thing.solid.mesh(MESH_CELL)
    vertices = attach(rest, x).follow(path)
    centre = 0.5 * (path[0].mean(axis=0) + path[-1].mean(axis=0))
    return Scene(thing, path, np.stack(forces), held, vertices, triangles, colours, rest, tuple(_camera(centre, *view) for view in VIEWS))


def _camera(target: np.ndarray, azimuth: float, height: float) -> Camera:
    a, h = np.radians(azimuth), np.radians(height)
    eye = target + DISTANCE * np.array([np.sin(a) * np.cos(h), -np.cos(a) * np.cos(h), np.sin(h)])
    return Camera(WIDTH, HEIGHT, FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, look_at(eye, target))


def render_frames(scene: Scene, view: int, vertices: np.ndarray | None = None) -> np.ndarray:
    """(T+1, H, W, 3) uint8 of the surface, or of other vertices (T+1, V, 3) of it."""
    camera, path = scene.cameras[view], scene.vertices if vertices is None else vertices
    behind = backdrop(camera)
    return np.stack([over(*paint(shape, scene.triangles, scene.colours, camera), behind) for shape in path])


def film(scene: Scene, folder: Path) -> None:
    """Write `view0`, `view1` (frames, camera.json, mask.png, depth.npy, pin.png) as a user would have them, and nothing of the truth."""
    for view, camera in enumerate(scene.cameras):
        into = folder / f"view{view}"
        (into / "clip").mkdir(parents=True, exist_ok=True)
        for t, frame in enumerate(render_frames(scene, view)):
            _write(into / "clip" / f"{t:04d}.png", frame[..., ::-1])
        depth = depth_of(scene.vertices[0], scene.triangles, camera)
        np.save(into / "depth.npy", depth)
        _write(into / "mask.png", np.where(np.isfinite(depth), 255, 0).astype(np.uint8))
        values = {key: getattr(camera, key) for key in ("width", "height", "fx", "fy", "cx", "cy")}
        (into / "camera.json").write_text(json.dumps(values | {"camera_to_world": camera.camera_to_world.tolist()}))
        if scene.held.any():
            _write(into / "pin.png", _held_pixels(scene, depth, camera))


def trajectories(scene: Scene, path: Path, own: bool = False) -> None:
    """Write what `recover-trajectories` reads: coarser particles that ride on the true ones, or these (`own`)."""
    if own:
        np.savez(path, x=scene.x, fps=FPS, fixed=scene.held, gravity=np.zeros(3))
        return
    rest = scene.thing.solid.fill(COARSER * scene.thing.spacing, shift=0.3)
    held = np.zeros(len(rest), bool) if scene.thing.held is None else scene.thing.held(rest)
    x = attach(rest, scene.x[0]).follow(scene.x)
    np.savez(path, x=x, fps=FPS, fixed=held, gravity=np.zeros(3))


def material_options(thing: Thing) -> list[str]:
    """The material as options of the command line."""
    m = thing.material
    options = ["--law", m.law, "--density", m.density, "--youngs-modulus", m.youngs_modulus, "--poisson-ratio", m.poisson_ratio]
    options += ["--yield-stress", m.yield_stress] if m.yield_stress else []
    options += ["--viscosity", m.viscosity] if m.viscosity else []
    return [str(option) for option in options]


def _write(path: Path, image: np.ndarray) -> None:
    if not cv2.imwrite(str(path), image):
        raise OSError(f"Cannot write {path}.")


def _held_pixels(scene: Scene, depth: np.ndarray, camera: Camera) -> np.ndarray:
    rows, columns = np.nonzero(np.isfinite(depth))
    points = camera.unproject(np.stack([columns, rows], axis=1), depth[rows, columns], 0)
    assert scene.thing.held is not None
    out = np.zeros(depth.shape, np.uint8)
    out[rows, columns] = np.where(scene.thing.held(points), 255, 0)
    return out


def recovered_vertices(scene: Scene, x: np.ndarray) -> np.ndarray:
    """The surface carried by recovered particles x (T+1, N, 3) [m]."""
    return attach(scene.rest, x[0]).follow(x)
