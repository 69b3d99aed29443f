"""Newton's cloth in the wind: the sheets and winds that benchmarks/scenes/shell_scenes.py and benchmarks/scenes/shell_checks.py simulate.

`SolverSemiImplicit`: neo-Hookean triangles, hinges at the edges, explicit substeps of about 50 µs; with half of them vertices were
elsewhere by 0.02 mm on average after 8 frames. Newton's implicit `SolverVBD` was tried: with 20 iterations a substep the middle of a free
sheet was off by 1 % of its way, and it took several times as long.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

AIR, NORMAL, TANGENTIAL = 1.2, 1.17, 0.05
"""Density of air [kg/m³] and the coefficients of the drag law that docs/reference/wind.md states."""
FPS, LOOKS = 30.0, 64
"""Frames per second, and times per frame at which the air is sampled."""
GRAVITY = (0.0, 0.0, -9.81)
NU = 0.3
DAMPED_AT = 2.0
"""Frequency [Hz] at which the loss factor holds."""

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
    """A vortex with a smooth core about a drifting axis; the air rotates fastest, at `speed`, at the distance `radius` from the axis."""

    speed: float
    radius: float
    start: Vector
    """A point of the axis at t = 0 [m]."""
    drift: Vector
    """[m/s]."""
    axis: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Wind:
    """u(x, t): a mean wind with waves and vortices added."""

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
    """A sheet and the wind around it."""

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
    """At most: Newton's step is explicit, and less where it would become unstable."""


def lattice(length: float, width: float, edge: float, half_width: Callable[[np.ndarray], np.ndarray] | None = None) -> Mesh:
    """Equilateral triangles, all alike, in the plane y = 0: x from 0, where the border is straight, to `length`, z from 0 to `width` [m].

    `half_width`, of x over the length, keeps the triangles that are no farther from the middle line [m].
    """
    lines, rows = round(length / (edge * np.sqrt(0.75))), round(width / edge)
    points = [(line * np.sqrt(0.75) * edge, (row + 0.5 * (line % 2)) * edge) for line in range(lines + 1) for row in range(rows + 1)]
    flat, triangles = np.array(points), []
    for line in range(lines):
        here, there = line * (rows + 1), (line + 1) * (rows + 1)
        for row in range(rows):
            near, far = (here, there) if line % 2 == 0 else (there, here)
            triangles += [(near + row, near + row + 1, far + row), (far + row, near + row + 1, far + row + 1)]
    corners = np.array(triangles)
    if half_width is not None:
        centre = flat[corners].mean(axis=1)
        corners = corners[np.abs(centre[:, 1] - 0.5 * width) < half_width(np.clip(centre[:, 0] / length, 0.0, 1.0))]
    used, faces = np.unique(corners, return_inverse=True)
    flat, faces = flat[used], faces.reshape(-1, 3)
    a, b, c = (flat[faces[:, corner]] for corner in range(3))
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    vertices = np.zeros((len(flat), 3))
    vertices[:, [0, 2]] = flat
    return vertices, np.where((twice > 0.0)[:, None], faces, faces[:, ::-1]).astype(np.int32)


def hanging(length: float, width: float, edge: float) -> Mesh:
    """A rectangle that hangs down from z = 0."""
    return turned(lattice(length, width, edge), (0.0, 0.5 * np.pi, 0.0))


def leaf(length: float, width: float, edge: float) -> Mesh:
    """A blade along x, from a base of a third of its width at x = 0 to a point."""
    vertices, faces = lattice(length, width, edge, lambda s: 0.5 * width * (0.33 * (1.0 - s) + 1.3 * np.sqrt(s) * (1.0 - s)) / 0.7)
    return vertices - np.array([0.0, 0.0, 0.5 * width]), faces


