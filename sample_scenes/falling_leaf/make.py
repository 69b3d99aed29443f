"""Builds the sample clip from nothing: a leaf in a known wind, simulated with the engine's solver and rendered with Blender.

    python sample_scenes/falling_leaf/make.py --out DIR [--seed N] [--frames 45] [--size 640x360] [--samples N] [--blender PATH]

What a user of the clip would have: clip.mp4, camera.json, mask_0000.png, box.json (box round the leaf, distance, what it is made of).
For the report only: known_wind.safetensors (the field) and truth.npz (particles and forces), which the recovery never reads.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

HERE = Path(__file__).resolve().parent
# a script of the source tree: it runs with the package installed or not
sys.path[:0] = [str(HERE), str(HERE.parent / "common"), str(HERE.parents[1])]

from backdrop import make_backdrop  # noqa: E402
from in_blender import BlenderFailed, run  # noqa: E402
from leaf import Leaf, make_leaf, make_picture  # noqa: E402
from motion import DENSITY, MATERIAL, START, THICKNESS, YOUNGS_MODULUS, Flight, fly, tilt  # noqa: E402

from seeing_wind.engine.conventions import GRAVITY, front_view  # noqa: E402
from seeing_wind.engine.errors import SeeingWindError  # noqa: E402
from seeing_wind.engine.records import Camera  # noqa: E402
from seeing_wind.engine.report.accuracy import uniform_errors  # noqa: E402

DISTANCE = 2.0
"""From the camera to the leaf in picture 0 [m]."""
VIEW_HEIGHT = 0.98
"""What the picture shows at that distance, top to bottom [m]."""
VIEW_CENTRE = (0.24, -0.25)
"""Where the camera looks, right of and above the leaf's first place [m]."""
MOST_TILT = 60.0
"""Degrees from the camera at which a leaf can no longer be followed."""


def main(argv: list[str] | None = None) -> int:
    """Build everything into --out; returns the exit code."""
    options = parse(argv)
    out = Path(options.out)
    out.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    try:
        flight, camera, leaf = simulate(options.seed, options.frames, options.fps, options.size)
        write_scene(out, leaf, flight, camera, options.seed, options.samples)
        simulated = time.perf_counter()
        if not options.no_render:
            run(HERE.parent / "common" / "render.py", [str(out.resolve())], options.blender, follow="\0")
    except (SeeingWindError, BlenderFailed) as error:
        print(error, file=sys.stderr)
        return 1
    fall = flight.x[-1].mean(0) - flight.x[0].mean(0)
    magnitude, direction = uniform_errors(flight.acceleration)
    print(
        f"{len(flight.x)} pictures at {camera.width}x{camera.height}, {len(flight.particles.x)} particles.\n"
        f"The leaf sinks {-fall[2]:.2f} m, drifts {fall[0]:.2f} m and tilts up to {tilt(flight).max():.0f} degrees.\n"
        f"A uniform field with the right net force in every frame would be off by {magnitude:.0f} % and {direction:.0f} degrees.\n"
        f"Simulated in {simulated - started:.0f} s, rendered in {time.perf_counter() - simulated:.0f} s: {out}"
    )
    return 0


