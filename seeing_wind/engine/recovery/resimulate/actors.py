"""The bodies of an edit before the simulation: particles or a shell, material, pins."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import MaterialError, UsageError
from ...field.force_field import ForceField
from ...materials import DEFAULT, SHEET_UNITS, Material, adjust, find
from ...records import Body, Particles, Recovery, as_found, body_as_found
from ...settings import BodyEdit, Edit
from . import sheets
from .coarser import fill_coarser
from .in_field import MOST_SCALED
from .mesh import load_mesh
from .pins import Rider, hold_of, particle_paths, read_pin_path, read_pins, read_weights, ride

MIN_SUBSTEPS = 100
"""Fewest substeps per frame, whatever the stiffness, so that the first frame of a fall is accurate to 1 %."""

FASTEST = 1e4
"""Largest initial velocity of a body [m/s] and largest gravity [m/s²]: more is a mistake."""

LARGEST = 1e4
"""Largest size of a body [m]: a larger one was given in another unit."""


@dataclass(frozen=True)
class Actor:
    """A body before the simulation."""

    edit: BodyEdit
    particles: Particles
    material: Material
    velocity: np.ndarray
    """(N, 3) velocity of the particles when the body starts [m/s]."""
    rider: Rider
    triangles: np.ndarray
    notes: list[str]
    soft: np.ndarray
    """(N,) weight in 0..1 with which a particle is pulled back to its place; 0 for free and for firmly held particles."""
    clamp_depth: float = 0.0
    """How far below the border of the pinned material the clamp begins [cells]; for the recovered object, as in the recovery."""
    substeps: int = MIN_SUBSTEPS
    """Fewest substeps per frame; for the recovered object those of the recovery, as its force belongs to the damping that they cause."""
    path: np.ndarray | None = None
    """(T+1, N, 3) path of the pinned particles [m]; None if they keep their places."""
    coarser: float = 1.0
    """Factor on the spacing of the particles relative to the full result: at most the edit's coarseness."""
    borne: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    """(3,) gravity that the body already bears in its initial shape, so that it does not bend it further [m/s²]."""


def enter_all(edit: Edit, field: ForceField, recovered: tuple[Body, Recovery] | None, base_dir: Path) -> list[Actor | sheets.Hanging]:
    """All bodies of an edit. Solids in contact share a grid, so all of them are as fine as the finest must be.

    Raises:
        UsageError, MaterialError: as in `enter`.
    """
    entered = [_enter_named(body, field, recovered, base_dir, edit.coarseness) for body in edit.body]
    finest = min((one.coarser for one in entered if isinstance(one, Actor)), default=1.0)
    if edit.contact and any(isinstance(one, Actor) and one.coarser > finest for one in entered):
        entered = [enter(body, field, recovered, base_dir, finest) for body in edit.body]
    return entered


def _enter_named(
    body: BodyEdit, field: ForceField, recovered: tuple[Body, Recovery] | None, base_dir: Path, coarseness: float
) -> Actor | sheets.Hanging:
    """`enter`, with the body's name in what is said of its material."""
    try:
        return enter(body, field, recovered, base_dir, coarseness)
    except MaterialError as error:
        raise MaterialError(f"{body.name}: {error.message}", error.hint, quantity=error.quantity) from error


def enter(
    body: BodyEdit, field: ForceField, recovered: tuple[Body, Recovery] | None, base_dir: Path, coarseness: float
) -> Actor | sheets.Hanging:
    """A body with mesh, particles or shell, material and pins. The recovered object keeps the particles with which its force was found.

    Raises:
        UsageError: for numbers, a mesh or pins that do not fit. MaterialError: for an unknown material.
    """
    for name in ("mass_scale", "youngs_modulus_scale"):
        if not 1.0 / MOST_SCALED <= getattr(body, name) <= MOST_SCALED:
            raise UsageError(
                f"{body.name}: {name} is {getattr(body, name):g}.",
                f"Give a number from {1.0 / MOST_SCALED:g} to {MOST_SCALED:g}; 1 leaves it as it is.",
            )
    if body.mass is not None and not (np.isfinite(body.mass) and body.mass > 0.0):
        raise UsageError(f"{body.name}: mass is {body.mass}.", "Give kilograms above zero.")
    if body.mass is not None and body.density is not None:
        raise UsageError(f"{body.name}: mass and density are both given.", "Give one of them; the other follows from the volume.")
    if body.pin_weights is not None and body.pin is None:
        raise UsageError(f"{body.name}: pin_weights without pin.", "Give the indices in pin as well.")
    if body.pin_path is not None and (body.pin is None or body.mesh == "recovered"):
        raise UsageError(f"{body.name}: pin_path needs the vertices of a mesh in pin.", "Leave it out, or give them.")
    if body.pin_path is not None and body.start_frame:
        raise UsageError(f"{body.name}: pins that move, and a start_frame of {body.start_frame}.", "Leave one of them out.")
    if body.free is not None and body.mesh != "recovered":
        raise UsageError(f"{body.name}: free is given, but nothing holds a mesh besides its own pin.", "Leave it out, or change pin.")
    if not 0 <= body.start_frame < field.frames:
        raise UsageError(f"{body.name}: start_frame {body.start_frame} is outside the clip.", f"Its frames are 0 to {field.frames - 1}.")
    if body.velocity is not None and (np.shape(body.velocity) != (3,) or not np.linalg.norm(body.velocity) <= FASTEST):
        raise UsageError(f"{body.name}: velocity is {body.velocity}.", f"Give three numbers in m/s, {FASTEST:g} together at most.")
    if body.mesh == "recovered":
        if recovered is None:
            raise UsageError(f"{body.name}: there is no recovered object here.", "Give a mesh instead.")
        if recovered[0].sheet is not None:
            return sheets.enter_recovered(body, *recovered, base_dir)
        if body.shell or any(getattr(body, name) is not None for name in SHEET_UNITS):
            raise UsageError(f"{body.name}: the recovered object is a solid.", "Leave shell and its numbers out, or give a mesh.")
        actor = _enter_recovered(body, *recovered)
        if coarseness > 1.0:
            actor = dataclasses.replace(actor, notes=["as fine as in full, for the force was found with its particles"])
    else:
        vertices, triangles = load_mesh(base_dir / body.mesh)
        size = float(np.ptp(vertices, axis=0).max())
        if size > LARGEST:
            most = f"A body has at most {LARGEST / 1000.0:g} km: check its scale and the unit."
            raise UsageError(f"{body.name} measures {size / 1000.0:.3g} km.", most)
        if sheets.is_shell(body, vertices, triangles):
            return sheets.enter(body, vertices, triangles, base_dir, field.frames, coarseness)
        actor = _enter_mesh(body, vertices, triangles, coarseness)
    if body.free is not None:
        actor = _free(actor, base_dir / body.free)
    return actor if body.pin is None else _pin(actor, base_dir, field.frames)


