"""Sheets of cloth that another engine moves in known winds: benchmarks/shell_scenes.py FOLDER [SCENE ...] [--picture]

Needs Newton 1.8 and SciPy (`pip install newton scipy`, in an environment of their own; a processor is enough) and nothing of this project.
Newton's cloth (`SolverVBD`: neo-Hookean triangles, hinges at the edges, implicit Euler) feels gravity and the air. The drag of each face is
computed here, from the law that docs/reference/wind.md states, and added as a force before every substep.

Writes FOLDER/SCENE.npz: what `recover-trajectories` reads of a shell (x (T+1,V,3) m, faces (F,3), areal_density kg/m², thickness m, E Pa,
nu, damping, fixed (V,), fps, gravity, name), and the truth: wind (T,V,3) m/s at the vertices and force (T,V,3) N of the air on them, both
as means over each frame. Every sheet begins flat, unstrained and at rest.

The scenes dev_... are for development, r_... for reports: nothing in the engine was chosen on these. A scene's name with `_heavy` is the
same sheet with twice the areal density in the same wind. `benchmarks/shell_checks.py` compares Newton's cloth with closed forms.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

AIR, NORMAL, TANGENTIAL = 1.2, 1.17, 0.05
"""Density of air [kg/m³] and the coefficients of the drag law."""
FPS, FRAMES = 30.0, 90
GRAVITY = (0.0, 0.0, -9.81)
NU = 0.3
DAMPED_AT = 2.0
"""Hz, where the loss factor holds."""

Vector = tuple[float, float, float]
Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices (V, 3) [m] and triangles (F, 3)."""


@dataclass(frozen=True)
class Wave:
    """amplitude * sin(wave . x - rate t + phase), in m/s."""

    amplitude: Vector
    wave: Vector
    """[rad/m]."""
    rate: float
    """[rad/s]."""
    phase: float = 0.0


@dataclass(frozen=True)
class Vortex:
    """A whirl with a smooth core about an axis that drifts: at the distance `radius` the air goes round at `speed`, its fastest."""

    speed: float
    radius: float
    start: Vector
    """A point of the axis at t = 0 [m]."""
    drift: Vector
    """[m/s]."""
    axis: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Wind:
    """u(x, t): a mean and what comes on top."""

    mean: Vector
    waves: tuple[Wave, ...] = ()
    vortices: tuple[Vortex, ...] = ()

    def at(self, x: np.ndarray, t: float) -> np.ndarray:
        """(M, 3) [m/s] at x (M, 3) [m] and t [s]."""
        u = np.tile(np.array(self.mean, float), (len(x), 1))
        for one in self.waves:
            u += np.sin(x @ np.array(one.wave, float) - one.rate * t + one.phase)[:, None] * np.array(one.amplitude, float)
        for one in self.vortices:
            offset = x - (np.array(one.start, float) + np.array(one.drift, float) * t)
            round_axis = np.cross(np.array(one.axis, float), offset)
            u += 2.0 * one.speed * one.radius * round_axis / (one.radius**2 + (round_axis**2).sum(axis=1, keepdims=True))
        return u


@dataclass(frozen=True)
class Scene:
    """A sheet and the air about it."""

    mesh: Callable[[], Mesh]
    held: Callable[[np.ndarray], np.ndarray]
    """Vertices (V, 3) at the start -> which are held (V,)."""
    wind: Wind
    areal_density: float
    """[kg/m²]."""
    tensile_stiffness: float
    """E times thickness [N/m]."""
    thickness: float
    """[m]: with the tensile stiffness it gives the bending stiffness, no more."""
    loss_factor: float = 0.1
    substeps: int = 64
    """In a frame."""
    iterations: int = 20
    """Of vertex block descent, in a substep."""


def sheet(width: float, height: float, edge: float, jitter: float = 0.0) -> Mesh:
    """A rectangle of nearly equilateral triangles in the plane y = 0, x from 0 to width and z from 0 to height [m].

    `jitter` is how far inner vertices are moved at random, over the edge length.
    """
    from scipy.spatial import Delaunay

    columns, rows = round(width / edge), round(height / (edge * np.sqrt(0.75)))
    points = []
    for row in range(rows + 1):
        x = np.linspace(0.0, width, columns + 1)
        if row % 2:
            x = np.concatenate([[0.0], 0.5 * (x[1:] + x[:-1]), [width]])
        points.append(np.stack([x, np.full(len(x), height * row / rows)], axis=1))
    flat = np.concatenate(points)
    inner = (flat > 1e-9).all(axis=1) & (flat < np.array([width, height]) - 1e-9).all(axis=1)
    flat = flat + jitter * edge * inner[:, None] * np.random.default_rng(7).uniform(-1.0, 1.0, flat.shape)
    return _upright(flat, Delaunay(flat).simplices)


