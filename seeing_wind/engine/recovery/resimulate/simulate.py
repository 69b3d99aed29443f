"""Re-simulation: every body of an edit, simulated in a recovered field."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ...conventions import frame_named
from ...errors import SimulationError, UsageError
from ...field.force_field import ForceField
from ...mpm.lattice.closed_mesh import is_closed, weld
from ...mpm.lattice.mesh_collider import MeshCollider
from ...mpm.model import Model
from ...mpm.model_for import model_for
from ...mpm.rollout import advance
from ...mpm.state import State
from ...observe.object.sheet.mesh import edges_of
from ...progress import Journal, NoProgress, Progress
from ...records import Body, Particles, Recovery
from ...settings import Edit
from ..journal import Arrays
from ..wind.motion import Sail, advance_in_wind
from ..wind.surface import BodySurface, mesh_surface
from . import sheets
from .actors import FASTEST, Actor, enter_all
from .forces import read_forces
from .in_field import Surroundings, fields_of
from .obstacles import colliders_of
from .pins import pull_back

MAX_SUBSTEPS = 500
"""Most substeps per frame: as many as a recovery allows for a held body, which must be as stiff here as there."""

MOST_PREROLL = 1000
"""Longest preroll [frames]."""
TORN = 2.0
"""Stretch of an edge beyond which the body may have torn: the solver has no model of fracture, but its particles lose contact."""


@dataclass(frozen=True)
class Simulated:
    """One body after the simulation."""

    vertices: np.ndarray
    """(T+1, V, 3) path of the mesh's vertices [m]."""
    triangles: np.ndarray
    """(M, 3) int32."""
    particles: int
    """Number of particles that represented the body; for a shell, number of vertices."""
    notes: list[str]
    """Notes for the user."""
    shell: bool = False
    """Whether the body was simulated as a shell, with its own vertices, which do not ride on particles."""


def simulate_bodies(
    edit: Edit,
    field: ForceField,
    recovered: tuple[Body, Recovery] | None,
    base_dir: Path,
    progress: Progress = NoProgress(),
    *,
    journal: Journal = Journal(),
) -> dict[str, Simulated]:
    """Move every body of `edit` through `field`, for all frames of the field unless the edit asks for fewer.

    In a force field the acceleration of a particle is strength f(x, t) / (rho mass_scale), evaluated at the start of the frame and held
    over it, with its gradient within the particle's cell, plus the edit's gravity, its further forces and the pull of soft pins. In a wind
    (`field.kind`) the air acts on the body's mesh, see `wind.motion`. The edit's further fields add to the force or to the wind. Outside
    its box a field continues as at the nearest place of the box, as far as the edit allows. With a preroll the bodies of meshes move for
    that many frames before the clip, in the fields of the clip's first frame; the result does not include these frames. With a coarseness
    above one, or fewer frames than the field has, the result is a preview; its notes say which bodies are finer than asked for.

    Args:
        recovered: the clip's own object and its recovery, for a body whose mesh is "recovered".
        base_dir: folder to which the edit's paths are relative.
        journal: keeps the frames simulated so far; its stamp must depend on the field.

    Returns: the simulated bodies by name, in the order of the edit.

    Raises:
        UsageError: for a mesh, pins, a start frame, forces or a strength that do not fit. MaterialError: for an unknown material.
        SimulationError: when the simulation breaks down; the message names the body.
    """
    if not edit.body:
        raise UsageError("The edit has no body.", "Add one with a name and a mesh.")
    around = _surroundings(edit, field, Path(base_dir))
    entered = [_early(one, edit.preroll) for one in enter_all(edit, field, recovered, Path(base_dir))]
    actors = [actor for actor in entered if isinstance(actor, Actor)]
    shells = [[actor] for actor in entered if isinstance(actor, sheets.Hanging)]
    groups: list[Sequence[Actor | sheets.Hanging]] = [*([actors] if edit.contact and actors else [[one] for one in actors]), *shells]
    done: dict[str, Simulated] = {}
    for number, group in enumerate(groups):
        try:
            share = (number / len(groups), 1.0 / len(groups))
            moved = _move_group(group, around, edit, progress, share, journal)
        except SimulationError as error:
            names = ", ".join(actor.edit.name for actor in group)
            where = {key: getattr(error, key) for key in ("frame", "substep", "particle", "quantity")}
            raise SimulationError(f"{names}: {error.message}", error.hint, **where) from error
        for actor, body, x in moved:
            shown = done[actor.edit.name] = _shown(body, x, around, edit)
            for note in shown.notes:
                progress.warn(f"{actor.edit.name}: {note}")
    return {body.name: done[body.name] for body in edit.body}


