"""Stage *wind*: explains the recovered force of a take by a wind -> `wind.safetensors` beside the field, and `wind.json`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import ObjectError, WrongTake
from ...field import ForceField, distill, load_field
from ...materials import Material
from ...progress import Journal, Progress
from ...records import Body, Particles, Recovery
from ...settings import RecoverSettings, WindSettings
from ...take import Take, stamp_of
from ..clip import still_frames
from ..journal import TakeJournal
from ..prior.basis import SpatialBasis, spatial_basis
from .estimate import Estimate, force_problem, places_of, solve_problem, spacing_of, wind_of
from .felt import Felt, felt_force
from .surface import BodySurface, mesh_surface, particle_surface
from .verdict import figures, objection, sentence

VERSION = 1
"""Part of the stamp: raise it when the results change."""
FIELD, TOLD = "wind.safetensors", "wind.json"
MODES, DEGREE = 16, 1
"""Most modes that are computed, and the highest degree of those used for the wind over the body: net force and torque show no more."""
FORCE_MEAN = 20.0
"""Prior standard deviation of the mean acceleration by a force without a drag law [m/s²]: twice gravity."""


@dataclass(frozen=True)
class Wind:
    """The result of the stage."""

    field: ForceField | None
    """u [m/s]; None if the take keeps its force."""
    told: dict[str, Any]
    """The contents of `wind.json`: `field` is "wind" or "force", `why` gives the reason, and the rest is from `verdict.figures`."""
    notes: list[str]
    """Notes for the user."""


def wind_stage(
    take: Take,
    body: Body | None,
    particles: Particles,
    material: Material,
    recovery: Recovery,
    fps: float,
    settings: WindSettings,
    solving: RecoverSettings,
    progress: Progress,
) -> Wind:
    """Find the wind if `settings` ask for it; otherwise remove any wind from the take.

    Args:
        body: the body with its mesh; None for one that is particles only.
        solving: settings of the recovery, for its gravity, representation, seed and still frames.

    Raises:
        ObjectError: with the field "wind", if no wind can have caused the force; the message gives the reason.
    """
    if settings.field in (None, "force"):
        clear(take)
        return Wind(None, {}, [])
    given = (solving.representation, solving.seed, solving.gravity, solving.still)
    stamp = stamp_of("wind", VERSION, settings, take.file("trajectory.npz"), *given)
    kept = take.kept("wind", stamp, lambda: read_back(take), progress)
    if kept is not None:
        return kept
    progress.begin("wind", "finding the wind")
    clear(take)
    with TakeJournal(take, stamp, progress) as journal:
        found, told = _found(body, particles, material, recovery, fps, settings, solving, progress, journal)
        field = None
        if told["field"] == "wind":
            progress.begin("wind", "fitting the wind")
            as_recovered = replace(recovery, force_density=found.velocity, deviation=found.deviation)
            field = distill(as_recovered, particles, fps, solving.representation, solving.seed, progress, journal)
            field.kind = "wind"
        write_wind(take, field, told, stamp)
    return Wind(field, told, told["notes"])


def read_wind(take: Take) -> ForceField | None:
    """The wind of a take; None if it has only a force."""
    return load_field(take.file(FIELD)) if take.file(FIELD).is_file() else None


def read_back(take: Take) -> Wind:
    """What the stage left in a take. Raises WrongTake where that is damaged or gone."""
    told = take.read_json(TOLD)
    notes = told.get("notes")
    if told.get("field") not in ("wind", "force") or not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise WrongTake(f"{take.file(TOLD)} does not describe a wind.", "Run `recover` with --take for this folder again.")
    return Wind(load_field(take.file(FIELD)) if told["field"] == "wind" else None, told, notes)


def write_wind(take: Take, field: ForceField | None, told: dict[str, Any], stamp: str) -> None:
    """Write the result into a take that has been cleared; the stamp comes last."""
    if field is not None:
        with take.writing(FIELD) as path:
            field.save(path)
    take.write_json(TOLD, told)
    take.finish("wind", stamp, {"field": told["field"]})


def clear(take: Take) -> None:
    """Remove the wind of an earlier run, which belongs to another force."""
    take.withdraw("wind")
    for name in (FIELD, TOLD):
        take.file(name).unlink(missing_ok=True)


def _found(
    body: Body | None,
    particles: Particles,
    material: Material,
    recovery: Recovery,
    fps: float,
    settings: WindSettings,
    solving: RecoverSettings,
    progress: Progress,
    journal: Journal,
) -> tuple[Estimate, dict[str, Any]]:
    felt, basis, still = felt_in(body, particles, material, recovery, fps, solving)
    found = journal.once("wind", Estimate, lambda: wind_of(felt, basis, recovery.x, progress), felt.measured)
    moving = ~still[:, None, None]
    found = replace(found, velocity=found.velocity * moving, deviation=found.deviation * moving)
    against = objection(found, recovery, particles, material.density, fps, solving.gravity)
    if against and settings.field == "wind":
        raise ObjectError(f"No wind can be recovered. {against}", "Use --field force, or check material, scale, gravity and what is held.")
    told = {"field": "wind", "why": "--field wind", **figures(found)}
    if settings.field == "auto":
        odds = 0.0 if against else found.evidence - _force_evidence(felt, basis, recovery.x, progress)
        told["log_odds_of_wind"] = odds
        told["field"] = "wind" if odds > 0.0 else "force"
        told["why"] = against or (
            f"A wind that acts by the drag law is {'more' if odds > 0.0 else 'less'} probable than a force without one: "
            f"the logarithm of the odds is {odds:.0f}."
        )
    notes = [sentence(told)] if told["field"] == "wind" else []
    if settings.field == "auto":
        notes.append(f"Field: {told['field']}. {told['why']}")
    return found, {**told, "notes": notes}


def felt_in(
    body: Body | None, particles: Particles, material: Material, recovery: Recovery, fps: float, solving: RecoverSettings
) -> tuple[Felt, SpatialBasis, np.ndarray]:
    """The force on the body, set to zero in frames marked as still; the modes of the wind over the body; which frames are still (T,)."""
    mass = material.density * particles.volume * ~particles.pinned
    basis = spatial_basis(particles.x, mass, MODES).up_to(DEGREE)
    still = still_frames(solving, len(recovery.force_density))
    return felt_force(recovery, particles, material.density, surface_of(body, particles), basis, fps).without(still), basis, still


def _force_evidence(felt: Felt, basis: SpatialBasis, path: np.ndarray, progress: Progress) -> float:
    start = np.einsum("tdpi,td->tpi", felt.seen, felt.measured)
    places = places_of(basis, path, spacing_of(len(path) - 1))
    return solve_problem(force_problem(felt), places, [start], FORCE_MEAN, progress).evidence


def surface_of(body: Body | None, particles: Particles) -> BodySurface:
    """The surface of the body's mesh, or, without a body, of the particles."""
    if body is None:
        return particle_surface(particles)
    mesh = body.surface
    return mesh_surface(mesh.vertices, mesh.triangles, mesh.attachment, particles.x, closed=True)
