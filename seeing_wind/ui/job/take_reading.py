"""Reading and checking a take's files: nothing in the scene is changed, and only sensible numbers are returned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...engine.errors import TakeError, clause
from ...engine.masks import Masks
from ...engine.record_arrays import from_arrays
from ...engine.take import Take

if TYPE_CHECKING:
    from ...engine.records import Camera, Surface


@dataclass(frozen=True)
class FieldSummary:
    """The properties of a recovered field that the scene needs."""

    box: np.ndarray
    """(2, 3) lower and upper corner [m]."""
    fps: float
    frames: int
    """T, the number of intervals."""
    density: float
    """Density of the recovered material [kg/m³]."""
    clip: str
    """Path of the video; "" for a field from trajectories."""
    first_frame: int
    """Index in the video of frame 0."""


def recovery_notes(take: Take) -> list[str]:
    """The recovery's own notes on its quality, the worst first; empty for a take without a report."""
    if not take.file("report.json").is_file():
        return []
    notes = take.read_json("report.json").get("notes", [])
    return [str(note) for note in notes] if isinstance(notes, list) else []


@dataclass(frozen=True)
class WindTold:
    """The result of the stage *wind* for a take."""

    is_wind: bool
    """Whether the field is interpreted as a wind; otherwise as a force only."""
    notes: tuple[str, ...]
    """What was chosen, and why."""
    mean: float
    """Speed of the mean wind [m/s]."""
    gust: float
    """Speed of the strongest gust [m/s]."""
    drag: float
    """Half the density of air times the coefficient of a plate across the wind [kg/m³]: pressure over the square of the speed."""


def wind_told(take: Take) -> WindTold | None:
    """Read the result of the stage *wind*; None for a take that was asked for its force only.

    Raises:
        TakeError: when the file does not describe a wind.
    """
    if not take.file("wind.json").is_file():
        return None
    told = take.read_json("wind.json")
    try:
        law, notes = told["drag_law"], [str(note) for note in told["notes"]]
        numbers = [float(told[key]) for key in ("mean_speed", "strongest_gust")] + [0.5 * float(law["air_density"]) * float(law["normal"])]
        if not (np.isfinite(numbers).all() and min(numbers) >= 0.0 and numbers[2] > 0.0):
            raise ValueError(f"speeds and drag {numbers}")
        return WindTold(told["field"] == "wind", tuple(notes), *numbers)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise TakeError(f"{take.file('wind.json')} does not describe a wind: {clause(error)}.", "Run Recover again.") from error


@dataclass(frozen=True)
class Seen:
    """What was observed in a clip; a field from trajectories has no such data."""

    camera: Camera
    frame: np.ndarray
    """(H, W, 3) uint8 RGB, frame 0."""
    outline: np.ndarray | None
    """(H, W) bool, the object's pixels in that frame; None for a take without outlines."""
    surface: Surface | None
    motion: np.ndarray
    """(T+1, V, 3) positions of the surface's vertices [m]."""


def field_summary(take: Take) -> FieldSummary:
    """Read the summary of a take's field from its report.

    Raises:
        TakeError: when the report is missing, or from another version.
    """
    report = take.read_json("report.json")
    try:
        box, clip = np.asarray(report["box"], dtype=np.float64), report.get("clip", {})
        fps, frames, density = float(report["fps"]), int(report["frames"]), float(report["material"]["density"])
        if box.shape != (2, 3) or not (np.isfinite(box).all() and 0.0 < fps < np.inf and 0.0 < density < np.inf and frames > 0):
            raise ValueError(f"box {box.tolist()}, {fps} frames per second, {frames} frames, density {density}")
        return FieldSummary(box, fps, frames, density, clip.get("path", ""), int(clip.get("first_frame", 0)))
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise TakeError(f"{take.file('report.json')} does not describe a field: {clause(error)}.", "Run Recover again.") from error


def trajectory(take: Take, field: FieldSummary) -> np.ndarray:
    """Positions of a take's particles (T+1, N, 3) [m].

    Raises:
        TakeError: when they are missing, not finite, or do not have the field's number of frames.
    """
    x = take.read_arrays("trajectory.npz").get("x")
    if x is None or x.ndim != 3 or x.shape[::2] != (field.frames + 1, 3) or not np.isfinite(x).all():
        raise TakeError(f"{take.file('trajectory.npz')} is no motion over {field.frames + 1} frames.", "Run Recover again.")
    return x


def read_seen(take: Take, field: FieldSummary) -> Seen | None:
    """Read what was observed, None for a field from trajectories. Raises TakeError when something is missing or inconsistent."""
    if not take.file("observation.npz").is_file():
        return None
    from ...engine.records import Camera, Surface

    arrays = take.read_arrays("observation.npz")
    camera, frame = from_arrays(Camera, arrays, "camera."), arrays.get("image")
    if frame is None or frame.ndim != 3 or not np.isfinite(camera.camera_to_world).all():
        raise TakeError(f"{take.file('observation.npz')} lacks its first frame or a camera.", "Run Recover again.")
    outline = next(iter(from_arrays(Masks, arrays, "masks.")), None) if "masks.windows" in arrays else None
    if not take.file("particles.npz").is_file():
        return Seen(camera, frame, outline, None, np.empty((0, 0, 3)))
    surface = from_arrays(Surface, take.read_arrays("particles.npz"), "surface.")
    try:
        motion = surface.attachment.follow(trajectory(take, field))
        sound = surface.triangles.min() >= 0 and surface.triangles.max() < len(surface.vertices) == motion.shape[1] == len(surface.uv)
    except (IndexError, ValueError):
        sound = False
    if not sound or not (np.isfinite(motion).all() and np.isfinite(surface.vertices).all() and np.isfinite(surface.uv).all()):
        raise TakeError(f"The object in {take.file('particles.npz')} does not fit its motion.", "Run Recover again.")
    return Seen(camera, frame, outline, surface, motion)


def is_preview(take: Take) -> bool:
    """Whether a re-simulation is a preview; False if its description does not say. Raises TakeError when that is damaged."""
    return take.file("resimulation.json").is_file() and take.read_json("resimulation.json").get("preview", False) is True


def simulated_motion(take: Take, name: str) -> dict[str, np.ndarray]:
    """A body of a re-simulation: `vertices` (T+1, V, 3) [m], `triangles` (M, 3), `fps` [1/s], `shell` (whether it was a shell).

    Raises:
        TakeError: when the body is missing, damaged or not finite.
    """
    arrays = take.read_arrays(f"bodies/{name}.npz")
    vertices = arrays.get("vertices", np.empty(0))
    fps = float(arrays["fps"]) if np.shape(arrays.get("fps")) == () and "fps" in arrays else 0.0
    if vertices.ndim != 3 or vertices.shape[2] != 3 or not (0.0 < fps < np.inf and np.isfinite(vertices).all()):
        raise TakeError(f"The simulation of {name} in {take.path} is damaged or not finite.", "Run Re-simulate again.")
    return arrays