def leaf(length: float, width: float, edge: float) -> Mesh:
    """A blade with a base that is a fifth as wide as the leaf and a pointed end, along x from 0 to length [m], in the plane y = 0."""
    from scipy.spatial import Delaunay

    along = np.linspace(0.0, 1.0, round(length / edge) + 1)
    points = []
    for number, s in enumerate(along):
        half = 0.5 * width * (0.2 * (1.0 - s) + 1.6 * s**0.7 * (1.0 - s) ** 0.8 / 0.98)
        across = max(1, round(2.0 * half / edge)) if s < 1.0 else 0
        z = np.linspace(-half, half, across + 1) if across else np.zeros(1)
        inner = 0.25 * edge * (-1.0) ** number * (np.abs(z) < half - 1e-9) * (across > 1)
        points.append(np.stack([np.full(len(z), s * length), z + inner], axis=1))
    flat = np.concatenate(points)
    triangles = Delaunay(flat).simplices
    centre = flat[triangles].mean(axis=1)
    s = np.clip(centre[:, 0] / length, 0.0, 1.0)
    half = 0.5 * width * (0.2 * (1.0 - s) + 1.6 * s**0.7 * (1.0 - s) ** 0.8 / 0.98)
    return _upright(flat, triangles[np.abs(centre[:, 1]) < half + 0.02 * edge])


def _upright(flat: np.ndarray, triangles: np.ndarray) -> Mesh:
    """Points (V, 2) as x and z; slivers go, and all triangles face -y."""
    a, b, c = (flat[triangles[:, corner]] for corner in range(3))
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles = np.where((twice > 0.0)[:, None], triangles, triangles[:, ::-1])[np.abs(twice) > 0.02 * np.median(np.abs(twice))]
    vertices = np.zeros((len(flat), 3))
    vertices[:, [0, 2]] = flat
    return vertices, triangles.astype(np.int32)


