"""How much a moving camera costs: benchmarks/accuracy/orbit.py SHARED [--takes DIR]

The plate of SHARED/truth/sheet.npz (moved by another simulator) is painted twice from where its rendered clip was filmed: by a camera that
stands still, and by one that orbits the plate slowly. Both clips are recovered with their camera, mask and first depth. Prints the errors
of both; exit code 1 when the orbit's are more than 1.5 times those of the camera at rest.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from truth import engine, scores

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.paper_tables.painter import depth_of, over, paint  # noqa: E402
from benchmarks.paper_tables.shapes import Part, Solid, box  # noqa: E402
from seeing_wind.engine.observe.object.motion.control import attach  # noqa: E402
from seeing_wind.engine.records import Camera  # noqa: E402

FRAMES, DEGREES = 16, 20.0
"""Number of frames that are used, and the angle of the orbit in that time."""
WORSE = 1.5
CELL, SPACING = 0.003, 0.04 / 3
"""Cell size of the painted mesh and spacing of the true particles [m]."""


def orbit(camera: Camera, centre: np.ndarray, degrees: float) -> Camera:
    """The camera carried round a vertical axis through `centre` (3,), by `degrees` over the clip."""
    poses = []
    for turn in np.radians(np.linspace(0.0, degrees, FRAMES + 1)):
        c, s = np.cos(turn), np.sin(turn)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        pose = camera.pose(0).copy()
        pose[:3, :3], pose[:3, 3] = rotation @ pose[:3, :3], centre + rotation @ (pose[:3, 3] - centre)
        poses.append(pose)
    return Camera(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, np.stack(poses))


def surroundings(camera: Camera) -> np.ndarray:
    """(H, W, 3) float32 of a mottled sky dome, which is far away and stands still in the world."""
    rng = np.random.default_rng(2)
    dome = sum(cv2.GaussianBlur(rng.standard_normal((512, 2048)).astype(np.float32), (0, 0), blur) * blur for blur in (2.0, 6.0, 20.0))
    dome = 0.62 + 0.08 * dome / dome.std()
    rows, columns = np.mgrid[: camera.height, : camera.width].astype(float)
    ray = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)], axis=-1)
    ray = ray @ camera.pose(0)[:3, :3].T
    across = np.arctan2(ray[..., 1], ray[..., 0]) / (2.0 * np.pi) * 2048.0 % 2048.0
    up = (0.5 - np.arctan2(ray[..., 2], np.hypot(ray[..., 0], ray[..., 1])) / np.pi) * 511.0
    grey = cv2.remap(dome, across.astype(np.float32), up.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.clip(grey[..., None] * np.array([0.96, 1.0, 1.05], np.float32), 0.0, 1.0)


def film(truth: dict[str, np.ndarray], camera: Camera, folder: Path) -> None:
    """clip/, camera.json, mask.png and depth.npy of the plate as `camera` sees it."""
    x = truth["x"]
    low, high = x[0].min(axis=0) - 0.5 * SPACING, x[0].max(axis=0) + 0.5 * SPACING
    plate = Solid((Part(box(0.5 * (low + high), 0.5 * (high - low), 0.004), (0.75, 0.45, 0.3)),), tuple(low), tuple(high))
    rest, triangles, colours = plate.mesh(CELL)
    vertices = attach(rest, x[0]).follow(x)
    (folder / "clip").mkdir(parents=True, exist_ok=True)
    for t, shape in enumerate(vertices):
        now = Camera(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, camera.pose(t))
        image = over(*paint(shape, triangles, colours, now), surroundings(now))
        assert cv2.imwrite(str(folder / "clip" / f"{t:04d}.png"), image[..., ::-1])
    depth = depth_of(vertices[0], triangles, Camera(*(getattr(camera, key) for key in NUMBERS), camera.pose(0)))
    np.save(folder / "depth.npy", depth)
    assert cv2.imwrite(str(folder / "mask.png"), np.where(np.isfinite(depth), 255, 0).astype(np.uint8))
    values = {key: getattr(camera, key) for key in NUMBERS} | {"camera_to_world": np.asarray(camera.camera_to_world).tolist()}
    (folder / "camera.json").write_text(json.dumps(values))


NUMBERS = ("width", "height", "fx", "fy", "cx", "cy")


def main() -> int:
    """Both clips."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shared", type=Path, metavar="SHARED")
    parser.add_argument("--takes", type=Path, metavar="DIR")
    arguments = parser.parse_args()
    with np.load(arguments.shared / "truth/sheet.npz", allow_pickle=False) as data:
        truth = dict(data)
    truth["x"], truth["acc"] = truth["x"][: FRAMES + 1], truth["acc"][:FRAMES]
    known = json.loads((arguments.shared / "truth/rendered/sheet_v0/camera.json").read_text())
    pose = np.array(known["camera_to_world"])[0]
    rest = Camera(*(known[key] for key in NUMBERS), pose)
    errors = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.takes or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        np.savez(folder / "truth.npz", **truth)
        for name, camera in (("at rest", rest), ("orbit", orbit(rest, truth["x"][0].mean(axis=0), DEGREES))):
            filmed, take = folder / name.replace(" ", "_"), folder / f"{name.replace(' ', '_')}.take"
            film(truth, camera, filmed)
            engine(
                *("recover", filmed / "clip", "--fps", truth["fps"], "--take", take, "--camera", filmed / "camera.json"),
                *("--mask", filmed / "mask.png", "--depth", filmed / "depth.npy", "--no-gravity", "--density", truth["rho"]),
                *("--youngs-modulus", truth["E"], "--poisson-ratio", truth["nu"]),
            )
            print(f"{name:8} {scores(folder / 'truth.npz', take)}", flush=True)
            errors[name] = scores.last  # type: ignore[attr-defined]
    ratio = max(np.array(errors["orbit"]) / np.array(errors["at rest"]))
    print(f"The orbit's errors are up to {ratio:.2f} times those at rest; the bar is {WORSE}.")
    return 1 if ratio > WORSE else 0


if __name__ == "__main__":
    sys.exit(main())
