"""What building any sample clip shares: the options, a level camera, the mask of frame 0, and the files of the folder."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from in_blender import BlenderFailed, command, run

from seeing_wind.engine.conventions import GRAVITY, front_view
from seeing_wind.engine.errors import SeeingWindError
from seeing_wind.engine.field.force_field import ForceField
from seeing_wind.engine.materials import Material
from seeing_wind.engine.records import Camera

MEADOW, RENDER = (Path(__file__).with_name(name) for name in ("meadow.py", "render.py"))


@dataclass(frozen=True)
class Filmed:
    """A simulated body and how it is filmed: everything that goes into the folder."""

    name: str
    x: np.ndarray
    """(T+1, N, 3) its points [m]."""
    wind: ForceField
    """What moved it."""
    known: dict[str, str | float]
    """What a user of the clip is told of the body, by the names of `recover`'s options."""
    truth: dict[str, Any]
    """What else truth.npz holds, for the report alone."""
    surface: np.ndarray
    """(T+1, V, 3) the side that faces the camera [m]."""
    triangles: np.ndarray
    uv: np.ndarray
    """(V, 2) in `texture`, origin bottom left."""
    texture: np.ndarray
    """(S, S, 3) uint8 sRGB, row 0 at the top."""
    camera: Camera
    distance: float
    """From the camera in frame 0 [m]."""
    held: np.ndarray | None = None
    """(M,) bool, the triangles that never move."""
    more: dict[str, np.ndarray] = field(default_factory=dict)
    """Further arrays for render.py."""


def known_of_solid(material: Material, thickness: float) -> dict[str, str | float]:
    """`Filmed.known` of a solid body so thick [m]."""
    numbers = {"density": material.density, "youngs_modulus": material.youngs_modulus}
    return {"material": material.name, **numbers, "thickness": thickness}


def truth_of_solid(material: Material, pinned: np.ndarray, v: np.ndarray, acceleration: np.ndarray) -> dict[str, Any]:
    """`Filmed.truth` of a solid body.

    Args:
        pinned: (N,) bool; v: (T+1, N, 3) [m/s]; acceleration: (T, N, 3) by the wind, f / rho at x[t] [m/s²].
    """
    numbers = {"rho": material.density, "E": material.youngs_modulus, "nu": material.poisson_ratio, "yield_stress": 0.0}
    return {"v": v, "acc": acceleration, "fixed": pinned, "material": "elastic", **numbers}


