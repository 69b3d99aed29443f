"""The camera of a clip, from a file or a level pinhole in front of the object; and the object's distance from it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ... import conventions
from ...conventions import front_view, in_units
from ...errors import UsageError
from ...progress import Progress
from ...reading import read_json
from ...records import Camera
from ...settings import ObserveSettings
from .transforms import LENS, from_transforms, is_transforms, matrices_in, number_in

DEFAULT_DISTANCE = 2.0
"""Distance [m] assumed if no scale is known: someone films a thing within reach. Forces scale with it, and the user is warned."""

NEAREST, FARTHEST = 0.01, 1e6
"""Bounds of an object's distance [m]: beyond them, a unit or a sign is wrong."""

ROTATION_TOLERANCE = 1e-3
"""Largest deviation of R^T R from the identity: exporters write six digits or fewer."""

SHORTEST, LONGEST = 0.05, 1000.0
"""Bounds of a focal length in frame widths: 169 degrees of view, and 0.06."""
STRETCHED = 4.0
"""Largest ratio of fx to fy, or of fy to fx: no pixels are more oblong."""
OFF_CENTRE = 1.0
"""Distance outside the frame at which the principal point of a cropped frame may lie, in units of the frame's size."""
BENT = 0.5
"""Largest distance, in frame diagonals, by which a lens moves a point of the frame."""

KEYS = ("width", "height", "fx", "fy", "cx", "cy", "camera_to_world")


def resized(camera: Camera, height: int, width: int) -> Camera:
    """`camera` for frames resized to `height` and `width` [px]; pixel centres are at integers in both."""
    across, down = width / camera.width, height / camera.height
    cx, cy = (camera.cx + 0.5) * across - 0.5, (camera.cy + 0.5) * down - 0.5
    return replace(camera, width=width, height=height, fx=camera.fx * across, fy=camera.fy * down, cx=cx, cy=cy)


def find_camera(
    settings: ObserveSettings, width: int, height: int, frames: int, first_frame: int, depth: float | None, progress: Progress
) -> tuple[Camera, float]:
    """The camera of a clip of `frames` frames (width x height, from `first_frame` of its file) and the object's distance [m].

    `depth` [m] is the object's from a depth map, None without one; a distance or scale in the settings takes precedence.

    Without a camera file, the camera is a pinhole with the horizontal angle `settings.fov` in front view, and the object's plane is y = 0,
    so that the middle of the frame is the world's origin.

    Raises:
        UsageError: a camera file that cannot be used; a distance or scale that is not positive; an angle out of range; or a distance and a
            scale that contradict each other.
    """
    given = settings.distance is not None or settings.pixels_per_metre is not None
    if depth is not None:
        _check_distance(depth, "The depth file")
    if settings.camera is not None:
        camera = read_camera(settings.camera, width, height, frames, first_frame)
        if given:
            return camera, _distance(settings, camera.fx)
        return camera, depth if depth is not None else _distance_of_origin(camera, progress)
    if not 1.0 <= settings.fov <= 170.0:
        raise UsageError(
            f"The field of view {settings.fov:g} degrees is out of range.",
            "Give the horizontal angle, 1 to 170 degrees; a phone has about 50 to 65.",
        )
    focal = 0.5 * width / np.tan(0.5 * np.radians(settings.fov))
    distance = _distance(settings, focal) if given else depth or DEFAULT_DISTANCE
    if not given and depth is None:
        progress.warn(
            f"Nothing says how large the scene is, so the object is taken to be {in_units(DEFAULT_DISTANCE, 'm')} away: "
            "forces scale with this distance. Give --distance or --pixels-per-metre for absolute values.",
            judged=True,
        )
    return Camera(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1), front_view(distance)), distance