def turned(mesh: Mesh, vector: Vector) -> Mesh:
    """The mesh turned about the origin by a rotation vector [rad]."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).apply(mesh[0]), mesh[1]


def none(x: np.ndarray) -> np.ndarray:
    """Nothing is held."""
    return np.zeros(len(x), bool)


LIGHT = {
    "dev_flag": Scene(
        lambda: sheet(0.6, 0.4, 0.03), lambda x: x[:, 0] < 1e-6,
        Wind((4.0, 0.8, 0.2), (
            Wave((0.5, 1.2, 0.2), (3.0, 0.0, 1.0), 8.0, 0.4), Wave((0.3, 0.7, -0.3), (1.0, 2.0, 5.0), 13.0, 2.0),
            Wave((0.8, -0.5, 0.0), (0.5, 1.0, 0.0), 4.0, 1.0))),
        0.12, 2000.0, 4e-4),
    "dev_curtain": Scene(
        lambda: sheet(0.6, 0.8, 0.036), lambda x: x[:, 2] > 0.8 - 1e-6,
        Wind((0.3, 1.6, 0.0), (
            Wave((0.1, 1.3, 0.2), (4.0, 0.0, 2.0), 5.0, 0.3), Wave((0.3, 0.8, 0.1), (0.0, 0.0, 4.0), -7.0, 1.2),
            Wave((0.2, 0.9, 0.1), (0.0, 0.0, 0.0), 3.0, 0.0))),
        0.18, 2500.0, 5e-4),
    "dev_fall": Scene(
        lambda: turned(sheet(0.45, 0.3, 0.022), (1.2, 0.2, 0.3)), none,
        Wind((0.8, 0.5, 0.6), (
            Wave((0.6, 0.4, 0.5), (2.5, 0.0, 1.5), 5.0, 0.4), Wave((-0.3, 0.6, 0.4), (0.0, 3.0, -2.0), 8.0, 1.5))),
        0.1, 1500.0, 1.5e-3),
    "dev_leaf": Scene(
        lambda: turned(leaf(0.30, 0.16, 0.0115), (1.0, 0.0, 0.0)), lambda x: x[:, 0] < 0.02,
        Wind((0.6, 1.6, 1.2), (
            Wave((0.4, 0.9, 0.9), (3.0, 1.0, 0.0), 7.0, 0.2), Wave((0.5, -0.3, 0.8), (0.0, 5.0, 6.0), 10.0, 1.7))),
        0.3, 8000.0, 5e-3, substeps=128),
    "r_flag": Scene(
        lambda: sheet(0.9, 0.6, 0.034, 0.15), lambda x: x[:, 0] < 1e-6,
        Wind((5.0, -0.6, 0.3), (
            Wave((0.6, 1.6, 0.1), (2.0, 0.5, -1.5), 9.0, 1.4), Wave((0.2, 0.9, 0.4), (4.5, 0.0, 3.0), 17.0, 0.2),
            Wave((1.0, 0.6, 0.2), (0.3, 0.0, 0.3), 3.0, 2.2)), (Vortex(1.5, 0.3, (-2.0, 0.5, 0.3), (2.5, -0.2, 0.0)),)),
        0.16, 2400.0, 5e-4),
    "r_curtain": Scene(
        lambda: sheet(0.5, 1.0, 0.031), lambda x: x[:, 2] > 1.0 - 1e-6,
        Wind((-0.4, 1.2, 0.1), (
            Wave((0.3, 1.0, 0.2), (2.0, 1.0, 3.0), 4.0, 2.3), Wave((0.1, 1.1, -0.2), (-5.0, 0.0, 1.0), 6.0, 0.5)),
            (Vortex(1.2, 0.25, (-1.0, 0.2, 0.0), (0.9, 0.0, 0.0)),)),
        0.11, 1800.0, 4e-4),
    "r_fall": Scene(
        lambda: turned(sheet(0.32, 0.32, 0.019, 0.15), (0.9, -0.4, -0.2)), none,
        Wind((-0.5, 0.9, 0.9), (
            Wave((0.5, 0.5, 0.6), (1.5, 3.0, 0.0), 6.0, 1.1), Wave((0.7, -0.4, 0.3), (0.0, 1.0, 3.5), -4.0, 0.3)),
            (Vortex(1.0, 0.35, (0.6, -0.8, 0.0), (-0.4, 0.7, 0.0)),)),
        0.14, 2000.0, 2e-3),
    "r_leaf": Scene(
        lambda: turned(leaf(0.38, 0.15, 0.0125), (0.6, 0.0, 0.4)), lambda x: np.linalg.norm(x, axis=1) < 0.03,
        Wind((1.0, 1.2, 1.6), (
            Wave((0.5, 1.2, 0.6), (1.0, 4.0, 2.0), 9.0, 0.9), Wave((0.4, 0.6, 1.0), (0.5, 0.5, 0.5), 5.0, 2.6)),
            (Vortex(1.3, 0.25, (-1.0, -0.6, 0.2), (1.0, 0.6, 0.0)),)),
        0.24, 7000.0, 6e-3, substeps=128),
}  # fmt: skip
SCENES = LIGHT | {f"{name}_heavy": replace(scene, areal_density=2.0 * scene.areal_density) for name, scene in LIGHT.items()}


def drag(wind: np.ndarray, x: np.ndarray, v: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Force of the air (V, 3) [N] on a sheet at x (V, 3) [m] that moves at v (V, 3) [m/s], from the wind at its faces' centres (F, 3)."""
    a, b, c = x[faces[:, 0]], x[faces[:, 1]], x[faces[:, 2]]
    n = np.cross(b - a, c - a)
    doubled = np.linalg.norm(n, axis=1, keepdims=True)
    n = n / doubled
    w = wind - v[faces].mean(axis=1)
    across = (w * n).sum(axis=1, keepdims=True) * n
    f = 0.25 * AIR * doubled * np.linalg.norm(w, axis=1, keepdims=True) * (NORMAL * across + TANGENTIAL * (w - across))
    return np.stack([np.bincount(faces.ravel(), np.repeat(f[:, axis] / 3.0, 3), len(x)) for axis in range(3)], axis=1)


