"""Further bodies that another simulator moves by known fields: benchmarks/scenes/genesis_scenes.py FOLDER [NAME ...]

Needs Genesis 1.4 (`pip install torch genesis-world`, in an environment of its own) and nothing of this project. Writes
FOLDER/truth/NAME.npz: x (T+1,N,3) m and v (T+1,N,3) m/s of the particles, acc (T,N,3) m/s² the field on them, mean over each frame, what
`recover-trajectories` reads of a body (rho, E, nu, yield_stress, fixed, gravity, fps). `benchmarks/accuracy/truth.py FOLDER NAME
"NAME 0.5 mm"` scores the recovery on them. Nothing in the engine was tuned on sheet2, banner2, ball2, clay2 and clay3; on the held
bodies it was decided that the stiffness is found from points, too.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

# Genesis stops the grid nodes of held particles while others may still add to them. On one thread the particles go from the lowest to the
# highest: bodies are held at the top, so that a held node stays at rest.
os.environ["QD_NUM_THREADS"] = "1"

FPS, SUBSTEPS, LOOKS = 30.0, 100, 10
"""Frames per second; substeps per frame; and times per frame at which the field is sampled."""
CENTRE = np.array([0.0, 0.0, 0.5])
"""Centre of every body [m]."""

Vector = tuple[float, float, float]
REST: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Wave:
    """amplitude * sin(wave . (x - CENTRE) + rate t + phase), in m/s²."""

    amplitude: Vector
    wave: Vector
    """[rad/m]."""
    rate: float
    """[rad/s]."""
    phase: float


@dataclass(frozen=True)
class Scene:
    """A body and what moves it."""

    shape: tuple
    """("box", sides), ("ball", radius) or ("cylinder", radius, height) [m]."""
    E: float
    rho: float
    waves: tuple[Wave, ...]
    yield_stress: float = 0.0
    """Largest norm of the deviatoric Kirchhoff stress [Pa]; 0 is elastic."""
    held_above: float | None = None
    """Height [m]."""
    velocity: Vector = REST
    spin: Vector = REST
    """[rad/s]."""
    squeeze: tuple[Vector, Vector, Vector] = (REST, REST, REST)
    """[1/s²], times x - CENTRE and sin(3 t + 0.8)."""
    frames: int = 24
    blows: int | None = None
    """Frames after which the air is still; None: never."""
    calm_clamp: bool = False
    """Nothing acts above `held_above`. Genesis lets a force move a held particle for one substep, so a clamp in a field creeps."""


def long(shape: tuple, E: float, rho: float, seed: int, wave: float = 5.0, spin: Vector = REST) -> Scene:
    """Three seconds in a uniform gust and two waves, which are drawn; the body sets out so that they do not carry it out of the grid."""
    rng, waves = np.random.default_rng(seed), []
    for gust in range(3):
        towards, k = 1.2 * rng.normal(size=3), wave * rng.normal(size=3) * bool(gust)
        rate, phase = rng.uniform(3.5, 8.0) * rng.choice([-1, 1]), rng.uniform(0.0, 6.28)
        waves.append(Wave(tuple(map(float, towards)), tuple(map(float, k)), float(rate), float(phase)))
    drift = sum(np.array(one.amplitude) * np.cos(one.phase) / one.rate for one in waves)
    return Scene(shape, E, rho, tuple(waves), velocity=tuple(map(float, -drift)), spin=spin, frames=90)


SCENES = {
    "sheet2": Scene(("box", (0.2, 0.2, 0.03)), 5e4, 250.0, (
        Wave((1.2, 1.8, 0.4), REST, 6.0, 0.4), Wave((0.8, 1.0, 0.7), (6, 0, 3), 4.0, 1.0), Wave((0.3, 0.9, -0.6), (2, 0, -7), 8.0, 2.2))),
    "banner2": Scene(("box", (0.24, 0.20, 0.03)), 3e4, 180.0, (
        Wave((1.5, 2.0, 1.0), (18, 0, 4), 5.0, 0.3), Wave((0.5, -1.5, 2.0), (3, 0, 22), -7.0, 1.1),
        Wave((-1.0, 0.8, 0.6), (10, 5, -10), 9.0, 2.0), Wave((0.6, 1.2, 0.3), REST, 6.0, 0.5)),
        velocity=(-0.4, 0.5, 0.2), spin=(0.0, 2.0, 1.0)),
    "ball2": Scene(("ball", 0.08), 2e4, 300.0, (Wave((1.5, 1.0, 0.8), REST, 5.0, 0.3), Wave((1.0, 0.6, 1.2), (8, 4, 5), 6.0, 1.0)),
        velocity=(0.5, -0.2, 0.6), spin=(3.0, 0.0, 2.0)),
    "clay2": Scene(("ball", 0.09), 5e3, 700.0, (Wave((1.2, 0.4, 0.8), REST, 5.0, 0.6),), yield_stress=60.0, frames=16,
        squeeze=((-14, 5, 0), (5, 9, 3), (0, 3, 4))),
    "clay3": Scene(("box", (0.16, 0.14, 0.12)), 8e3, 600.0, (
        Wave((1.5, 1.0, 0.6), (9, 0, 3), 5.0, 0.3), Wave((0.5, 1.0, 1.5), (2, 8, 6), -4.0, 1.0)),
        yield_stress=50.0, frames=16, velocity=(0.3, 0.0, 0.2)),
    "pole2": Scene(("box", (0.08, 0.05, 0.36)), 1.2e5, 400.0, (
        Wave((0.9, 0.5, 0), REST, 4.5, 0.4), Wave((0.4, 0.9, 0.1), (0, 0, 6), 6.0, 1.0), Wave((0.2, 0.3, 0.05), (4, 0, 10), 3.0, 2.0)),
        held_above=0.58),
    "pole3": Scene(("box", (0.05, 0.07, 0.42)), 2.5e5, 450.0, (
        Wave((0.9, 1.4, 0.1), REST, 6.0, 0.2), Wave((0.5, 0.4, 0.1), (0.8, 0.3, 1.2), 9.0, 1.0),
        Wave((-0.4, 0.6, 0), (0.2, 0.5, 0.9), 3.0, 2.0)), held_above=0.6),
    "cane": Scene(("cylinder", 0.03, 0.44), 4e5, 600.0, (Wave((1.6, 0.5, 0), REST, 7.0, 0.2), Wave((0.4, 1.4, 0.1), (0, 0, 5), 5.0, 1.5)),
        held_above=0.64),
    "flag2": Scene(("box", (0.16, 0.03, 0.24)), 3e4, 220.0, (
        Wave((0.3, 1.5, 0.1), REST, 5.0, 0.4), Wave((0.2, 1.2, 0.1), (12, 0, 5), -6.0, 1.0)), held_above=0.57),
    "flag3": Scene(("box", (0.2, 0.03, 0.3)), 6e4, 250.0, (
        Wave((0.5, 1.4, 0.1), REST, 5.0, 0.3), Wave((0.3, 1.1, 0.1), (3, 0.5, 1.5), 8.0, 1.0)), held_above=0.58),
    "sheet3s": long(("box", (0.2, 0.2, 0.03)), 5e4, 250.0, 11),
    "banner3s": long(("box", (0.24, 0.2, 0.03)), 3e4, 180.0, 13, wave=9.0, spin=(0.0, 1.0, 0.5)),  # at the grid's edge from frame 84 on
    "ball3s": long(("ball", 0.08), 2e4, 300.0, 22, spin=(0.0, 1.0, 0.7)),
    "block3s": long(("box", (0.14, 0.1, 0.08)), 3e4, 300.0, 23, wave=7.0, spin=(0.3, 0.0, 0.5)),
}  # fmt: skip


def main() -> None:
    """Simulate the scenes named, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("name", nargs="*", metavar="NAME", default=list(SCENES), help=f"some of: {', '.join(SCENES)}")
    options = parser.parse_args()
    unknown = sorted(set(options.name) - set(SCENES))
    if unknown:
        parser.error(f"no scene {', '.join(unknown)}; there are {', '.join(SCENES)}")
    write(options.folder, {name: SCENES[name] for name in options.name})