def read_camera(path: str, width: int, height: int, frames: int, first_frame: int = 0) -> Camera:
    """The camera of a file: JSON with width, height, fx, fy, cx, cy [px] and camera_to_world (4x4, or one per frame); or `transforms.json`.

    k1, k2, p1, p2, k3 describe the lens (OpenCV's model; zero where they are missing); other keys are ignored.

    Raises:
        UsageError: unreadable, keys missing, another frame size than the clip's, values that are not finite numbers, or a matrix that is
            not a rigid motion.
    """
    values = _read_json(path)
    if is_transforms(values):
        values = from_transforms(path, values, width, height)
    missing = [key for key in KEYS if key not in values]
    if missing:
        raise UsageError(f"The camera {path} lacks {', '.join(missing)}.", "See docs/reference/formats.md for what belongs in it.")
    numbers = {key: number_in(path, key, values[key]) for key in (*KEYS[:6], *LENS) if key in values}
    if (numbers["width"], numbers["height"]) != (width, height):
        raise UsageError(
            f"The camera {path} is for {values['width']}x{values['height']} frames, the clip has {width}x{height}.",
            "Scale fx, fy, cx, cy and the size with the frame, or use the camera of this clip.",
        )
    fx, fy, cx, cy = (numbers[key] for key in KEYS[2:6])
    lens = tuple(numbers.get(key, 0.0) for key in LENS)
    poses = matrices_in(path, "camera_to_world", values["camera_to_world"])
    _check_pinhole(path, width, height, fx, fy, cx, cy)
    camera = Camera(width, height, fx, fy, cx, cy, _poses(path, poses, frames, first_frame))
    return replace(camera, distortion=_distortion(path, lens, camera))


