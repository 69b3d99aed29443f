"""The solve of the stage *recover*: from what was observed to the force that explains it."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from ..conventions import NO_GRAVITY
from ..errors import ObjectError, UsageError
from ..field.torch_threads import one_torch_thread
from ..materials import LIMITS, PLASTIC_LAWS, Material
from ..mpm.model import Model
from ..mpm.model_for import model_for
from ..progress import Journal, Progress
from ..records import Particles, PointTargets, Recovery, TrackTargets
from ..settings import RecoverSettings
from .clip import Clip, Foresee, still_frames, unforeseen
from .diagnostics.remarks import BORNE, DRAFTED, moving_clamp_remark, ringing_remarks
from .solve.constants import PACE
from .solve.known_body import KnownBody
from .solve.stiffness import Stiffness, is_free, youngs_modulus
from .targets.channels import check_free, views_of
from .targets.clamp_motion import clamp_motion
from .targets.objective import Channels, Objective
from .targets.points import PointChannels, point_channels
from .targets.ringing import alone
from .targets.tracks import track_channels
from .targets.weight import bears_weight


@one_torch_thread()
def recover(
    particles: Particles,
    material: Material,
    targets: PointTargets | Sequence[TrackTargets],
    fps: float,
    settings: RecoverSettings,
    progress: Progress,
    journal: Journal = Journal(),
    known: KnownBody | None = None,
    foresee: Foresee = unforeseen,
) -> Recovery:
    """Find the force density that makes the simulated body move as observed.

    Args:
        material: constants of the material; its density, and that of parts with their own, turns accelerations into force densities.
        targets: points in 3D [m], or tracks [px] of one or several cameras over the same frames.
        fps: frames per second.
        journal: keeps intermediate results; its stamp must depend on all other arguments.
        known: stiffness and clamp of the body from another clip.
        foresee: the duration of the solve, told again where the body strays.

    Returns:
        The force density on the particles per frame, its posterior deviation, and the simulated motion; notes name what is poorly known.

    Raises:
        UsageError: for targets that contradict each other, or are not finite where visible; for still frames that the clip does not have;
            for a known body if this one is not held.
        ObjectError: for fewer than three frames, a body that cannot be simulated (all held, particles in one place), or points that no
            force explains.
        SimulationError: when the simulation breaks down even at the start. MaterialError: for a law that the solver does not have.
    """
    began = time.monotonic()
    check_body(particles, fps)
    progress.update(0.0, "Preparing the body")
    plastic = material.law in PLASTIC_LAWS
    sources = views_of(targets)
    check_free(particles.pinned, sources)
    moving = clamp_motion(particles, targets, fps) if isinstance(targets, PointTargets) else None
    if moving is not None:
        sources = [moving.in_clamp_frame(one) for one in sources if isinstance(one, PointTargets)]
    channels = [channels_of(particles, one, plastic) for one in sources]
    notes = [DRAFTED] if settings.iterations == 1 else []
    notes += [] if moving is None else [moving_clamp_remark(moving)]
    model, model_notes = _model(particles, material, channels, fps, settings, plastic)
    objective, borne = Objective(channels), None
    if any(settings.gravity) and particles.pinned.any() and not plastic and bears_weight(model, particles.x, objective):
        borne, settings, model = np.array(settings.gravity), replace(settings, gravity=NO_GRAVITY), replace(model, gravity=np.zeros(3))
        notes.append(BORNE)
    if moving is not None:
        model = replace(model, gravity=moving.gravity(particles, model.gravity))
    still, said = _still(particles, sources, settings, plastic)
    notes += said
    believed = _stiffness(particles, model, channels, settings, known)
    clip = Clip(particles, model, objective, fps, settings, progress, journal, notes + model_notes, believed, still, foresee)
    views = len(sources) if isinstance(sources[0], TrackTargets) else 0
    kept = clip.solve_blocks()
    if clip.stiffness.known and clip.stiffness.s < 0.0:  # the notes so far are about a body as stiff as the given material
        softer = replace(material, youngs_modulus=youngs_modulus(model, particles, clip.stiffness.s))
        clip.notes[len(notes) : len(notes) + len(model_notes)] = _model(particles, softer, channels, fps, settings, plastic)[1]
    found = replace(clip.result(kept, material, views, began), borne=borne)
    return found if moving is None else moving.to_world(found, particles.density(material), np.asarray(settings.gravity), model.gravity)


def channels_of(particles: Particles, seen: PointTargets | TrackTargets, plastic: bool) -> Channels:
    """The channels of points in 3D or of one camera's tracks."""
    if isinstance(seen, PointTargets):
        return point_channels(particles, seen, plastic)
    return track_channels(particles, seen, plastic)