def write(folder: Path, scenes: dict[str, Scene]) -> None:
    """Simulate `scenes` and write each to FOLDER/truth/NAME.npz."""
    import genesis

    genesis.init(backend=genesis.cpu, logging_level="warning")
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    for name, scene in scenes.items():
        found = simulate(scene)
        np.savez_compressed(folder / "truth" / f"{name}.npz", name=name, **found)
        moved = np.linalg.norm(found["x"] - found["x"][0], axis=2).max()
        print(f"{name}: {len(found['fixed'])} particles, {found['fixed'].sum()} held, moved by up to {moved:.3f} m", flush=True)


def acceleration(scene: Scene, x: np.ndarray, t: float) -> np.ndarray:
    """The field (N, 3) [m/s²] at x (N, 3) [m] and t [s]."""
    if scene.blows is not None and t >= scene.blows / FPS:
        return np.zeros_like(x)
    away = x - CENTRE
    total = np.sin(3.0 * t + 0.8) * away @ np.array(scene.squeeze, float).T
    for one in scene.waves:
        total = total + np.sin(away @ np.array(one.wave, float) + one.rate * t + one.phase)[:, None] * np.array(one.amplitude)
    if scene.calm_clamp and scene.held_above is not None:
        total[x[:, 2] > scene.held_above] = 0.0
    return total


