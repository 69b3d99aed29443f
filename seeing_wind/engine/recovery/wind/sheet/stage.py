"""The stages *recover* and *wind* for a sheet seen in 3D, done in one solve; they leave the same files in the take as for any other body.

`trajectory.npz` holds the motion and the force on the sheet: the motion is that of the simulation that followed the sheet or, for a clip,
the one that was seen. `field.safetensors` holds the force per volume of the sheet, `wind.safetensors` and `wind.json` the wind.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ....errors import ObjectError, SimulationError
from ....field import ForceField, distill, load_field
from ....materials import Sheet
from ....mpm.shell import Shell, shell_of
from ....mpm.shell.membrane import deformation, plane_axes
from ....progress import Journal, Progress
from ....record_arrays import read_recovery, to_arrays
from ....records import Measured, Outcome, Particles, Recovery, TrackTargets
from ....settings import RecoverSettings, WindSettings
from ....take import Take, stamp_of
from ...diagnostics.missed import fall_of, verdict
from ...diagnostics.remarks import reaction_remarks
from ...journal import TakeJournal
from ...targets.tracks import track_channels
from ..drag import area_normals
from ..stage import FIELD, FORCE_MEAN, TOLD, Wind, clear, read_back
from ..verdict import STRONGEST, UNEXPLAINED, figures, sentence
from .air import Air, Cause, Push
from .estimate import BREEZE, SheetEstimate, field_of, follower_of
from .following import Follower
from .observed import Observed, observe_sheet

VERSION = 7
"""Part of the stamp: raise it when the results change."""
UNTOLD, FELT = 0.4, 0.5
"""A sheet does not determine the wind if the wind's deviation exceeds both of these: the first is relative to the wind's speed, the second
is in m/s. (A sheet that falls through calm air does show that the air is calm, although the relative deviation is then large.)"""
DOUBTFUL = 0.2
"""Relative deviation of the wind from which a note states how uncertain it is."""


@dataclass(frozen=True)
class SheetSeen:
    """A sheet and where its vertices were seen."""

    x: np.ndarray
    """(T+1, V, 3) [m]."""
    faces: np.ndarray
    """(F, 3)."""
    fixed: np.ndarray
    """(V,) bool."""
    sheet: Sheet
    fps: float
    sigma: float | np.ndarray | None = None
    """Noise of x [m], one number or (T+1, V); None to measure it."""
    measured: Measured | None = None
    """What was measured in each frame of a clip by itself; None for points in 3D."""
    targets: Sequence[TrackTargets] = ()
    """The tracks that x was estimated from, if any: the residual is then that of the tracks [px], not that of x [m]."""


@dataclass(frozen=True)
class SheetFound:
    """Results of the stage."""

    recovery: Recovery
    particles: Particles
    """The vertices, each with its share of the sheet's volume."""
    field: ForceField
    """Force density [N/m³]."""
    wind: Wind
    seconds: dict[str, float]


def sheet_stage(
    take: Take, source: SheetSeen, upstream: str, settings: RecoverSettings, blown: WindSettings, progress: Progress
) -> SheetFound:
    """Recover the wind or the force that moved a sheet.

    Args:
        upstream: stamp of the source.
        settings: gravity, representation and seed are used.
        blown: its `field` says whether to recover a wind (the default), a force, or the more probable of the two.

    Raises:
        UsageError, ObjectError: the mesh is not a sheet, see `mpm.shell.shell_of`; or field "wind" where no wind can have moved it.
        SimulationError: the sheet cannot be simulated even close to where it was seen.
    """
    seen = observe_sheet(source.x, source.faces, source.fixed, source.fps, source.sigma, source.measured)
    shell = shell_of(seen.rest, source.faces, source.sheet, pinned=source.fixed)
    seen = replace(seen, faces=shell.surface.faces)
    particles = _particles(shell)
    stamp = stamp_of("sheet", VERSION, upstream, settings.gravity, settings.representation, settings.seed, blown)

    def read() -> SheetFound:
        return SheetFound(read_recovery(take), particles, load_field(take.file("field.safetensors")), read_back(take), {})

    kept = take.kept("recover", stamp, read, progress)
    if kept is not None:
        return kept
    began = time.perf_counter()
    progress.begin("recover", "recovering the force" if blown.field == "force" else "recovering the wind")
    with TakeJournal(take, stamp, progress) as journal:
        found, told = choose(shell, seen, settings.gravity, blown.field or "wind", progress, journal)
        recovery = _recovery(shell, seen, source.targets, settings.gravity, particles, found, time.perf_counter() - began)
        seconds, began = {"recover": time.perf_counter() - began}, time.perf_counter()
        progress.begin("distill", "fitting the field")
        fitted = _both(recovery, found, told)
        fields = [distill(one, particles, seen.fps, settings.representation, settings.seed, progress, journal) for one in fitted]
        take.withdraw("recover")
        take.withdraw("solve")
        clear(take)
        take.write_arrays("trajectory.npz", to_arrays(recovery) | {"fps": np.array(seen.fps)})
        for name, field in zip(("field.safetensors", FIELD), fields):
            field.kind = "wind" if name == FIELD else "force"
            with take.writing(name) as path:
                field.save(path)
        take.write_json(TOLD, told)
        take.finish("wind", stamp, {"field": blown.field or "wind"})
        take.finish("recover", stamp, {"gravity": list(settings.gravity)})
        seconds["distill"] = time.perf_counter() - began
    return SheetFound(recovery, particles, fields[0], Wind(fields[1] if len(fields) > 1 else None, told, told["notes"]), seconds)