def _surroundings(edit: Edit, field: ForceField, folder: Path) -> Surroundings:
    """What acts on the bodies of an edit whose paths are relative to `folder`. Raises UsageError for what does not fit the field."""
    if not np.linalg.norm(edit.gravity) <= FASTEST:
        raise UsageError(f"gravity is {edit.gravity}.", f"Give three numbers in m/s², {FASTEST:g} together at most.")
    if not 0 <= edit.preroll <= MOST_PREROLL:
        raise UsageError(f"preroll is {edit.preroll}.", f"Give 0 to {MOST_PREROLL} frames.")
    colliders = colliders_of(edit.collider, folder, field.frames)
    colliders = [one.delayed(edit.preroll) if isinstance(one, MeshCollider) else one for one in colliders]
    forces = None if edit.forces is None else read_forces(folder / edit.forces, field.frames).after(edit.preroll)
    return Surroundings(fields_of(edit, field, folder), edit.gravity, colliders, forces, edit.preroll, edit.coarseness, edit.frames)


def _shown(body: Simulated, x: np.ndarray, around: Surroundings, edit: Edit) -> Simulated:
    """The body without the frames of the preroll, and with the notes on its path x (T+1, N, 3) [m], the worst first."""
    torn, within = _torn_note(body.vertices, body.triangles, edit.preroll), x[edit.preroll :]
    beyond = around.forces.outside_note(within) if around.forces is not None else []
    notes = [*torn, *around.place_notes(within), *beyond, *body.notes, *_short_note(edit.frames, around.field.frames)]
    return dataclasses.replace(body, vertices=body.vertices[edit.preroll :], notes=notes)


def _early(one: Actor | sheets.Hanging, lead: int) -> Actor | sheets.Hanging:
    """The body in a simulation that begins `lead` frames early; the clip's own object and one with a later start frame wait."""
    waits = one.edit.mesh == "recovered" or one.edit.start_frame > 0
    edit = dataclasses.replace(one.edit, start_frame=one.edit.start_frame + lead * waits)
    path = None if one.path is None else np.concatenate([np.repeat(one.path[:1], lead, axis=0), one.path])
    return dataclasses.replace(one, edit=edit, path=path)


def _move_group(
    group: Sequence[Actor | sheets.Hanging], around: Surroundings, edit: Edit, progress: Progress, share: tuple[float, float],
    journal: Journal,
) -> list[tuple[Actor | sheets.Hanging, Simulated, np.ndarray]]:  # fmt: skip
    """Each body of a group with its motion, and the path (T+1, N, 3) [m] of a solid's particles or a shell's vertices."""
    moved: list[tuple[Actor | sheets.Hanging, Simulated, np.ndarray]] = []
    solids = [actor for actor in group if isinstance(actor, Actor)]
    if solids:
        paths, notes = _move(solids, around, progress, *share, journal)
        for actor, x in zip(solids, paths):
            body = Simulated(actor.rider.follow(x), actor.triangles, len(actor.particles.x), [*actor.notes, *notes])
            moved.append((actor, body, x))
    for one in (actor for actor in group if isinstance(actor, sheets.Hanging)):
        x = sheets.move(one, around, progress, *share, journal)
        notes = one.notes
        if edit.contact and len(edit.body) > 1:
            notes = [*notes, "a shell does not push other bodies, and they do not push it"]
        moved.append((one, Simulated(one.follow(x), one.triangles, len(one.shell.mass), notes, shell=True), x))
    return moved