def parse(argv: list[str] | None) -> argparse.Namespace:
    """The options, checked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, metavar="DIR")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--frames", type=int, default=45, metavar="T", help="frame intervals: the clip has one picture more")
    parser.add_argument("--fps", type=float, default=30.0)
    parser.add_argument("--size", default="640x360", metavar="WxH")
    parser.add_argument("--samples", type=int, default=12, help="of Cycles, per pixel")
    parser.add_argument("--blender", metavar="PATH", help="instead of BLENDER=, the one on the PATH, or the bpy wheel")
    parser.add_argument("--no-render", action="store_true", help="all but clip.mp4")
    options = parser.parse_args(argv)
    try:
        options.size = tuple(int(part) for part in options.size.lower().split("x"))
    except ValueError:
        parser.error(f"--size {options.size} is not of the form 640x360")
    if len(options.size) != 2 or min(options.size) < 64 or any(side % 2 for side in options.size):
        parser.error("--size needs two even numbers of at least 64")
    if options.seed < 0 or options.frames < 3 or options.fps <= 0 or options.samples < 1:
        parser.error("--seed must not be negative, --frames at least 3, --fps and --samples above zero")
    return options


def simulate(seed: int, frames: int, fps: float, size: tuple[int, int], spacing: float = 0.006) -> tuple[Flight, Camera, Leaf]:
    """The leaf's flight in the wind of `seed`, the camera and the leaf.

    Raises:
        SeeingWindError: when the flight leaves the picture or turns edge-on; another seed helps.
    """
    leaf = make_leaf(seed)
    flight, camera = fly(leaf, seed, fps, frames, spacing), make_camera(size)
    pixels, _ = camera.project(flight.surface)
    if pixels.min() < 2 or (pixels.max((0, 1)) > np.array(size) - 3).any():
        raise SeeingWindError("The leaf leaves the picture.", "Choose another --seed or fewer --frames.")
    if tilt(flight).max() > MOST_TILT:
        raise SeeingWindError("The leaf turns its edge to the camera.", "Choose another --seed or fewer --frames.")
    return flight, camera, leaf


def make_camera(size: tuple[int, int]) -> Camera:
    """A level camera in front of the leaf."""
    width, height = size
    pose = front_view(DISTANCE)
    pose[0, 3], pose[2, 3] = START[0] + VIEW_CENTRE[0], START[2] + VIEW_CENTRE[1]
    pose[1, 3] -= THICKNESS / 2
    focal = height / VIEW_HEIGHT * DISTANCE
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, pose)


def first_mask(camera: Camera, flight: Flight, leaf: Leaf) -> np.ndarray:
    """(H, W) uint8, 255 where the leaf is seen in picture 0."""
    pixels, _ = camera.project(flight.surface[0])
    mask = np.zeros((camera.height, camera.width), np.uint8)
    fine = 16  # cv2 takes fixed-point corners with four bits behind the point
    for triangle in np.round(pixels[leaf.triangles] * fine).astype(np.int32):
        cv2.fillConvexPoly(mask, triangle, 255, shift=4)
    return mask


def write_scene(out: Path, leaf: Leaf, flight: Flight, camera: Camera, seed: int, samples: int) -> None:
    """All files but the clip."""
    mask = first_mask(camera, flight, leaf)
    rows, columns = np.nonzero(mask)
    box = [int(columns.min()) - 2, int(rows.min()) - 2, int(columns.max()) + 2, int(rows.max()) + 2]
    values = {key: getattr(camera, key) for key in ("width", "height", "fx", "fy", "cx", "cy")}
    write_json(out / "camera.json", values | {"camera_to_world": camera.camera_to_world.tolist()})
    known = {"material": MATERIAL, "density": DENSITY, "youngs_modulus": YOUNGS_MODULUS, "thickness": THICKNESS}
    write_json(out / "box.json", {"box": box, "distance": DISTANCE, **known})
    for name, picture in (("mask_0000", mask), ("texture", make_picture(seed)[:, :, ::-1]), ("backdrop", make_backdrop(seed)[:, :, ::-1])):
        if not cv2.imwrite(str(out / f"{name}.png"), picture):
            raise SeeingWindError(f"Cannot write {out / name}.png.", "Choose another folder.")
    shape = {"vertices": flight.surface.astype(np.float32), "triangles": leaf.triangles, "uv": leaf.uv}
    np.savez_compressed(out / "scene.npz", **shape, fps=flight.wind.fps, samples=samples)
    flight.wind.save(out / "known_wind.safetensors")
    material = flight.material
    np.savez_compressed(
        out / "truth.npz",
        x=flight.x, v=flight.v, acc=flight.acceleration, rho=material.density, E=material.youngs_modulus, nu=material.poisson_ratio,
        yield_stress=0.0, fixed=np.zeros(len(flight.particles.x), dtype=bool), fps=flight.wind.fps, gravity=np.array(GRAVITY),
        material="elastic", name="falling_leaf",
    )  # fmt: skip


def write_json(path: Path, values: dict) -> None:
    path.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