def options(about: str, argv: list[str] | None, *, seed: int, frames: int, fps: float, size: str, samples: int, spacing: float):
    """The options, checked; the defaults are the scene's."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, metavar="DIR")
    parser.add_argument("--seed", type=int, default=seed)
    parser.add_argument("--frames", type=int, default=frames, metavar="T", help="frame intervals: the clip has one frame more")
    parser.add_argument("--fps", type=float, default=fps)
    parser.add_argument("--size", default=size, metavar="WxH")
    parser.add_argument("--spacing", type=float, default=spacing, metavar="M", help="of its points [m]")
    parser.add_argument("--samples", type=int, default=samples, help="of Cycles, per pixel")
    parser.add_argument("--blender", metavar="PATH", help="instead of BLENDER=, the one on the PATH, or the bpy wheel")
    parser.add_argument("--no-render", action="store_true", help="all but backdrop.png and clip.mp4")
    chosen = parser.parse_args(argv)
    try:
        chosen.size = tuple(int(part) for part in chosen.size.lower().split("x"))
    except ValueError:
        parser.error(f"--size {chosen.size} is not of the form {size}")
    if len(chosen.size) != 2 or min(chosen.size) < 64 or any(side % 2 for side in chosen.size):
        parser.error("--size needs two even numbers of at least 64")
    if chosen.seed < 0 or chosen.frames < 3 or chosen.fps <= 0 or chosen.samples < 1:
        parser.error("--seed must not be negative, --frames at least 3, --fps and --samples above zero")
    if not 0.002 <= chosen.spacing <= 0.05:
        parser.error("--spacing must be between 0.002 and 0.05")
    return chosen


def build(chosen: argparse.Namespace, film: Callable[[], Filmed], summary: Callable[[Filmed], str]) -> int:
    """Simulate, write, render, and print `summary`; returns the exit code."""
    out = Path(chosen.out)
    out.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    try:
        if not chosen.no_render:
            command(RENDER, [], chosen.blender)  # a Blender that is missing is told before the work
        filmed = film()
        write(out, filmed, chosen.samples)
        simulated = time.perf_counter()
        if not chosen.no_render:
            run(MEADOW, [str(out.resolve()), str(chosen.seed), str(filmed.distance)], chosen.blender)
            run(RENDER, [str(out.resolve())], chosen.blender)
    except (SeeingWindError, BlenderFailed) as error:
        print(error, file=sys.stderr)
        return 1
    camera = filmed.camera
    print(
        f"{len(filmed.x)} frames at {camera.width}x{camera.height}, {filmed.x.shape[1]} points.\n{summary(filmed)}\n"
        f"Simulated in {simulated - started:.0f} s, rendered in {time.perf_counter() - simulated:.0f} s: {out}"
    )
    return 0


def level_camera(size: tuple[int, int], distance: float, view_height: float, centre: tuple[float, float], depth: float) -> Camera:
    """A level camera that looks at `centre` (world x, z); what lies at world y `depth` is `distance` away, in a view that high [m]."""
    width, height = size
    pose = front_view(distance)
    pose[0, 3], pose[2, 3] = centre
    pose[1, 3] += depth
    focal = height / view_height * distance
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, pose)


def first_mask(filmed: Filmed, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
    """(H, W) uint8, 255 where the `chosen` triangles are seen in frame 0."""
    pixels, _ = filmed.camera.project(filmed.surface[0])
    mask = np.zeros((filmed.camera.height, filmed.camera.width), np.uint8)
    for triangle in np.round(pixels[filmed.triangles[chosen]] * 16).astype(np.int32):  # fixed point with four bits behind the point
        cv2.fillConvexPoly(mask, triangle, 255, shift=4)
    return mask


def write(out: Path, filmed: Filmed, samples: int) -> None:
    """All files but the clip and what stands behind it.

    Raises:
        SeeingWindError: what is held is not in the frame, or a file cannot be written.
    """
    camera, mask = filmed.camera, first_mask(filmed)
    images = {"mask_0000": mask, "texture": filmed.texture[:, :, ::-1]}
    if filmed.held is not None:
        images["held_0000"] = first_mask(filmed, filmed.held)
        if not images["held_0000"].any():
            raise SeeingWindError("What is held is not in the frame.", "Choose a larger --size.")
    rows, columns = np.nonzero(mask)
    box = [int(columns.min()) - 2, int(rows.min()) - 2, int(columns.max()) + 2, int(rows.max()) + 2]
    values = {key: getattr(camera, key) for key in ("width", "height", "fx", "fy", "cx", "cy")}
    write_json(out / "camera.json", values | {"camera_to_world": camera.camera_to_world.tolist()})
    write_json(out / "box.json", {"box": box, "distance": filmed.distance, **filmed.known})
    for name, image in images.items():
        if not cv2.imwrite(str(out / f"{name}.png"), image):
            raise SeeingWindError(f"Cannot write {out / name}.png.", "Choose another folder.")
    shape = {"vertices": filmed.surface.astype(np.float32), "triangles": filmed.triangles, "uv": filmed.uv}
    np.savez_compressed(out / "scene.npz", **shape, **filmed.more, fps=filmed.wind.fps, samples=samples)
    filmed.wind.save(out / "known_wind.safetensors")
    common = {"fps": filmed.wind.fps, "gravity": np.array(GRAVITY), "name": filmed.name}
    np.savez_compressed(out / "truth.npz", x=filmed.x, **common, **filmed.truth)


def write_json(path: Path, values: dict) -> None:
    """With a newline at its end."""
    path.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
