"""From what was seen to the force that explains it: the stage *recover*.

A clip is solved in windows that overlap (`window`): the cost grows with its length, the memory of the solve does not. Each window starts
from the state that the one before reached well before its end, and solves what lay after that once more.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from ..errors import ObjectError, UsageError
from ..field.torch_threads import one_torch_thread
from ..mpm.laws.constitutive import LAWS
from ..mpm.model import Model
from ..mpm.model_for import DEFAULT_SPEED, model_for
from ..mpm.state import Trajectory
from ..progress import Journal, Progress
from ..records import Material, Outcome, Particles, PointTargets, Recovery, TrackTargets
from ..settings import RecoverSettings
from .diagnostics.posterior import missed_acceleration, posterior_deviation, unseen_variation
from .diagnostics.remarks import (
    astray,
    force_remarks,
    held_remarks,
    motion_remarks,
    moving_clamp_remark,
    reaction_remarks,
    wild_remarks,
)
from .prior.basis import SpatialBasis, spatial_basis
from .prior.learning import Expected
from .solve.stiffness import Stiffness, covariance_with, is_free, remark, scaled, youngs_modulus
from .solve.window import FULL_KNOT, Found, WindowSolver
from .targets.clamp_motion import clamp_motion
from .targets.objective import Channels, Objective
from .targets.points import PointChannels, point_channels
from .targets.tracks import TrackChannels, track_channels

FULL_MODES = 16
OBSERVABLE = 0.1
"""A mode is used when the observed points see at least this share of it that the modes before it do not explain."""
SLOWEST = 0.03
"""Least standard deviation of the initial velocity [m/s]; more when the first pictures show more, along the view as across it."""
AXIAL_SHRINK = 0.2
"""Prior size of the force along a held body, relative to across it: hardly seen, and it soaks up the error of the clamp."""
RAY_SHRINK = 0.03
"""The same along the view, of a body that one camera sees as a point."""
UNSEEN_SPIN = 1e-3
"""Prior size of the initial spin of a body that is seen as a point, relative to the one that its speed suggests: nothing tells of it, and
a track a little off the centre of mass would set it turning."""
HASTE = 3.0
"""How much faster than the points were seen to move the simulated body may have to be followed."""
WINDOW, OVERLAP = 32, 8
"""Most frames that are solved together, and those of them that the next window solves again."""


@one_torch_thread()
def recover(
    particles: Particles,
    material: Material,
    targets: PointTargets | Sequence[TrackTargets],
    fps: float,
    settings: RecoverSettings,
    progress: Progress,
    journal: Journal = Journal(),
) -> Recovery:
    """Find the force density that makes the simulated body move as observed.

    Args:
        particles: the body at rest, at picture 0.
        material: its constants; the density turns accelerations into force densities.
        targets: points in 3D [m], or tracks [px] of one or several cameras over the same pictures.
        fps: pictures per second.
        settings: gravity, and the number of iterations at most.
        progress: told of every part of the work; asked for cancelling at least twice a second.
        journal: keeps what is found on the way; its stamp must tell all other arguments.

    Returns:
        The force density on the particles per frame, its posterior deviation, and the simulated motion; notes name what is poorly known.

    Raises:
        UsageError: targets that contradict each other, or are not finite where visible.
        ObjectError: fewer than three pictures, a body that cannot be simulated (all held, particles in one place), or points that no
            force explains.
        SimulationError: when the simulation breaks down even at the start.
        Cancelled: when the user asked to stop.
    """
    began = time.monotonic()
    _check(particles, fps)
    progress.update(0.0, "Preparing the body")
    plastic = material.law in ("von_mises", "viscoplastic")
    sources: list[PointTargets | TrackTargets] = [targets] if isinstance(targets, PointTargets) else list(targets)
    if len({len(one.visible) for one in sources}) != 1:
        raise UsageError("The views do not have the same number of pictures.", "Cut the clips to the same frames, or give one clip.")
    if not any(one.visible[1:].any() for one in sources):
        raise ObjectError("Nothing of the object is seen after the first picture.", "Check the mask, or give more pictures of it.")
    moving = clamp_motion(particles, targets, fps) if isinstance(targets, PointTargets) else None
    if moving is not None:
        sources = [moving.stilled(one) for one in sources if isinstance(one, PointTargets)]
    channels: list[Channels] = []
    for one in sources:
        if isinstance(one, PointTargets):
            channels.append(point_channels(particles, one, plastic))
        else:
            channels.append(track_channels(particles, one, plastic))
    notes = [] if moving is None else [moving_clamp_remark(moving)]
    if material.law not in LAWS:
        notes.append(f"{material.name}: the solver has no law {material.law}; the force was recovered as if the body were elastic.")
        material = replace(material, law="corotated")
    model, model_notes = model_for(
        particles, material, fps, gravity=settings.gravity, device=settings.device, clamp_depth=settings.clamp_depth,
        speed=min([DEFAULT_SPEED, *(HASTE * _fastest(one.targets, fps) for one in channels if isinstance(one, PointChannels))]),
    )  # fmt: skip
    if moving is not None:
        model = replace(model, gravity=moving.gravity(particles, model.gravity))
    stiffness = Stiffness(free=is_free(particles, model, settings))
    clip = _Clip(particles, model, Objective(channels), fps, settings, progress, journal, notes + model_notes, stiffness)
    views = len(sources) if isinstance(sources[0], TrackTargets) else 0
    found = clip.result(clip.solved(), material, views, began)
    return found if moving is None else moving.carried(found, material.density, np.asarray(settings.gravity), model.gravity)


def _fastest(targets: PointTargets, fps: float) -> float:
    """Speed [m/s] of the fastest point between pictures that both show it."""
    step = np.linalg.norm(np.diff(targets.x, axis=0), axis=2)
    return fps * float(np.where(targets.visible[1:] & targets.visible[:-1], step, 0.0).max(initial=0.0))


def _check(particles: Particles, fps: float) -> None:
    if not (np.isfinite(particles.x).all() and np.isfinite(particles.volume).all() and (particles.volume > 0.0).all()):
        raise ObjectError("A particle of the body has no finite position or no volume.", "Build the body again.")
    if not 0.0 < particles.spacing < np.inf:
        raise ObjectError(f"The particles' spacing is {particles.spacing} m.", "Build the body again.")
    if particles.pinned.all():
        raise ObjectError("All particles of the body are held: nothing can move.", "Paint a smaller region, or mark fewer as fixed.")
    if not fps > 0.0:
        raise UsageError(f"{fps} pictures per second.", "Give the clip's frame rate with --fps.")
    if len(particles.x) > 1:
        distance = cKDTree(particles.x).query(particles.x, k=2)[0][:, 1]
        if (distance < 1e-3 * particles.spacing).any():
            raise ObjectError("Some particles of the body are in the same place as another.", "Give each a place of its own.")


def windows(frames: int) -> list[tuple[int, int]]:
    """First and last picture of each window; they are equally long, and neighbours share OVERLAP frames."""
    count = 1 if frames <= WINDOW else math.ceil((frames - OVERLAP) / (WINDOW - OVERLAP))
    hop = (frames - OVERLAP) / count if count > 1 else frames
    return [(round(hop * k), min(frames, round(hop * (k + 1)) + (OVERLAP if count > 1 else 0))) for k in range(count)]


@dataclass(frozen=True)
class _Kept:
    """What a window adds to the clip: the frames before the next one begins."""

    acceleration: np.ndarray
    deviation: np.ndarray
    trajectory: Trajectory
    """Up to the next window's first picture."""
    iterations: int
    converged: bool
    knot_spacing: float
    """Frames."""
    stiffness: Stiffness