def cloth(scene: Scene, vertices: np.ndarray, faces: np.ndarray, held: np.ndarray, gravity: Vector = GRAVITY):
    """Newton's model of the sheet.

    A membrane with Young's modulus E, Poisson's ratio nu and thickness h has in plane stress, per width, the Lamé constants
    E h / (2 (1 + nu)) and E h nu / (1 - nu²). A hinge of stiffness k times its length L has the energy k L angle² / 2; on equilateral triangles
    of height H the hinges make a plate that bends to a cylinder in any direction as one of the rigidity D = k H does, and H is the area of
    the hinge's two triangles over L. So k = D L / area, with D = E h³ / (12 (1 - nu²)). Kelvin and Voigt's damping has the retardation time
    loss factor / (2 pi 2 Hz): times k at a hinge, times half of mu in a face, where Newton damps the rate of twice Green's strain.
    """
    import newton
    import warp

    builder = newton.ModelBuilder(gravity=gravity)
    mu = scene.tensile_stiffness / (2.0 * (1.0 + NU))
    lag = scene.loss_factor / (2.0 * np.pi * DAMPED_AT)
    builder.add_cloth_mesh(
        pos=warp.vec3(0.0, 0.0, 0.0), rot=warp.quat_identity(), scale=1.0, vel=warp.vec3(0.0, 0.0, 0.0),
        vertices=[warp.vec3(*map(float, vertex)) for vertex in vertices], indices=faces.ravel().tolist(), density=scene.areal_density,
        tri_ke=mu, tri_ka=scene.tensile_stiffness * NU / (1.0 - NU**2), tri_kd=0.5 * lag * mu, edge_ke=1.0, edge_kd=1.0,
    )  # fmt: skip
    for vertex in np.flatnonzero(held):
        builder.particle_mass[vertex] = 0.0
    builder.color(include_bending=True)
    model = builder.finalize(device="cpu")
    rigidity = scene.tensile_stiffness * scene.thickness**2 / (12.0 * (1.0 - NU**2))
    edges, lengths = model.edge_indices.numpy(), model.edge_rest_length.numpy()
    inner = (edges[:, :2] >= 0).all(axis=1)
    heights = [np.cross(vertices[edges[:, 3]] - vertices[edges[:, 2]], vertices[edges[:, side]] - vertices[edges[:, 2]]) for side in (0, 1)]
    area = 0.5 * sum(np.linalg.norm(height, axis=1) for height in heights)
    stiffness = np.where(inner, rigidity * lengths / np.where(inner, area, 1.0), 0.0)
    model.edge_bending_properties.assign(np.stack([stiffness, lag * stiffness], axis=1).astype(np.float32))
    return model


def simulate(scene: Scene, frames: int = FRAMES, gravity: Vector = GRAVITY) -> dict[str, np.ndarray]:
    """What a file holds."""
    import newton

    vertices, faces = scene.mesh()
    held = scene.held(vertices)
    model = cloth(scene, vertices, faces, held, gravity)
    solver = newton.solvers.SolverVBD(model, iterations=scene.iterations)
    state, after, control = model.state(), model.state(), model.control()
    dt = 1.0 / FPS / scene.substeps
    places, winds, forces = [vertices], [], []
    for frame in range(frames):
        wind, force = np.zeros((2, *vertices.shape))
        for substep in range(scene.substeps):
            t = frame / FPS + substep * dt
            x, v = state.particle_q.numpy().astype(float), state.particle_qd.numpy().astype(float)
            push = drag(scene.wind.at(x[faces].mean(axis=1), t), x, v, faces)
            state.particle_f.assign(push.astype(np.float32))
            solver.step(state, after, control, None, dt)
            state, after = after, state
            wind += scene.wind.at(x, t) / scene.substeps
            force += push / scene.substeps
        places.append(state.particle_q.numpy().astype(float))
        winds.append(wind)
        forces.append(force)
        if not np.isfinite(places[-1]).all():
            raise SystemExit(f"the cloth exploded in frame {frame}")
    return {
        "x": np.stack(places), "faces": faces, "areal_density": np.array(scene.areal_density), "thickness": np.array(scene.thickness),
        "E": np.array(scene.tensile_stiffness / scene.thickness), "nu": np.array(NU), "damping": np.array(scene.loss_factor),
        "fixed": held, "fps": np.array(FPS), "gravity": np.array(gravity), "wind": np.stack(winds), "force": np.stack(forces),
    }  # fmt: skip


def picture(found: dict[str, np.ndarray], path: Path) -> None:
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
    parser.add_argument("scenes", nargs="*", metavar="SCENE", default=list(SCENES), help=f"some of: {', '.join(SCENES)}")
    parser.add_argument("--picture", action="store_true", help="also FOLDER/SCENE.png (needs Matplotlib)")
    options = parser.parse_args()
    unknown = sorted(set(options.scenes) - set(SCENES))
    if unknown:
        parser.error(f"no scene {', '.join(unknown)}; there are {', '.join(SCENES)}")
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in options.scenes:
        found = simulate(SCENES[name])
        np.savez_compressed(options.folder / f"{name}.npz", name=name, **found)
        if options.picture:
            picture(found, options.folder / f"{name}.png")
        way = np.linalg.norm(np.diff(found["x"], axis=0), axis=2).sum(axis=0).mean()
        print(f"{name}: {len(found['fixed'])} vertices, {found['fixed'].sum()} held; way of a vertex {way:.2f} m", flush=True)


if __name__ == "__main__":
    main()