def _check_pinhole(path: str, width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> None:
    """Raise UsageError for a focal length or a centre that no camera with this frame can have."""
    for name, focal in (("fx", fx), ("fy", fy)):
        if not SHORTEST * width <= focal <= LONGEST * width:
            raise UsageError(
                f"The camera {path} has {name} = {focal:g} for a frame {width} pixels wide.", "Give the focal length in pixels."
            )
    if not 1.0 / STRETCHED <= fx / fy <= STRETCHED:
        raise UsageError(f"The camera {path} has fx = {fx:g} and fy = {fy:g}: no camera has pixels that oblong.", "Give both in pixels.")
    for name, centre, size in (("cx", cx, width), ("cy", cy, height)):
        if not -OFF_CENTRE * size <= centre <= (1.0 + OFF_CENTRE) * size:
            raise UsageError(
                f"The camera {path} has {name} = {centre:g}, far outside a frame of {size} pixels.",
                "It is where the view's axis meets the frame, in pixels from its upper left corner: about half its size.",
            )


def _distortion(path: str, lens: tuple[float, ...], camera: Camera) -> tuple[float, ...]:
    """The lens's five numbers, checked to map the frame one to one; () if they are all zero."""
    if not any(lens):
        return ()
    k1, k2, p1, p2, k3 = lens
    focal, diagonal = camera.fx, float(np.hypot(camera.width, camera.height))
    rim = np.stack(np.meshgrid(np.linspace(0, camera.width - 1, 9), np.linspace(0, camera.height - 1, 9)), axis=-1).reshape(-1, 2)
    x, y = ((rim - [camera.cx, camera.cy]) / [camera.fx, camera.fy]).T
    r2 = x**2 + y**2
    radial = k1 * r2 + k2 * r2**2 + k3 * r2**3
    way = np.hypot(x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y).max() * focal
    if not way <= BENT * diagonal:
        raise UsageError(
            f"The lens of {path} moves a point of the frame by {way:.3g} of {diagonal:.0f} pixels.",
            "Calibrate it again; k1, k2, p1, p2 and k3 are OpenCV's, for lengths in focal lengths.",
        )
    # The radial map folds back on itself where d(r (1 + k1 r² + k2 r⁴ + k3 r⁶))/dr is no longer positive.
    r2 = np.linspace(0.0, (0.5 * diagonal / focal) ** 2, 200)
    if (1 + 3 * k1 * r2 + 5 * k2 * r2**2 + 7 * k3 * r2**3 <= 0.0).any():
        raise UsageError(f"The lens of {path} (k1 {k1:g}, k2 {k2:g}, k3 {k3:g}) folds the frame over.", "Calibrate it again.")
    return lens


def _read_json(path: str) -> dict[str, Any]:
    try:
        values = read_json(path)
    except OSError as error:
        raise UsageError(f"The camera file {path} cannot be read ({error.strerror or error}).", "Check the path.") from error
    except ValueError as error:
        raise UsageError(f"The camera file {path} is not JSON ({error}).", f"It needs an object with {', '.join(KEYS)}.") from error
    if not isinstance(values, dict):
        raise UsageError(f"The camera file {path} is not a JSON object.", f"It needs an object with {', '.join(KEYS)}.")
    return values


def _poses(path: str, poses: np.ndarray, frames: int, first_frame: int) -> np.ndarray:
    """The checked camera_to_world: (4, 4) if the camera stands still, else (T+1, 4, 4)."""
    if poses.shape[-2:] != (4, 4) or poses.ndim not in (2, 3):
        raise UsageError(f"camera_to_world of {path} has the shape {poses.shape}.", "Give one 4x4 matrix, or one per frame.")
    if poses.ndim == 3 and len(poses) != frames:
        # The file may describe the whole clip, of which a range was chosen.
        if len(poses) < first_frame + frames:
            raise UsageError(
                f"{path} has {len(poses)} camera matrices, the clip {frames} frames.", "Give one matrix, or one per frame."
            )
        poses = poses[first_frame : first_frame + frames]
    if np.abs(poses[..., :3, 3]).max() > conventions.FARTHEST:
        message = f"camera_to_world of {path} is more than {in_units(conventions.FARTHEST, 'm')} from the origin."
        raise UsageError(message, "Give metres, near the scene's origin.")
    rotation = poses[..., :3, :3]
    off = np.abs(np.swapaxes(rotation, -1, -2) @ rotation - np.eye(3)).max()
    if off > ROTATION_TOLERANCE or (np.linalg.det(rotation) < 0).any() or np.abs(poses[..., 3, :] - [0, 0, 0, 1]).max() > 1e-6:
        raise UsageError(
            f"camera_to_world of {path} is not a rotation and a translation: {_flaw(poses, float(off))}.",
            "Remove scale and mirroring; OpenCV axes are x right, y down, z forward.",
        )
    if poses.ndim == 3 and np.abs(poses - poses[0]).max() < 1e-9:
        return poses[0]
    return poses


def _flaw(poses: np.ndarray, off: float) -> str:
    """Why matrices (..., 4, 4), whose rotations deviate by `off` from orthonormal ones, cannot be a camera's."""
    if np.abs(poses[..., 3, :] - [0, 0, 0, 1]).max() > 1e-6:
        return "its last row is not 0 0 0 1"
    return f"its rotation is off by {off:.2g}" if off > ROTATION_TOLERANCE else "it mirrors"


def _distance(settings: ObserveSettings, focal: float) -> float:
    """The object's distance [m] from --distance, or from the image scale: distance = fx / (pixels per metre)."""
    distance, scale = settings.distance, settings.pixels_per_metre
    for name, value in (("distance", distance), ("pixels-per-metre", scale)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise UsageError(
                f"--{name} {value:g} is not positive.", "Give metres from the camera to the object, or pixels per metre in its plane."
            )
    if distance is None:
        assert scale is not None
        return _check_distance(focal / scale, "The scale")
    if scale is not None and abs(focal / scale - distance) > 0.01 * distance:
        raise UsageError(
            f"--distance {in_units(distance, 'm')} and --pixels-per-metre {scale:g} contradict each other: that scale means "
            f"{in_units(focal / scale, 'm')}.",
            "Give one of them.",
        )
    return _check_distance(float(distance), "--distance")


def _check_distance(distance: float, what: str) -> float:
    if not NEAREST <= distance <= FARTHEST:
        said = f"{what} puts the object {in_units(distance, 'm')} from the camera."
        raise UsageError(said, "Check the unit: metres, or pixels per metre.")
    return distance


def _distance_of_origin(camera: Camera, progress: Progress) -> float:
    """Depth of the world's origin in frame 0 [m] if it is in front of the camera, else the default distance."""
    depth = float(camera.project(np.zeros(3))[1])
    distance = depth if depth > 1e-3 else DEFAULT_DISTANCE
    taken = f"which is taken as {in_units(distance, 'm')}"
    progress.warn(f"The camera is known but not the object's depth, {taken}. Give --depth or --distance.", judged=True)
    return distance