def _model(
    particles: Particles, material: Material, channels: Sequence[Channels], fps: float, settings: RecoverSettings, plastic: bool
) -> tuple[Model, list[str]]:
    """The solver's model of the body, stable at the speeds that 3D points were seen to have, and notes on what the model had to change."""
    seen = [one.targets for one in channels if isinstance(one, PointChannels)]
    speed = min([LIMITS.default_speed, *(PACE.haste * _fastest(one, fps) for one in seen)])
    model, notes = model_for(particles, material, fps, gravity=settings.gravity, clamp_depth=settings.clamp_depth, speed=speed)
    if not particles.pinned.any() or plastic:
        return model, notes
    # A held body gets more substeps if its 3D points swing far.
    times = max((refinement(one, model.dx, model.frame_dt, model.substeps) for one in seen), default=1.0)
    return (replace(model, substeps=math.ceil(times * model.substeps), refined=times) if times > 1.0 else model), notes


def _still(
    particles: Particles, sources: Sequence[PointTargets | TrackTargets], settings: RecoverSettings, plastic: bool
) -> tuple[np.ndarray, list[str]]:
    """(T,) bool: the frames without a force, as given, or else those in which a held body rings; and notes on the latter.

    A body on which gravity acts from the shape of frame 0 on sags in the simulation, so it would not ring about that shape.
    """
    given = still_frames(settings, len(sources[0].visible) - 1)
    if settings.still is not None or settings.ringing == "ignored" or not particles.pinned.any() or plastic or any(settings.gravity):
        return given, []
    found = alone(sources)
    return found, ringing_remarks(found)


def _stiffness(
    particles: Particles, model: Model, channels: Sequence[Channels], settings: RecoverSettings, known: KnownBody | None
) -> Stiffness:
    """The prior of the stiffness. Raises UsageError for a known body if this one is not held."""
    free = is_free(particles, settings)
    if known is None:
        return Stiffness.unknown(free, all(isinstance(one, PointChannels) and len(one.points) == len(particles.x) for one in channels))
    if not particles.pinned.any():
        raise UsageError("--body is for a held body; this one is free.", "Leave it out, or mark what is held.")
    return known.stiffness_of(particles, model, free)


def refinement(targets: PointTargets, dx: float, frame_dt: float, substeps: int) -> float:
    """Factor on the substeps of a held elastic body, on a grid with cells of dx [m] and in frames of frame_dt [s]."""
    away = np.linalg.norm(targets.x - targets.x[0], axis=2)
    if np.where(targets.visible & targets.visible[0], away, 0.0).max() <= PACE.held_far * dx:
        return 1.0
    return max(1.0, min(PACE.held_substeps * frame_dt / substeps, PACE.held_refined))


def _fastest(targets: PointTargets, fps: float) -> float:
    """Speed [m/s] of the fastest point between two consecutive frames that both show it."""
    step = np.linalg.norm(np.diff(targets.x, axis=0), axis=2)
    return fps * float(np.where(targets.visible[1:] & targets.visible[:-1], step, 0.0).max(initial=0.0))


def check_body(particles: Particles, fps: float) -> None:
    """Raise UsageError or ObjectError for a body or frame rate that cannot be simulated."""
    if not (np.isfinite(particles.x).all() and np.isfinite(particles.volume).all() and (particles.volume > 0.0).all()):
        raise ObjectError("A particle of the body has no finite position or no volume.", "Build the body again.")
    if not 0.0 < particles.spacing < np.inf:
        raise ObjectError(f"The particles' spacing is {particles.spacing} m.", "Build the body again.")
    if particles.pinned.all():
        raise ObjectError("All particles of the body are held: nothing can move.", "Paint a smaller region, or mark fewer as fixed.")
    if not fps > 0.0:
        raise UsageError(f"{fps} frames per second.", "Give the clip's frame rate with --fps.")
    if len(particles.x) > 1:
        distance = cKDTree(particles.x).query(particles.x, k=2)[0][:, 1]
        if (distance < 1e-3 * particles.spacing).any():
            raise ObjectError("Some particles of the body are in the same place as another.", "Give each a place of its own.")