def _both(recovery: Recovery, found: SheetEstimate, told: dict[str, Any]) -> list[Recovery]:
    """What fields are fitted to: the recovered force and, if the field is a wind, a copy with the wind in the force's place."""
    if told["field"] != "wind":
        return [recovery]
    return [recovery, replace(recovery, force_density=found.velocity, deviation=found.deviation)]


def choose(
    shell: Shell, seen: Observed, gravity: Sequence[float], field: str, progress: Progress, journal: Journal
) -> tuple[SheetEstimate, dict[str, Any]]:
    """The estimate of the wind or the force, as `field` ("wind", "force" or "auto") asks, and the content of `wind.json`.

    Raises:
        ObjectError: field "wind" where no wind can have moved the sheet, or the sheet does not determine it.
    """

    def estimate(cause: Cause, mean: float, name: str, part: Progress) -> SheetEstimate:
        follower = follower_of(shell, seen, gravity, cause)
        return journal.once(name, SheetEstimate, lambda: field_of(follower, mean, part, journal))

    if field == "force":
        return estimate(Push(shell), FORCE_MEAN, "force", progress), {"field": "force", "why": "--field force", "notes": []}
    wind = estimate(Air(shell), BREEZE, "wind", progress.part(0.0, 0.5 if field == "auto" else 1.0))
    against = _objection(wind)
    if against and field == "wind":
        hint = "Use --field force, or check areal density, scale, depth, gravity and what is held."
        raise ObjectError(f"No wind can be recovered. {against}", hint)
    told: dict[str, Any] = {"field": "wind", "why": "--field wind", **figures(wind), "doubt": wind.doubt, "error_of_law": wind.law}
    told["reliability_of_path"] = wind.reliability
    if field == "wind":
        return wind, told | {"notes": _remarks(wind, told)}
    force = estimate(Push(shell), FORCE_MEAN, "force", progress.part(0.5, 1.0))
    odds = wind.evidence - force.evidence
    likely = not against and odds > 0.0
    why = against or (
        f"A wind under the drag law is {'more' if likely else 'less'} probable than a force of its own: "
        f"the logarithm of the odds is {odds:.0f}."
    )
    told |= {"field": "wind" if likely else "force", "why": why, "log_odds_of_wind": odds}
    notes = _remarks(wind, told) if likely else []
    return wind if likely else force, told | {"notes": [*notes, f"Field: {told['field']}. {why}"]}


def _objection(found: SheetEstimate) -> str:
    """Why the estimate cannot be accepted as a wind; "" where it can."""
    speed = float(np.median(np.linalg.norm(found.velocity, axis=-1)))
    if speed > STRONGEST:
        return f"It would take a wind of {speed:.0f} m/s to push a sheet of this weight so hard: something else moves it."
    if found.unexplained > UNEXPLAINED:
        return f"No wind moves this sheet so: {100 * found.unexplained:.0f} % of what air would have to do stays unexplained."
    if found.doubt > UNTOLD and found.uncertain > FELT:
        return (
            f"This sheet does not tell the wind: {100 * found.doubt:.0f} % of its speed are uncertain. A sheet that turns little is pushed "
            "alike by a wind across it and by stronger ones at a slant."
        )
    return ""


def _remarks(found: SheetEstimate, told: dict[str, Any]) -> list[str]:
    """Notes on an accepted wind."""
    if found.doubt < DOUBTFUL:
        return [sentence(told)]
    size = f"{100 * found.doubt:.0f} % of its speed, {found.uncertain:.1f} m/s, are uncertain"
    return [sentence(told), f"The wind is doubtful: {size}, most of it along the sheet."]