@dataclass
class _Clip:
    """All windows of one recovery."""

    particles: Particles
    model: Model
    objective: Objective
    fps: float
    settings: RecoverSettings
    progress: Progress
    journal: Journal
    notes: list[str]
    stiffness: Stiffness
    """Free until a window told it."""

    def solved(self) -> list[_Kept]:
        """The windows one after the other."""
        basis = self._observable(spatial_basis(self.particles.x, self.model.mass * ~self.particles.pinned, FULL_MODES))
        expected = self._expected(len(basis.degree))
        kept: list[_Kept] = []
        cuts = windows(self.objective.frames)
        done = 0.0
        while len(kept) < len(cuts):
            part = len(kept)
            begin, end = cuts[part]
            # A later window that tells the stiffness sends the solve back to the first.
            share = (1.0 - done) / (len(cuts) - part + (len(cuts) if part and self.stiffness.free else 0))

            def tell(fraction: float, what: str, residual: float | None, part: int = part, at: float = done, share: float = share) -> None:
                where = f" (part {part + 1} of {len(cuts)})" if len(cuts) > 1 else ""
                figures = {} if residual is None or not np.isfinite(residual) else {"residual": round(residual, 3)}
                self.progress.update(at + share * fraction, what + where, **figures)

            start = kept[-1].trajectory.state(-1) if kept else None
            solver = WindowSolver(
                self.particles, self.model.from_frame(begin), self.objective.between(begin, end), basis, expected, start,
                self.settings.iterations, self.progress, tell, self.stiffness, journal=self.journal,
            )  # fmt: skip
            frames = cuts[part + 1][0] - begin if part + 1 < len(cuts) else end - begin
            found = self.journal.once("window", _Kept, partial(_solved, solver, frames), begin, end, start, self.stiffness)
            done += share
            if self.stiffness.free:
                self.stiffness = found.stiffness.settled() if found.stiffness.known else found.stiffness
                if part and self.stiffness.known:  # it is one body through the whole clip, and the windows so far were solved for another
                    kept = []
                    continue
            if found.knot_spacing > FULL_KNOT and not part:
                self.notes.append(f"The force has a knot every {found.knot_spacing:.0f} frames: faster gusts are smoothed.")
            kept.append(found)
        return kept

    def _observable(self, basis: SpatialBasis) -> SpatialBasis:
        """The modes that the observed points can tell apart; the constant one always."""
        seen = self.objective.points() @ basis.phi
        count, known = 1, seen[:, :1] / np.linalg.norm(seen[:, :1])
        while count < basis.phi.shape[1]:
            rest = seen[:, count] - known @ (known.T @ seen[:, count])
            if np.linalg.norm(rest) < OBSERVABLE * np.sqrt(len(seen)):
                break
            known = np.column_stack([known, rest / np.linalg.norm(rest)])
            count += 1
        if count < min(4, basis.phi.shape[1]):
            self.notes.append(
                f"The observed points tell apart {count} of the force's modes over the body: its variation across the body is not known."
            )
        return basis.first(count)

    def _expected(self, modes: int) -> Expected:
        """Sizes before anything is solved: of the field, what was observed or what holds gravity up; of the initial velocity."""
        observed = max(one.acceleration(self.particles.x, self.fps) for one in self.objective.channels)
        size = float(np.hypot(observed, np.linalg.norm(self.settings.gravity))) or 1e-3
        component = self._first_component(modes)
        speed = max([SLOWEST, *(one.speed(self.particles.x, self.fps) for one in self.objective.channels)])
        axes = np.sqrt(np.diag(component))  # uniform x y z, then the spins round x y z
        first = speed * np.resize(axes, 3 if self.particles.pinned.any() else 6)
        if modes == 1:
            first[3:] *= UNSEEN_SPIN
        return Expected(size, first, component)

    def _first_component(self, modes: int) -> np.ndarray:
        """(3, 3) covariance of the force's components before anything is learnt: round, but flat along what the data cannot show.

        That is a held body's axis, and the view of one camera that sees a body as a mere point: no change of size tells its depth. The
        camera's axis, not the ray to the body, which turns as the body crosses the picture: the scale is that of a plane of the picture.
        """
        pinned, channels = self.particles.pinned, self.objective.channels
        if pinned.any():
            axis, shrink = self.particles.x[~pinned].mean(axis=0) - self.particles.x[pinned].mean(axis=0), AXIAL_SHRINK
        elif modes == 1 and len(channels) == 1 and isinstance(channels[0], TrackChannels):
            axis, shrink = channels[0].camera.pose(0)[:3, 2], RAY_SHRINK
        else:
            return np.eye(3)
        axis = axis / max(float(np.linalg.norm(axis)), 1e-12)
        return np.eye(3) - (1.0 - shrink**2) * np.outer(axis, axis)

    def result(self, kept: list[_Kept], material: Material, views: int, began: float) -> Recovery:
        """What the windows add up to."""
        x = np.concatenate([one.trajectory.x[:-1] for one in kept] + [kept[-1].trajectory.x[-1:]])
        F = np.concatenate([one.trajectory.F[:-1] for one in kept] + [kept[-1].trajectory.F[-1:]])
        residual = self.objective.root_mean_square(x)
        lost = astray(self.particles, self.objective.channels, x, residual)
        if lost and not views:
            raise ObjectError(lost, "Check the unit of the points, their order, fps and the material; cut the file where the body jumps.")
        self.notes += motion_remarks(self.particles, x, residual, views) + held_remarks(self.particles, self.objective.channels)
        self.notes += wild_remarks(self.objective.channels)
        acceleration = np.concatenate([one.acceleration for one in kept])
        if not self.particles.pinned.any():
            self.notes += force_remarks(acceleration, material.density, x, self.fps, self.settings.gravity)
        self.notes[:0] = reaction_remarks(self.particles, acceleration, x, self.settings.gravity)
        if lost:
            self.notes.insert(0, f"{lost} Do not use this field: check the outline, the tracks and the scale.")
        deviation = np.concatenate([one.deviation for one in kept])
        for one in self.objective.channels:
            if isinstance(one, PointChannels):
                deviation = np.hypot(deviation, missed_acceleration(one.targets, x, self.fps)[:, None])
        self.notes += remark(self.stiffness, self.model)
        return Recovery(
            outcome=Outcome.CONVERGED if all(one.converged for one in kept) else Outcome.MAX_ITERATIONS,
            force_density=material.density * acceleration,
            deviation=material.density * deviation,
            x=x,
            F=F,
            v0=kept[0].trajectory.v[0],
            residual=residual,
            residual_unit="px" if views else "m",
            iterations=sum(one.iterations for one in kept),
            seconds=time.monotonic() - began,
            notes=self.notes,
            youngs_modulus=youngs_modulus(self.model, self.stiffness.s) if self.stiffness.known else None,
            stiffness_deviation=self.stiffness.deviation if self.stiffness.known else None,
            stiffness=self.stiffness.spread(self.particles) if self.stiffness.known else None,
            clamp_depth=self.settings.clamp_depth + self.stiffness.deeper,
            substeps=scaled(self.model, self.stiffness.s).substeps,
        )


def _solved(solver: WindowSolver, frames: int) -> _Kept:
    return _keep(solver.run(), frames)


def _keep(found: Found, frames: int) -> _Kept:
    """The first frames of a window's solution, with the posterior deviation."""
    # What was only assumed of stretch is not known: the deviation leaves that assumption out.
    covariance = covariance_with(found.last.point.normal + replace(found.prior, stretch=None).precision(), found.joint)
    path, acceleration = found.trajectory, found.forward.acceleration(found.last.theta)[:frames]
    deviation = posterior_deviation(found.forward, covariance)[:frames]
    if found.forward.shape[1] == 1:
        deviation = np.hypot(deviation, unseen_variation(acceleration))
    return _Kept(
        acceleration,
        deviation,
        Trajectory(path.x[: frames + 1], path.v[: frames + 1], path.C[: frames + 1], path.F[: frames + 1], path.substeps[:frames]),
        found.iterations,
        found.last.converged,
        found.forward.knot_spacing,
        found.stiffness,
    )