def turned(mesh: Mesh, vector: Vector) -> Mesh:
    """The mesh turned about the origin by a rotation vector [rad]."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).apply(mesh[0]), mesh[1]


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


def rigidity(scene: Scene) -> float:
    """D [N m]."""
    return scene.tensile_stiffness * scene.thickness**2 / (12.0 * (1.0 - NU**2))


def steps(scene: Scene, edge: float) -> tuple[int, float]:
    """Substeps in a frame, for triangles of this edge length [m], and the retardation time of bending [s].

    The lattice's fastest vibration is about 2.45 c / edge for a membrane with the speed of sound c: twice as many substeps as an
    undamped one would need, since the dashpots are explicit, too. By Gershgorin's circles no bending
    is faster than the root of 48 D / (areal density height⁴).
    """
    sound = np.sqrt(scene.tensile_stiffness / scene.areal_density)
    count = int(np.ceil(sound / (FPS * 0.22 * edge)))
    bending = 48.0 * rigidity(scene) / (scene.areal_density * (np.sqrt(0.75) * edge) ** 4)
    return count, float(min(scene.loss_factor / (2.0 * np.pi * DAMPED_AT), 0.5 * FPS * count / bending))


def cloth(scene: Scene, vertices: np.ndarray, faces: np.ndarray, held: np.ndarray, gravity: Vector = GRAVITY):
    """Newton's model of the sheet.

    Newton's energy of a face, mu / 2 (tr F'F - 2) + k / 2 (J - 1 - mu / k)², is to second order that of Lamé's constants mu and k - mu.
    A membrane with Young's modulus E, Poisson's ratio nu and thickness h has E h / (2 (1 + nu)) and E h nu / (1 - nu²), per width. Its
    damping of a face would brake rotations; instead every edge has a dashpot, against the ringing of the lattice.

    Newton's moment at a hinge is edge_ke times the edge's length times the angle, and its lever arms lack the division by twice a face's
    area: with triangles that are all alike this is the energy k L angle² / 2 with k = 2 area edge_ke. Hinges on equilateral triangles of
    height H make a plate that bends to a cylinder in any direction as one of the rigidity k H = D = E h³ / (12 (1 - nu²)) does (and has a
    Poisson's ratio of -1/3, which a sheet that keeps its lengths never shows). A clamp begins half a height behind the last held line, as
    the hinge there stands for the curvature on both sides.
    """
    import newton
    import warp

    warp.config.quiet = True
    edge = float(np.linalg.norm(vertices[faces[0, 1]] - vertices[faces[0, 0]]))
    count, lag = steps(scene, edge)
    height = np.sqrt(0.75) * edge
    hinge = rigidity(scene) / (height * edge * height)
    mu = scene.tensile_stiffness / (2.0 * (1.0 + NU))
    builder = newton.ModelBuilder(gravity=gravity)
    builder.add_cloth_mesh(
        pos=warp.vec3(0.0, 0.0, 0.0), rot=warp.quat_identity(), scale=1.0, vel=warp.vec3(0.0, 0.0, 0.0),
        vertices=[warp.vec3(*map(float, vertex)) for vertex in vertices], indices=faces.ravel().tolist(), density=scene.areal_density,
        tri_ke=mu, tri_ka=scene.tensile_stiffness * NU / (1.0 - NU**2) + mu, tri_kd=0.0,
        edge_ke=hinge, edge_kd=lag * hinge / (edge * height),
        add_springs=True, spring_ke=0.0, spring_kd=0.5 / (FPS * count) * mu * 4.0 / np.sqrt(3.0),
    )  # fmt: skip
    for vertex in np.flatnonzero(held):
        builder.particle_mass[vertex] = 0.0
    model = builder.finalize(device="cpu")
    model.particle_grid = None  # no contact between particles
    return model, count, lag


def simulate(scene: Scene, frames: int, gravity: Vector = GRAVITY, finer: int = 1) -> dict[str, np.ndarray]:
    """The arrays of a scene's file, simulated with `finer` times the substeps. Raises SystemExit if the cloth explodes."""
    import newton

    vertices, faces = scene.mesh()
    held = scene.held(vertices)
    model, count, lag = cloth(scene, vertices, faces, held, gravity)
    count *= finer
    solver = newton.solvers.SolverSemiImplicit(model, enable_tri_contact=False)
    state, after, control = model.state(), model.state(), model.control()
    every = max(1, count // LOOKS)
    places, winds, forces = [vertices], [], []
    for frame in range(frames):
        seen = []
        for substep in range(count):
            if substep % every == 0:
                t = (frame + substep / count) / FPS
                x, v = state.particle_q.numpy().astype(float), state.particle_qd.numpy().astype(float)
                force = drag(scene.wind.at(x[faces].mean(axis=1), t), x, v, faces)
                push = force.astype(np.float32)
                seen.append((min(every, count - substep), scene.wind.at(x, t), force))
            state.particle_f.assign(push)
            solver.step(state, after, control, None, 1.0 / FPS / count)
            state, after = after, state
        places.append(state.particle_q.numpy().astype(float))
        winds.append(sum(weight * wind for weight, wind, _ in seen) / count)
        forces.append(sum(weight * force for weight, _, force in seen) / count)
        if not (np.abs(places[-1]) < 100.0).all():
            raise SystemExit(f"the cloth exploded in frame {frame}")
    return {
        "x": np.stack(places), "faces": faces, "areal_density": np.array(scene.areal_density), "thickness": np.array(scene.thickness),
        "E": np.array(scene.tensile_stiffness / scene.thickness), "nu": np.array(NU), "damping": np.array(2.0 * np.pi * DAMPED_AT * lag),
        "fixed": held, "fps": np.array(FPS), "gravity": np.array(gravity), "wind": np.stack(winds), "force": np.stack(forces),
    }  # fmt: skip