def _enter_recovered(body: BodyEdit, source: Body, recovery: Recovery) -> Actor:
    material = as_found(source.material, recovery) if body.material is None else find(body.material)
    particles, surface = body_as_found(source.particles, recovery), source.surface
    if body.material is not None:
        particles = dataclasses.replace(particles, mixture=None)  # that material is all of the body's
    velocity = recovery.v0 if body.velocity is None else np.broadcast_to(body.velocity, particles.x.shape)
    rider = Rider(surface.vertices, surface.attachment, particles.x)
    return Actor(
        body, particles, _overridden(material, body, particles), np.array(velocity, dtype=np.float64), rider, surface.triangles, [],
        np.zeros(len(particles.x)), recovery.clamp_depth, recovery.substeps or MIN_SUBSTEPS, _clamp_path(body, particles, recovery),
        borne=np.zeros(3) if recovery.borne is None or body.free is not None else recovery.borne / body.mass_scale,
    )  # fmt: skip


def _clamp_path(body: BodyEdit, particles: Particles, recovery: Recovery) -> np.ndarray | None:
    """Path (T+1, N, 3) [m] along which a clamp that moved in the clip takes the pinned particles; None if the clamp stood still, or if the
    body starts later than the clip."""
    if not recovery.clamp_moves or body.start_frame:
        return None
    return np.where(particles.pinned[:, None], recovery.x, particles.x)


def _enter_mesh(body: BodyEdit, vertices: np.ndarray, triangles: np.ndarray, coarseness: float) -> Actor:
    try:
        filling, coarser = fill_coarser(vertices, triangles, coarseness)
    except UsageError as error:
        raise UsageError(f"{body.name}: {error.message}", error.hint) from error
    particles = filling.particles
    velocity = np.broadcast_to(np.zeros(3) if body.velocity is None else np.asarray(body.velocity), particles.x.shape)
    rider = ride(vertices, particles, np.zeros(0, dtype=int))
    material = _overridden(find(body.material or DEFAULT), body, particles)
    soft = np.zeros(len(particles.x))
    v0 = np.array(velocity, dtype=np.float64)
    return Actor(body, particles, material, v0, rider, triangles, list(filling.notes), soft, coarser=coarser)


def _overridden(material: Material, body: BodyEdit, particles: Particles) -> Material:
    names = ("law", "density", "youngs_modulus", "poisson_ratio", "yield_stress", "viscosity", "loss_factor")
    changed = adjust(material, **{name: getattr(body, name) for name in names})
    density = None if body.mass is None else body.mass / float((particles.volume * particles.relative_density).sum())
    return adjust(changed, density=density, youngs_modulus=changed.youngs_modulus * body.youngs_modulus_scale)


def _free(actor: Actor, path: Path) -> Actor:
    """The recovered object with some of the particles that were pinned in the clip set free."""
    pinned = actor.particles.pinned.copy()
    pinned[read_pins(path, len(pinned), "particles")] = False
    return dataclasses.replace(actor, particles=dataclasses.replace(actor.particles, pinned=pinned))


def _pin(actor: Actor, base_dir: Path, frames: int) -> Actor:
    """The actor with its firm and soft pins: vertex indices for a mesh, particle indices for the recovered object. Firm pins may move."""
    edit, particles, rest = actor.edit, actor.particles, actor.rider.rest
    recovered, path = edit.mesh == "recovered", base_dir / str(edit.pin)
    pins = read_pins(path, len(particles.x) if recovered else len(rest), "particles" if recovered else "vertices")
    weights = np.ones(len(pins)) if edit.pin_weights is None else read_weights(base_dir / edit.pin_weights, path)
    if recovered:
        hold = np.zeros(len(particles.x))
        hold[pins] = weights
    else:
        hold = hold_of(rest, pins, weights, particles)
    pinned = particles.pinned | (hold >= 1.0)
    particles = dataclasses.replace(particles, pinned=pinned)
    velocity = np.where(pinned[:, None], 0.0, actor.velocity)
    firm = weights >= 1.0
    rider, way = actor.rider if recovered else ride(rest, particles, pins[firm]), actor.path
    if edit.pin_path is not None and firm.any():
        way = particle_paths(rest[pins[firm]], read_pin_path(base_dir / edit.pin_path, path, frames)[:, firm], particles)
    return dataclasses.replace(actor, particles=particles, velocity=velocity, rider=rider, soft=np.where(pinned, 0.0, hold), path=way)