def _particles(shell: Shell) -> Particles:
    volume = shell.mass / shell.sheet.areal_density * shell.sheet.thickness
    return Particles(shell.surface.x, volume, shell.pinned, shell.surface.edge_length)


def _recovery(
    shell: Shell,
    seen: Observed,
    targets: Sequence[TrackTargets],
    gravity: Sequence[float],
    particles: Particles,
    found: SheetEstimate,
    seconds: float,
) -> Recovery:
    # The simulation is pulled towards the observations but lags them by some pixels; for a clip, x is therefore the observed path.
    x = seen.x if targets else found.x
    residual = residual_in_pixels(targets, x) if targets else np.sqrt(((x - seen.x) ** 2).sum(axis=-1).mean(axis=1))
    volume, weight = particles.volume[:, None], shell.mass[:, None] * np.linalg.norm(gravity)
    held_up = reaction_remarks(particles, found.force / shell.mass[:, None], x, gravity)
    # the clip does not show how much of the force is the support that holds the sheet up
    deviation = np.hypot(found.force_deviation, weight) if held_up else found.force_deviation
    v0 = np.where(shell.pinned[:, None], 0.0, seen.at(0.0)[1])
    useless: list[str] = []
    if targets:  # a simulation is pulled towards points in 3D whatever the force is, so their residual says nothing about the force
        channels = [track_channels(particles, one, plastic=False) for one in targets]
        fall = fall_of(particles, found.force / shell.mass[:, None], x, v0, seen.fps, gravity)
        useless = verdict(particles, channels, x, residual, fall, "The sheet that was followed")
    return Recovery(
        outcome=Outcome.CONVERGED if found.converged else Outcome.MAX_ITERATIONS,
        force_density=found.force / volume,
        deviation=deviation / volume,
        x=x,
        F=np.stack([_deformations(shell, one) for one in x]),
        v0=v0,
        residual=residual,
        residual_unit="px" if targets else "m",
        iterations=found.iterations,
        seconds=seconds,
        notes=[
            *useless,
            *held_up,
            _stray(follower_of(shell, seen, gravity, found.cause_of(shell)), found, bool(targets)),
        ],
    )


def residual_in_pixels(targets: Sequence[TrackTargets], x: np.ndarray) -> np.ndarray:
    """(T+1,) root mean square distance [px] of the tracks from their projections for vertices at x (T+1, V, 3) [m]; 0 in frames without
    visible tracks."""
    residual = np.zeros(len(x))
    for t, vertices in enumerate(x):
        off = [
            one.camera.project(one.attachment.follow(vertices)[one.visible[t]], t)[0] - one.xy[t, one.visible[t]] for one in targets
        ]
        squares = (np.concatenate(off) ** 2).sum(axis=1)
        residual[t] = np.sqrt(squares.mean()) if squares.size else 0.0
    return residual


def _stray(follower: Follower, found: SheetEstimate, filmed: bool) -> str:
    """A note on how far a free simulation in the recovered field, without the pull towards the observations, strays from them."""
    said = "The recovered motion is " + ("what the clip shows." if filmed else "a simulation that is softly drawn to the points seen.")
    try:
        path = replace(follower, pull=0.0).path(found.velocity)
    except SimulationError:
        return f"{said} Without that pull the simulation breaks down."
    away = np.linalg.norm(path - follower.seen.x, axis=-1)
    travel = np.linalg.norm(follower.seen.x - follower.seen.x[0], axis=-1).max(axis=0).mean()
    share = 100 * away.mean() / max(travel, 1e-12)
    return f"{said} The field alone puts the sheet off by {share:.0f} % of its travel in the mean."


def _deformations(shell: Shell, x: np.ndarray) -> np.ndarray:
    """(V, 3, 3) deformation gradients at the vertices for positions x (V, 3) [m]: area-weighted means over the adjacent faces, without any
    stretch along the normal."""
    surface = shell.surface
    rest = surface.x[surface.faces]
    t, s = plane_axes(rest[:, 1] - rest[:, 0], rest[:, 2] - rest[:, 0])
    normals = (area_normals(place, surface.faces) for place in (surface.x, x))
    unit = [one / np.linalg.norm(one, axis=1, keepdims=True) for one in normals]
    whole = np.einsum("fia,faj->fij", deformation(shell.membrane, x), np.stack([t, s], axis=1)) + unit[1][:, :, None] * unit[0][:, None]
    total = np.zeros((len(x), 3, 3))
    for corner in range(3):
        np.add.at(total, surface.faces[:, corner], surface.area[:, None, None] * whole)
    return total / np.bincount(surface.faces.ravel(), np.repeat(surface.area, 3))[:, None, None]