# -- the motion -------------------------------------------------------------------------------------------------------------------


def _move(
    actors: Sequence[Actor], around: Surroundings, progress: Progress, begun: float, share: float, journal: Journal
) -> tuple[list[np.ndarray], list[str]]:
    """Simulate actors that share a grid. Returns the positions (T+1, N, 3) [m] of each, and notes on the solver's choices."""
    ends = np.cumsum([len(actor.particles.x) for actor in actors])
    slices = [slice(end - len(actor.particles.x), end) for actor, end in zip(actors, ends)]
    density = np.concatenate([a.particles.density(a.material) * a.edit.mass_scale for a in actors])
    starts = {actor.edit.start_frame for actor in actors}
    state = State.at_rest(np.concatenate([actor.particles.x for actor in actors]))
    field, further = around.field, _Further.of(actors, around, state.x)
    model, notes = _model(actors, 0, around)
    sails = [_sail(actor, part) for actor, part in zip(actors, slices)]
    history = [state.x]
    told = [
        one for a in actors
        for one in (a.edit, a.particles, a.material, a.velocity, a.soft, a.clamp_depth, a.substeps, a.path, a.borne)
    ]  # fmt: skip
    loop = journal.loop("frames", *around.told(), *told)
    done, kept = loop.resume()
    if done:
        history = list(kept["x"])
        state = State(history[-1], kept["v"], kept["C"], kept["F"])
        model = _model(actors, max(t for t in (0, *starts) if t < done), around)[0]
    for t in range(done, around.frames):
        progress.update(begun + share * t / around.frames, f"frame {t + 1} of {around.frames}: {', '.join(a.edit.name for a in actors)}")
        if t in starts:
            model = _model(actors, t, around)[0]
            state = _release(state, actors, slices, t)
        if t >= min(starts) and around.blows:
            push, added = partial(around.push, t, density), partial(further.added, t)
            state = advance_in_wind(model, state, partial(around.wind, t), sails, t, push, added)
        elif t >= min(starts):
            pushed, gradient = around.push(t, density, state.x)
            state = advance(model, state, further.added(t, state, pushed, 1.0 / field.fps), gradient, frame=t)
        history.append(state.x)
        loop.reached(t + 1, partial(_so_far, history, state))
    path = np.stack(history)
    return [path[:, part] for part in slices], notes


@dataclass(frozen=True)
class _Further:
    """What acts on particles in addition to the field and gravity: the edit's further forces, and soft pins."""

    around: Surroundings
    places: np.ndarray
    """(N, 3) places to which soft pins pull [m]."""
    soft: np.ndarray
    """(N,) weights of the soft pins."""
    whole: np.ndarray
    """(N,) mass of the body to which a particle belongs [kg]."""
    borne: np.ndarray
    """(N, 3) gravity that the particle's body already bears in its initial shape [m/s²]."""

    @classmethod
    def of(cls, actors: Sequence[Actor], around: Surroundings, x: np.ndarray) -> _Further:
        """The further effects on actors whose particles are at x (N, 3) [m] at rest."""
        whole = [np.full(len(a.particles.x), a.particles.mass(a.material) * a.edit.mass_scale) for a in actors]
        borne = np.concatenate([np.broadcast_to(actor.borne, actor.particles.x.shape) for actor in actors])
        return cls(around, x, np.concatenate([actor.soft for actor in actors]), np.concatenate(whole), borne)

    def added(self, frame: int, state: State, acceleration: np.ndarray, duration: float) -> np.ndarray:
        """The given acceleration (N, 3) [m/s²] with all further effects added, constant over a `duration` [s]."""
        acceleration = acceleration - self.borne
        if self.around.forces is not None:
            push = self.around.forces.at(state.x, frame)
            acceleration = acceleration + push.acceleration(state.v, self.whole, duration)
        return acceleration + pull_back(state.x - self.places, state.v, acceleration + self.around.gravity, self.soft, duration)


