"""Rigid plates blown by known winds, by an integrator of its own, and how well the wind is recovered from their motion.

    python benchmarks/accuracy/wind_truth.py [SCENE ...] [--work DIR]

The plates are rigid bodies of six degrees of freedom under the drag on their six sides, integrated by SciPy's Runge-Kutta: neither the
solver nor the drag law's code of the engine takes part. Each scene is handed to `recover-trajectories --field auto` as points in 3D.
Printed per scene: the error of the wind over the plate, of its size [%] and direction [degrees], beside the best wind that is the same
everywhere and always; what `auto` chose; and the transfer: the recovered field moves a plate of twice the areal density, whose true motion
is known, once as a wind and once as a force: how far its middle is off at the end, over the way that it went [%].
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from seeing_wind.engine.reading import read_arrays

AIR, NORMAL, TANGENTIAL = 1.2, 1.17, 0.05
"""Density of air [kg/m³] and the coefficients of the plates."""
SPACING, COUNTS = 0.008, (20, 15, 2)
"""Points of a plate: their distance [m], and how many along each side."""
TILES = 24
"""Number of tiles along each side, over which the drag is summed."""
YOUNGS_MODULUS = 2e5
"""Young's modulus [Pa] at which the plates hardly bend."""

Wind = Callable[[np.ndarray, float], np.ndarray]
"""Places (M, 3) [m] and time [s] -> velocity of the air (M, 3) [m/s]."""


@dataclass(frozen=True)
class Scene:
    """A plate in a wind."""

    wind: Wind
    areal_density: float = 0.5
    """kg/m²."""
    tilt: tuple[float, float, float] = (0.4, -0.5, 0.2)
    """Rotation vector of the plate at the start [rad]; at zero its normal is Z."""
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad/s."""
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    frames: int = 36
    fps: float = 30.0
    chosen_with: bool = field(default=False)
    """The settings of the recovery were chosen on this scene, so it is no evidence for them."""


def steady(*u: float) -> Wind:
    """A wind that is uniform and constant."""
    return lambda x, t: np.broadcast_to(np.array(u), x.shape)


def gusty(mean: tuple[float, float, float], gust: tuple[float, float, float], period: float) -> Wind:
    """A mean wind with gusts of two periods."""
    along = np.array(gust)
    return lambda x, t: np.broadcast_to(
        np.array(mean) + along * (np.sin(2 * np.pi * t / period) + 0.5 * np.sin(5.1 * np.pi * t / period + 1.0)), x.shape
    )


def sheared(mean: tuple[float, float, float], slope: float, period: float) -> Wind:
    """A wind that increases with height and varies in strength."""
    return lambda x, t: np.array(mean) * (1.0 + slope * x[:, 2:] + 0.3 * np.sin(2 * np.pi * t / period))


def vortex(mean: tuple[float, float, float], speed: float, radius: float) -> Wind:
    """A mean with a whirl about the vertical axis through (0.5, 0.2), as of a Rankine vortex with a smooth core."""

    def wind(x: np.ndarray, t: float) -> np.ndarray:
        offset = x - np.array([0.5, 0.2, 0.0])
        turned = np.stack([-offset[:, 1], offset[:, 0], np.zeros(len(x))], axis=1)
        return np.array(mean) + 2.0 * speed * radius * turned / (radius**2 + (turned**2).sum(axis=1, keepdims=True))

    return wind


SCENES = {
    "tuning": Scene(gusty((4.0, 1.0, 0.5), (1.0, -0.5, 0.4), 0.7), spin=(1.0, -2.0, 0.5), chosen_with=True),
    "steady": Scene(steady(5.0, 0.0, 1.0), tilt=(0.2, 1.2, 0.0), spin=(0.5, 1.5, -1.0)),
    "gusty": Scene(gusty((3.0, -2.0, 1.5), (1.2, 0.8, -0.8), 0.9), tilt=(-0.7, 0.6, 0.0), spin=(2.0, 2.5, 1.0)),
    "sheared": Scene(sheared((4.0, 1.5, 0.0), 1.5, 1.1), tilt=(0.3, 1.3, 0.3), spin=(-1.5, 2.0, 0.0)),
    "vortex": Scene(vortex((1.5, 0.0, 0.8), 3.0, 0.35), tilt=(0.8, 0.8, 0.0), spin=(0.0, 3.0, 1.0)),
    "falling": Scene(steady(3.0, 1.0, 2.0), areal_density=0.3, tilt=(0.3, 0.2, 0.0), gravity=(0.0, 0.0, -9.81), spin=(1.0, 1.0, 0.0)),
    "light": Scene(gusty((2.0, 1.0, 1.0), (0.8, -0.8, 0.5), 0.8), areal_density=0.12, tilt=(0.9, -0.4, 0.0), spin=(2.0, 0.5, 1.0)),
}


def rotation(vector: np.ndarray) -> np.ndarray:
    """(3, 3) of a rotation vector."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def sides() -> np.ndarray:
    """(3,) of a plate [m]."""
    return SPACING * np.array(COUNTS)