def simulate(scene: Scene) -> dict[str, np.ndarray]:
    """The arrays of a scene's file."""
    import genesis
    import torch

    stage = genesis.Scene(
        sim_options=genesis.options.SimOptions(dt=1.0 / FPS / SUBSTEPS, substeps=1, gravity=REST),
        mpm_options=genesis.options.MPMOptions(
            grid_density=48, lower_bound=(-1.0, -1.0, -0.5), upper_bound=(1.0, 1.0, 1.5), particle_size=0.01333
        ),
        show_viewer=False,
    )
    body = stage.add_entity(material=_material(scene), morph=_morph(scene))
    field = genesis.force_fields.Custom(_compiled(scene))
    stage.add_force_field(field)
    stage.build()
    field.activate()
    x = _array(body.get_particles_pos())
    held = np.zeros(len(x), bool) if scene.held_above is None else x[:, 2] > scene.held_above
    if held.any():
        body.set_free(torch.tensor(~held))
    v = np.array(scene.velocity) + np.cross(np.array(scene.spin), x - x.mean(axis=0))
    if v.any():
        body.set_particles_vel(torch.tensor(v, dtype=torch.float32))
    places, velocities, forces = [x], [v], []
    for frame in range(scene.frames):
        seen = []
        for step in range(SUBSTEPS):
            if step % (SUBSTEPS // LOOKS) == SUBSTEPS // LOOKS // 2:
                seen.append(acceleration(scene, _array(body.get_particles_pos()), (frame + step / SUBSTEPS) / FPS))
            stage.step()
        forces.append(np.mean(seen, axis=0))
        places.append(_array(body.get_particles_pos()))
        velocities.append(_array(body.get_particles_vel()))
    path = np.stack(places)
    return {
        "x": path.astype(np.float32), "v": np.stack(velocities).astype(np.float32), "acc": np.stack(forces).astype(np.float32),
        "rho": np.array(scene.rho), "E": np.array(scene.E), "nu": np.array(0.3), "yield_stress": np.array(scene.yield_stress),
        "fixed": held, "fps": np.array(FPS), "gravity": np.zeros(3),
    }  # fmt: skip


def _material(scene: Scene):
    import genesis

    common = {"E": scene.E, "nu": 0.3, "rho": scene.rho}
    if not scene.yield_stress:
        return genesis.materials.MPM.Elastic(**common)
    return genesis.materials.MPM.ElastoPlastic(**common, use_von_mises=True, von_mises_yield_stress=scene.yield_stress)


def _morph(scene: Scene):
    import genesis

    kind, *sizes = scene.shape
    if kind == "box":
        return genesis.morphs.Box(pos=tuple(CENTRE), size=sizes[0])
    if kind == "ball":
        return genesis.morphs.Sphere(pos=tuple(CENTRE), radius=sizes[0])
    return genesis.morphs.Cylinder(pos=tuple(CENTRE), radius=sizes[0], height=sizes[1])


def _compiled(scene: Scene):
    """`acceleration` in the simulator's own language."""
    import genesis
    import quadrants

    waves = [(one.amplitude, one.wave, one.rate, one.phase) for one in scene.waves]
    squeeze, centre = [list(map(float, row)) for row in scene.squeeze], CENTRE.tolist()
    ends = 1e9 if scene.blows is None else scene.blows / FPS
    top = scene.held_above if scene.calm_clamp and scene.held_above is not None else 1e9

    @quadrants.func
    def field(pos, vel, t, i):
        away = pos - quadrants.Vector([centre[0], centre[1], centre[2]], dt=genesis.qd_float)
        total = quadrants.Vector([0.0, 0.0, 0.0], dt=genesis.qd_float)
        for j in quadrants.static(range(len(waves))):
            angle = waves[j][2] * t + waves[j][3]
            for k in quadrants.static(range(3)):
                angle += away[k] * waves[j][1][k]
            for k in quadrants.static(range(3)):
                total[k] += waves[j][0][k] * quadrants.sin(angle)
        swing = quadrants.sin(3.0 * t + 0.8)
        for j in quadrants.static(range(3)):
            for k in quadrants.static(range(3)):
                total[j] += swing * squeeze[j][k] * away[k]
        if t >= ends or pos[2] > top:
            total = quadrants.Vector([0.0, 0.0, 0.0], dt=genesis.qd_float)
        return total

    return field


def _array(values) -> np.ndarray:
    return np.asarray(values.cpu(), float).reshape(-1, 3)


if __name__ == "__main__":
    main()