def _sail(actor: Actor, rows: slice) -> Sail:
    """The actor as the air moves it."""
    surface, relative = _surface(actor), actor.particles.relative_density
    if actor.particles.mixture is None:
        return Sail(surface, rows)
    mean = np.average(relative, weights=actor.particles.volume)
    return Sail(surface, rows, surface.attachment.follow(relative[:, None])[:, 0] / mean)


def _surface(actor: Actor) -> BodySurface:
    """The actor's mesh as the surface on which the air acts: a closed body, or a sheet if the mesh is open."""
    rider = actor.rider
    closed = is_closed(weld(rider.rest, actor.triangles))
    return mesh_surface(rider.rest, actor.triangles, rider.attachment, rider.particles_rest, closed)


def _so_far(history: list[np.ndarray], state: State) -> Arrays:
    return {"x": np.stack(history), "v": state.v, "C": state.C, "F": state.F}


def _model(actors: Sequence[Actor], frame: int, around: Surroundings) -> tuple[Model, list[str]]:
    """The solver's model with all bodies that start after `frame` held, and notes on the solver's choices."""
    particles = [dataclasses.replace(actor.particles, pinned=actor.particles.pinned | (actor.edit.start_frame > frame)) for actor in actors]
    fps, walls = around.field.fps, [one.path for one in around.colliders if isinstance(one, MeshCollider)]
    ways = [np.diff(path, axis=0) * fps for path in (*(actor.path for actor in actors), *walls) if path is not None]
    fastest = max(float(np.linalg.norm(v, axis=-1).max()) for v in (*(actor.velocity for actor in actors), *ways))
    speed = max(5.0, 1.5 * fastest)
    coarser = min(actor.coarser for actor in actors)  # larger cells need fewer substeps for the same stiffness
    model, notes = model_for(
        particles, [a.material for a in actors], fps, gravity=around.gravity, mass_scale=[a.edit.mass_scale for a in actors], speed=speed,
        max_substeps=round(MAX_SUBSTEPS / coarser), least_substeps=math.ceil(max(actor.substeps for actor in actors) / coarser),
        colliders=around.colliders, clamp_depth=max(actor.clamp_depth for actor in actors), pin_path=_pin_path(actors, particles),
    )  # fmt: skip
    return model, notes


def _pin_path(actors: Sequence[Actor], particles: Sequence[Particles]) -> np.ndarray | None:
    """Path (T+1, M, 3) [m] of all particles that are pinned in `particles`; None if all stay at their places."""
    frames = next((len(actor.path) for actor in actors if actor.path is not None), 0)
    if not frames:
        return None
    ways = [np.broadcast_to(a.particles.x, (frames, *a.particles.x.shape)) if a.path is None else a.path for a in actors]
    return np.concatenate([way[:, one.pinned] for way, one in zip(ways, particles)], axis=1)


def _release(state: State, actors: Sequence[Actor], slices: Sequence[slice], frame: int) -> State:
    """The state with the initial velocity of every body that starts in this frame."""
    v = state.v.copy()
    for actor, part in zip(actors, slices):
        if actor.edit.start_frame == frame:
            v[part] = actor.velocity
    return State(state.x, v, state.C, state.F)


def _short_note(asked: int | None, frames: int) -> list[str]:
    """A note if more frames were asked for than a field has."""
    return [f"frames is {asked}, but the field has {frames}: only these are simulated"] if asked is not None and asked > frames else []


def _torn_note(vertices: np.ndarray, triangles: np.ndarray, lead: int) -> list[str]:
    """A note if an edge of the surface grew to more than `TORN` times its length; vertices: (lead + T + 1, V, 3) [m]."""
    edges = edges_of(triangles)
    length = np.linalg.norm(vertices[:, edges[:, 0]] - vertices[:, edges[:, 1]], axis=-1)
    # The median sets a lower bound: an edge that starts with almost no length would look torn.
    worst = (length / np.maximum(length[0], 0.25 * np.median(length[0]))).max(axis=1)
    if worst.max() <= TORN:
        return []
    first = frame_named(max(int(np.argmax(worst > TORN)) - lead, 0))
    return [f"stretched to {worst.max():.1f} times its size, from {first} on, and may have torn: a higher Young's modulus holds it"]
