"""Stage *wind*: the recovered force of a take read as a wind -> `wind.safetensors` beside the field, and `wind.json`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import ObjectError, WrongTake
from ...field import ForceField, distill, load_field
from ...progress import Journal, Progress
from ...records import Body, Material, Particles, Recovery
from ...settings import RecoverSettings, WindSettings
from ...take import Take, stamp_of
from ..clip import still_frames
from ..journal import TakeJournal
from ..prior.basis import SpatialBasis, spatial_basis
from .estimate import Estimate, force_problem, places_of, solved, spacing_of, wind_of
from .felt import Felt, felt_force
from .surface import BodySurface, mesh_surface, particle_surface
from .verdict import figures, objection, sentence

VERSION = 1
"""Part of the stamp: raise it when the results change."""
FIELD, TOLD = "wind.safetensors", "wind.json"
MODES, DEGREE = 16, 1
"""Of the wind over the body: those up to the degree that net force and torque tell of."""
FORCE_MEAN = 20.0
"""Standard deviation of the mean of a force's acceleration [m/s²] before anything is seen, two of gravity."""


@dataclass(frozen=True)
class Wind:
    """What the stage found."""

    field: ForceField | None
    """u [m/s]; None where the take keeps to its force."""
    told: dict[str, Any]
    """As in `wind.json`: `field` is "wind" or "force", `why` says why, and the figures of `verdict.figures`."""
    notes: list[str]


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
    """Find the wind if `settings` ask for it; else leave the take without one.

    Args:
        body: with its mesh; None for one that is particles only.
        solving: of the recovery: gravity, representation and seed.

    Raises:
        ObjectError: with field "wind", where no wind can have made the force; the reason is in words.
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
    """The wind of a take, None where it has only a force."""
    return load_field(take.file(FIELD)) if take.file(FIELD).is_file() else None


def read_back(take: Take) -> Wind:
    """What the stage left in a take. Raises WrongTake where that is damaged or gone."""
    told = take.read_json(TOLD)
    notes = told.get("notes")
    if told.get("field") not in ("wind", "force") or not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise WrongTake(f"{take.file(TOLD)} does not describe a wind.", "Run `recover` with --take for this folder again.")
    return Wind(load_field(take.file(FIELD)) if told["field"] == "wind" else None, told, notes)


def write_wind(take: Take, field: ForceField | None, told: dict[str, Any], stamp: str) -> None:
    """What was found, into a take that has been cleared: the stamp comes last."""
    if field is not None:
        with take.writing(FIELD) as path:
            field.save(path)
    take.write_json(TOLD, told)
    take.finish("wind", stamp, {"field": told["field"]})


def clear(take: Take) -> None:
    """Remove the wind of an earlier run: it belongs to another force."""
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
            f"A wind under the drag law is {'more' if odds > 0.0 else 'less'} probable than a force of its own: "
            f"the logarithm of the odds is {odds:.0f}."
        )
    notes = [sentence(told)] if told["field"] == "wind" else []
    if settings.field == "auto":
        notes.append(f"Field: {told['field']}. {told['why']}")
    return found, {**told, "notes": notes}


def felt_in(
    body: Body | None, particles: Particles, material: Material, recovery: Recovery, fps: float, solving: RecoverSettings
) -> tuple[Felt, SpatialBasis, np.ndarray]:
    """What the body felt in the frames that were not said to be still, the modes of the wind over it, and which frames are still (T,)."""
    mass = material.density * particles.volume * ~particles.pinned
    basis = spatial_basis(particles.x, mass, MODES).up_to(DEGREE)
    still = still_frames(solving, len(recovery.force_density))
    return felt_force(recovery, particles, material.density, surface_of(body, particles), basis, fps).without(still), basis, still


def _force_evidence(felt: Felt, basis: SpatialBasis, path: np.ndarray, progress: Progress) -> float:
    start = np.einsum("tdpi,td->tpi", felt.seen, felt.measured)
    return solved(force_problem(felt), places_of(basis, path, spacing_of(len(path) - 1)), [start], FORCE_MEAN, progress).evidence


def surface_of(body: Body | None, particles: Particles) -> BodySurface:
    """The mesh of a body that has one, else the surface of its particles."""
    if body is None:
        return particle_surface(particles)
    mesh = body.surface
    return mesh_surface(mesh.vertices, mesh.triangles, mesh.attachment, particles.x, closed=True)
