"""report.json: the results of a recovery, in numbers that a script can read."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ...field import ForceField
from ...field.sampling import sample_points
from ...materials import Material
from ...progress import Journal, NoProgress, Progress
from ...records import Body, Gaussians, Observation, Particles, Recovery, as_found
from ...settings import RecoverSettings, to_mapping
from ...take import Take
from ..over_clip import frames_fitted
from ..ply import write_ply
from .figure import draw_report
from .footage import Footage, film, reduced
from .overlay import write_overlay
from .products import Level, Products
from .resimulated import frames_measured, likeness, look_over_clip, write_resimulated


def write_report(
    take: Take,
    observation: Observation,
    body: Body,
    recovery: Recovery,
    field: ForceField,
    seconds: dict[str, float],
    settings: RecoverSettings | None = None,
    progress: Progress = NoProgress(),
    level: Level = "full",
    wind: dict[str, Any] | None = None,
    expected: dict[str, float] | None = None,
    journal: Journal = Journal(),
) -> dict[str, Any]:
    """Write the products that `level` asks for, of a recovery from a clip.

    none: nothing. quick: report.json, report.png and overlay.mp4. full: also resimulated.mp4 with its likeness to the clip, and
    gaussians.ply with the look fitted to the whole clip. A product that cannot be made is named in a warning, and the others are made.

    Args:
        seconds: wall-clock seconds per stage.
        expected: seconds that each stage, by its name, was expected to take before it began.
        settings: of the recovery, repeated in the report.
        wind: the results of `recovery.wind.stage`; None or empty if no wind was asked for.

    Returns:
        The contents of report.json. Its `report` is about the report itself: `level`, `seconds` per product, and `missing`, the products
        that could not be made, each with a sentence that says why.
    """
    sampled = sample_points(field, recovery.x[:-1])
    confidence = sampled[1]
    figures = _figures(body.particles, body.material, recovery, field, confidence, seconds, expected, settings, wind)
    figures["clip"] = {"path": observation.clip, "first_frame": observation.first_frame, "tracks": int(observation.xy.shape[1])}
    products = Products(level, progress, journal)
    figures["report"] = products.record
    if level == "none":
        return figures
    small, full = reduced(observation), level == "full"
    _first(take, products, figures, recovery, field.fps, confidence, small)
    measured = frames_measured(observation.masks, recovery) if full else []
    keep = {*measured, *frames_fitted(observation.masks, recovery).tolist()} if full else set(measured)
    footage = products.make("clip", lambda: film(observation, recovery, small, keep, progress))
    if footage is not None:
        products.film(take.file("overlay.mp4"), lambda: write_overlay(take, footage.clip.frames, small, recovery, field, progress, sampled))
    if footage is not None and full:
        # If the look cannot be fitted, that of frame 0 is used.
        body = products.make("gaussians.ply", lambda: _write_look(take, footage, body, recovery, progress, products.journal)) or body
        # The likeness: how well force, body and look together reproduce the frames.
        written = take.file("resimulated.mp4")
        alike = products.film(
            written, lambda: write_resimulated(take, footage.clip.frames, small, body, recovery, progress, products.journal)
        )
        if small is not observation and alike is not None:
            alike = products.make("likeness", lambda: likeness(footage, body, recovery, measured, progress))
        if alike is not None:
            figures["resimulated"] = alike
    products.make("report.json", lambda: take.write_json("report.json", figures), timed=False)
    return figures


def write_trajectory_report(
    take: Take,
    particles: Particles,
    material: Material,
    recovery: Recovery,
    field: ForceField,
    seconds: dict[str, float],
    settings: RecoverSettings | None = None,
    progress: Progress = NoProgress(),
    level: Level = "full",
    wind: dict[str, Any] | None = None,
    expected: dict[str, float] | None = None,
) -> dict[str, Any]:
    """Write report.json and report.png of a recovery from 3D trajectories, which has no clip to draw on. Otherwise as `write_report`."""
    confidence = sample_points(field, recovery.x[:-1])[1]
    figures = _figures(particles, material, recovery, field, confidence, seconds, expected, settings, wind)
    products = Products(level, progress, Journal())
    figures["report"] = products.record
    if level != "none":
        _first(take, products, figures, recovery, field.fps, confidence, None)
        products.make("report.json", lambda: take.write_json("report.json", figures), timed=False)
    return figures


def _first(
    take: Take,
    products: Products,
    figures: dict[str, Any],
    recovery: Recovery,
    fps: float,
    confidence: np.ndarray,
    observation: Observation | None,
) -> None:
    """Make report.png and a first report.json before the videos, which take long: these results are kept even if the videos fail."""

    def page() -> None:
        with take.writing("report.png") as path:
            draw_report(path, figures, recovery, fps, confidence, observation)

    products.make("report.png", page)
    products.make("report.json", lambda: take.write_json("report.json", figures), timed=False)


def _write_look(take: Take, footage: Footage, body: Body, recovery: Recovery, progress: Progress, journal: Journal) -> Body:
    """Write gaussians.ply with the look fitted to the whole clip; returns the body with that look."""
    gaussians = journal.once("look", Gaussians, lambda: look_over_clip(footage, body, recovery, progress).gaussians)
    body = dataclasses.replace(body, gaussians=gaussians)
    with take.writing("gaussians.ply") as path:
        write_ply(path, body.gaussians)
    return body


def _figures(
    particles: Particles,
    material: Material,
    recovery: Recovery,
    field: ForceField,
    confidence: np.ndarray,
    seconds: dict[str, float],
    expected: dict[str, float] | None,
    settings: RecoverSettings | None,
    wind: dict[str, Any] | None,
) -> dict[str, Any]:
    strength = np.linalg.norm(recovery.force_density, axis=-1)
    net = np.einsum("tnc,n->tc", recovery.force_density, particles.volume)
    figures: dict[str, Any] = {
        "outcome": recovery.outcome.value,
        "iterations": recovery.iterations,
        "seconds": {stage: round(spent, 3) for stage, spent in (seconds | {"total": sum(seconds.values())}).items()},
        "residual": _residual(recovery.residual),
        "residual_unit": recovery.residual_unit,
        "residual_per_frame": [float(value) if np.isfinite(value) else None for value in recovery.residual],
        "frames": field.frames,
        "fps": field.fps,
        "particles": len(particles.x),
        "mass": particles.mass(material),
        "material": {name: value for name, value in vars(as_found(material, recovery)).items() if value != ""},
        "net_force": net.tolist(),
        "mean_net_force": net.mean(axis=0).tolist(),
        "wild_frames": [] if recovery.wild is None else np.flatnonzero(recovery.wild).tolist(),
        "force_density": {"mean": float(strength.mean()), "p98": float(np.percentile(strength, 98)), "max": float(strength.max())},
        "confidence": {"mean": float(confidence.mean()), "p10": float(np.percentile(confidence, 10))},
        "representation": field.representation,
        "box": field.box.tolist(),
        "notes": list(recovery.notes),
    }
    if recovery.youngs_modulus is not None:
        # The recovered stiffness is that of the material above, and the forces are those on such a body.
        figures["stiffness"] = {
            "youngs_modulus": recovery.youngs_modulus,
            "given": material.youngs_modulus,
            "relative_deviation": recovery.stiffness_deviation,
            "clamp_depth": recovery.clamp_depth,
        }
    if expected:
        figures["expected_seconds"] = {stage: round(foreseen, 3) for stage, foreseen in expected.items()}
    if settings is not None:
        figures["settings"] = to_mapping(settings)
    if wind:
        figures["wind"] = {key: value for key, value in wind.items() if key != "notes"}  # its notes are among the recovery's
    return figures


def _residual(residual: np.ndarray) -> dict[str, float]:
    """Statistics of the residual over the frames in which anything was seen."""
    seen = residual[np.isfinite(residual)]
    if not len(seen):
        return {}
    return {"median": float(np.median(seen)), "p90": float(np.percentile(seen, 90)), "max": float(seen.max())}