def drag(u: np.ndarray, v: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Force per area (M, 3) [Pa] of air at u (M, 3) on a side of a body at v (M, 3) with the outward unit normals (M, 3)."""
    w = u - v
    along = (w * normal).sum(axis=1, keepdims=True) * normal
    speed = np.linalg.norm(w, axis=1, keepdims=True)
    windward = (w * normal).sum(axis=1, keepdims=True) < 0.0
    return 0.5 * AIR * speed * (NORMAL * np.where(windward, along, 0.0) + 0.5 * TANGENTIAL * (w - along))


def tiles() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres (M, 3) [m] of the tiles of all six sides, their outward normals (M, 3) and areas (M,) [m²]."""
    size, centres, normals, areas = sides(), [], [], []
    for axis in range(3):
        others = [other for other in range(3) if other != axis]
        across = [max(2, round(TILES * size[other] / size.max())) for other in others]
        grid = np.meshgrid(*((np.arange(count) + 0.5) / count - 0.5 for count in across), indexing="ij")
        for sign in (-1.0, 1.0):
            centre = np.zeros((grid[0].size, 3))
            centre[:, others] = np.stack([g.ravel() for g in grid], axis=1) * size[others]
            centre[:, axis] = 0.5 * sign * size[axis]
            centres.append(centre)
            normals.append(np.broadcast_to(sign * np.eye(3)[axis], centre.shape))
            areas.append(np.full(len(centre), size[others].prod() / len(centre)))
    return np.concatenate(centres), np.concatenate(normals), np.concatenate(areas)


def moved(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """The plate's points (T+1, N, 3) [m] at every frame, and the wind at them (T, N, 3) [m/s] in the middle of every frame."""
    (length, width, height), (places, facing, area) = sides(), tiles()
    mass = scene.areal_density * length * width
    inertia = mass / 12.0 * np.array([width**2 + height**2, length**2 + height**2, length**2 + width**2])

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        place, R, v, spin = state[:3], state[3:12].reshape(3, 3), state[12:15], state[15:]
        offset = places @ R.T
        force = area[:, None] * drag(scene.wind(place + offset, t), v + np.cross(spin, offset), facing @ R.T)
        torque = R.T @ np.cross(offset, force).sum(axis=0)
        own = R.T @ spin
        turn = R @ ((torque - np.cross(own, inertia * own)) / inertia)
        return np.concatenate([v, np.cross(spin, R.T).T.ravel(), force.sum(axis=0) / mass + scene.gravity, turn])

    first = np.concatenate([np.zeros(3), rotation(np.array(scene.tilt)).ravel(), scene.velocity, scene.spin])
    times = np.arange(2 * scene.frames + 1) / (2.0 * scene.fps)
    states = solve_ivp(slope, (0.0, times[-1]), first, t_eval=times, rtol=1e-7, atol=1e-9).y.T
    axes = [SPACING * (np.arange(count) - 0.5 * (count - 1)) for count in COUNTS]
    rest = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    x = states[:, None, :3] + np.einsum("tij,nj->tni", states[:, 3:12].reshape(-1, 3, 3), rest)
    winds = np.stack([scene.wind(x[k], times[k]) for k in range(1, len(times), 2)])
    return x[::2], winds


def errors(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Mean error of vectors (..., 3) in size [%] and direction [degrees]."""
    size, wanted = np.linalg.norm(found, axis=-1), np.linalg.norm(true, axis=-1)
    cosine = (found * true).sum(axis=-1) / np.maximum(size * wanted, 1e-12)
    return 100.0 * float((np.abs(size - wanted) / wanted).mean()), float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean())


def engine(*arguments: str | Path) -> None:
    """Run a verb of the engine. Raises CalledProcessError where it fails."""
    subprocess.run([sys.executable, "-m", "seeing_wind.engine", *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def box_mesh(R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The plate as a closed mesh of small triangles, turned by R: vertices (V, 3) [m] and triangles (M, 3)."""
    size, vertices, triangles, count = sides(), [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        nu, nv = (max(1, round(size[other] / (2 * SPACING))) for other in (u, v))
        a, b = (g.ravel() for g in np.meshgrid(np.linspace(-0.5, 0.5, nu + 1), np.linspace(-0.5, 0.5, nv + 1), indexing="ij"))
        corner = (np.arange(nu)[:, None] * (nv + 1) + np.arange(nv)).ravel()
        for sign in (-1.0, 1.0):
            points = np.zeros((len(a), 3))
            points[:, u], points[:, v], points[:, axis] = a * size[u], b * size[v], 0.5 * sign * size[axis]
            quads = np.stack([corner, corner + nv + 1, corner + nv + 2, corner + 1], axis=1) + count
            faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
            vertices.append(points)
            triangles.append(faces if sign > 0.0 else faces[:, ::-1])
            count += len(points)
    merged, index = np.unique(np.round(np.concatenate(vertices), 9), axis=0, return_inverse=True)
    return merged @ R.T, index.ravel()[np.concatenate(triangles)]


def transfer(take: Path, scene: Scene, kind: str) -> float:
    """Error [%] of the final position of a plate of twice the areal density, moved by the take's field of this kind."""
    heavy = replace(scene, areal_density=2.0 * scene.areal_density, spin=(0.0, 0.0, 0.0))  # an inserted mesh does not spin
    R = rotation(np.array(scene.tilt))
    vertices, triangles = box_mesh(R)
    np.savez(take / "plate.npz", vertices=vertices, triangles=triangles)
    length, width, _ = sides()
    lines = [f'field = "{kind}"', f"gravity = {list(map(float, scene.gravity))}", "[[body]]", 'name = "plate"', 'mesh = "plate.npz"']
    lines += [f"mass = {heavy.areal_density * float(length * width)}", f"youngs_modulus = {YOUNGS_MODULUS}", "poisson_ratio = 0.3"]
    (take / "heavy.toml").write_text("\n".join(lines) + "\n")
    out = take.with_name(f"heavy_{kind}")
    engine("resimulate", take, "--edit", take / "heavy.toml", "--take", out)
    path = read_arrays(out / "bodies" / "plate.npz")["vertices"].mean(axis=1)
    true = moved(heavy)[0].mean(axis=1)
    return 100.0 * float(np.linalg.norm(path[-1] - true[-1]) / np.linalg.norm(true[-1] - true[0]))


def row(name: str, work: Path) -> str:
    """A line of the table."""
    scene, take = SCENES[name], work / name
    x, wind = moved(scene)
    take.mkdir(parents=True, exist_ok=True)
    density = scene.areal_density / (SPACING * COUNTS[2])
    np.savez(take / "truth.npz", x=x, fps=scene.fps, rho=density, E=YOUNGS_MODULUS, nu=0.3, gravity=np.array(scene.gravity))
    np.save(take / "points.npy", x[:-1])
    engine("recover-trajectories", take / "truth.npz", "--take", take / "take", "--field", "auto", "--report", "none")
    told = json.loads((take / "take" / "wind.json").read_text())
    if told["field"] == "force":
        engine("recover-trajectories", take / "truth.npz", "--take", take / "take", "--field", "wind", "--report", "none")
    engine("sample", take / "take", "--points", take / "points.npy", "--out", take / "sampled.npz")
    size, direction = errors(read_arrays(take / "sampled.npz")["wind_velocity"], wind)
    flat = errors(np.broadcast_to(wind.mean(axis=(0, 1)), wind.shape), wind)
    ends = [transfer(take / "take", scene, kind) for kind in ("wind", "force")]
    note = " (settings chosen with it)" if scene.chosen_with else ""
    figures = [f"{size:.1f} / {direction:.1f}", f"{flat[0]:.1f} / {flat[1]:.1f}", f"{told['field']} ({told['log_odds_of_wind']:.0f})"]
    return " | ".join([f"| {name}{note}", *figures, *(f"{end:.1f}" for end in ends)]) + " |"


def print_table(about: str | None, kind: str, known: Collection[str], head: str, row: Callable[[str, Path], str]) -> None:
    """The table, row by row: of all `known`, or of those that the command line names."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar=kind, help=", ".join(known))
    parser.add_argument("--work", type=Path, help="folder that keeps the takes; an interrupted run goes on from them")
    arguments = parser.parse_args()
    unknown = set(arguments.names) - set(known)
    if unknown:
        parser.error(f"there is no {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    print(head)
    print("|---" * (head.count("|") - 1) + "|")
    with tempfile.TemporaryDirectory() as aside:
        for name in arguments.names or known:
            print(row(name, arguments.work or Path(aside)), flush=True)


HEAD = "| scene | wind: size % / degrees | best uniform wind | auto (log odds) | twice the mass, by the wind % | by the force % |"

if __name__ == "__main__":
    print_table(__doc__, "SCENE", SCENES, HEAD, row)
