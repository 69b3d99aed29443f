"""From what was seen to the force that explains it: the stage *recover*.

Coarse to fine, because a body that turns makes the problem curved: follow the targets with a receding horizon, solve the whole clip with
few modes and sparse knots, learn the prior's sizes, then solve with all modes the data can tell apart (Gauss-Newton through the simulator).
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from ..errors import ObjectError, UsageError
from ..mpm.constitutive import LAWS
from ..mpm.model import Model, model_for
from ..mpm.state import Trajectory
from ..progress import Progress
from ..records import Material, Outcome, Particles, PointTargets, Recovery, TrackTargets
from ..settings import RecoverSettings
from .basis import SpatialBasis, hats, spatial_basis, velocity_basis
from .channels import TrackChannels, point_channels, track_channels
from .forward import Forward
from .gauss_newton import TOLERANCE, Linearisation, Solution, solve
from .objective import Channels, Objective
from .posterior import posterior_deviation
from .prior import Prior, first_prior, learn
from .warm_start import warm_start

COARSE_DEGREE, COARSE_KNOT = 2, 4.0
"""Degree of the modes and frames between knots of the first whole-clip solve."""
FULL_MODES, FULL_KNOT = 16, 2.0
COARSE_ITERATIONS, FINE_ITERATIONS = 1, 2
"""Jacobians at most; settings.iterations may lower them. Few are needed: each serves several chord steps."""
OBSERVABLE = 0.1
"""A mode is used when the observed points see at least this share of it that the modes before it do not explain."""
SLOWEST = 0.03
"""Least standard deviation of the initial velocity [m/s]; more when the first pictures show more, along the view as across it."""
AXIAL_SHRINK = 0.2
"""Prior size of the force along a held body, relative to across it: hardly seen, and it soaks up the error of the clamp."""
RAY_SHRINK = 0.03
"""The same along the ray of a body that one camera sees as a point."""
STILL = 0.02
"""A body whose observed points move less than this share of its radius hardly moves [m/m]."""
COARSE_TOLERANCE = 0.1
"""A coarse solve has done its work when a step promises less than this share of the cost: the fine one goes on from there."""
SEGMENT = 16
"""Frames by which the followed part of the clip grows."""
SEGMENT_ITERATIONS = 1
ROUGH = 0.5
"""Substeps of the rough model relative to the fine one's; the fine one's are chosen with a margin of three."""
UNKNOWNS = 640
"""Most unknowns of the dense solve; longer clips get sparser knots, then fewer modes."""


def recover(
    particles: Particles,
    material: Material,
    targets: PointTargets | Sequence[TrackTargets],
    fps: float,
    settings: RecoverSettings,
    progress: Progress,
) -> Recovery:
    """Find the force density that makes the simulated body move as observed.

    Args:
        particles: the body at rest, at picture 0.
        material: its constants; the density turns accelerations into force densities.
        targets: points in 3D [m], or tracks [px] of one or several cameras over the same pictures.
        fps: pictures per second.
        settings: gravity, and the number of iterations at most.
        progress: told of every part of the work; asked for cancelling at least twice a second.

    Returns:
        The force density on the particles per frame, its posterior deviation, and the simulated motion; notes name what is poorly known.

    Raises:
        UsageError: targets that contradict each other, or are not finite where visible.
        ObjectError: fewer than three pictures, or a body that cannot be simulated (all held, particles in one place).
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
    channels: list[Channels] = []
    for one in sources:
        if isinstance(one, PointTargets):
            channels.append(point_channels(particles, one, plastic))
        else:
            channels.append(track_channels(particles, one, plastic))
    notes: list[str] = []
    if material.law not in LAWS:
        notes.append(f"{material.name}: the solver has no law {material.law}; the force was recovered as if the body were elastic.")
        material = replace(material, law="corotated")
    model, model_notes = model_for(particles, material, fps, gravity=settings.gravity, device=settings.device)
    solver = _Solver(particles, model, Objective(channels), fps, settings, progress, notes + model_notes)
    return solver.run(material, len(sources) if isinstance(sources[0], TrackTargets) else 0, began)


def _check(particles: Particles, fps: float) -> None:
    if not (np.isfinite(particles.x).all() and np.isfinite(particles.volume).all() and (particles.volume > 0.0).all()):
        raise ObjectError("A particle of the body has no finite position or no volume.", "Build the body again.")
    if particles.pinned.all():
        raise ObjectError("All particles of the body are held: nothing can move.", "Paint a smaller region to hold.")
    if not fps > 0.0:
        raise UsageError(f"{fps} pictures per second.", "Give the clip's frame rate with --fps.")
    if len(particles.x) > 1:
        distance = cKDTree(particles.x).query(particles.x, k=2)[0][:, 1]
        if (distance < 1e-3 * particles.spacing).any():
            raise ObjectError("Some particles of the body are in the same place as another.", "Build the body again.")


@dataclass
class _Solver:
    """One recovery on its way from a rough start to the final solve."""

    particles: Particles
    model: Model
    objective: Objective
    fps: float
    settings: RecoverSettings
    progress: Progress
    notes: list[str]

    def run(self, material: Material, views: int, began: float) -> Recovery:
        """All parts in order; `views` is the number of cameras, 0 for points in 3D."""
        frames = self.objective.frames
        basis = self._observable(spatial_basis(self.particles.x, self.model.mass * ~self.particles.pinned, FULL_MODES))
        coarse, prior, theta, used = self._grow(basis)
        left = self.settings.iterations
        first = self._solve(coarse, prior, theta, min(left, COARSE_ITERATIONS), (0.3, 0.45), "Solving coarsely", tolerance=COARSE_TOLERANCE)
        prior = learn(prior, first.point.normal, first.pull)[0]

        self.objective = self.objective.reweighted(self.objective.residual(coarse.positions(first.theta[None]))[0])
        fine = self._forward(basis, self._knot(basis, FULL_KNOT), frames)
        prior = prior.reshaped(basis, frames, fine.knot_spacing)
        theta = fine.pack(coarse.per_frame(first.theta), first.theta[coarse.size :])
        prior = self._turning(prior, fine, theta)
        left = max(1, left - first.iterations)
        second = self._solve(fine, prior, theta, min(left, FINE_ITERATIONS), (0.45, 0.8), "Solving finely")
        prior = learn(prior, second.point.normal, second.pull)[0]
        left = min(1, max(0, left - second.iterations))
        last = self._solve(fine, prior, second.theta, left, (0.8, 0.98), "Solving with what was learnt", point=second.point)
        return self._result(fine, prior, last, material, views, used + first.iterations + second.iterations + last.iterations, began)

    def _grow(self, basis: SpatialBasis) -> tuple[Forward, Prior, np.ndarray, int]:
        """A coarse field that keeps the simulation near the targets through the whole clip, found a segment at a time.

        In each segment the receding horizon leads on from the simulation so far; then its knots and those shortly before it are solved.
        Returns forward model, prior, unknowns, and the Jacobians used.
        """
        frames, size = self.objective.frames, self._expected_size()
        modes, affine = basis.up_to(COARSE_DEGREE), basis.up_to(1)
        knot = self._knot(modes, COARSE_KNOT)
        parts = math.ceil(frames / SEGMENT)
        ends = [round(frames * (part + 1) / parts) for part in range(parts)]
        leader, found, used = self._forward(affine, 1.0, frames), np.zeros((0, modes.phi.shape[1], 3)), 0
        forward, theta, velocity = self._forward(modes, knot, frames), np.zeros(0), np.zeros(0)
        component = self._first_component(len(basis.degree))
        axes = np.sqrt(np.diag(component))
        speed = self._expected_speed() * np.resize(axes, len(forward.velocity))  # uniform x y z, then the spins round x y z
        for part, end in enumerate(ends):
            begin = len(found)
            self.progress.update(0.02 + 0.28 * part / parts, f"Following the object, frame {begin} to {end} of {frames}")
            state = forward.trajectory(theta).state(begin) if begin else None
            led = warm_start(leader, self.objective, size * axes, speed, state, begin, end)
            velocity = velocity if begin else led.velocity
            fresh = np.zeros((end - begin, *found.shape[1:]))
            fresh[:, : affine.phi.shape[1]] = led.coefficients
            found = np.concatenate([found, fresh])
            forward = self._forward(modes, knot, end)
            prior = first_prior(modes, end, knot, max(_rms(found[:, 0]), 0.05 * size), len(velocity), speed)
            prior = replace(prior, component=component)
            theta = forward.pack(found, velocity)
            prior = self._turning(prior, forward, theta)
            if end < frames:
                settled = begin - SEGMENT / 2
                open_knots = np.repeat(knot * np.arange(forward.shape[0]) >= settled, forward.size // forward.shape[0])
                active = np.concatenate([open_knots, np.full(len(velocity), settled <= 0)])
                share = 0.02 + 0.28 * part / parts
                solved = self._solve(forward, prior, theta, SEGMENT_ITERATIONS, (share, share), "Following the object", active)
                theta, used = solved.theta, used + solved.iterations
                found, velocity = forward.per_frame(theta), theta[forward.size :]
        return forward, prior, theta, used

    def _turning(self, prior: Prior, forward: Forward, theta: np.ndarray) -> Prior:
        """The prior with what it believes of stretch, on the body as it lies under theta."""
        one_camera = len(self.objective.channels) == 1 and isinstance(self.objective.channels[0], TrackChannels)
        return prior.turning(forward.basis, forward.x, forward.trajectory(theta, forward.rough).F, forward.knot_spacing, one_camera)

    # -- parts ----------------------------------------------------------------------------------------------------------------

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

    def _expected_size(self) -> float:
        """Root mean square acceleration [m/s²] to expect of the field: the observed one, or what holds gravity up."""
        observed = max(one.acceleration(self.particles.x, self.fps) for one in self.objective.channels)
        return float(np.hypot(observed, np.linalg.norm(self.model.gravity))) or 1e-3

    def _expected_speed(self) -> float:
        """Standard deviation of the initial velocity [m/s]."""
        return max([SLOWEST, *(one.speed(self.particles.x, self.fps) for one in self.objective.channels)])

    def _forward(self, basis: SpatialBasis, knot: float, frames: int) -> Forward:
        velocity, gradient = velocity_basis(self.particles.x, basis, self.particles.pinned)
        rough = replace(self.model, substeps=math.ceil(ROUGH * self.model.substeps))
        return Forward(self.model, rough, self.particles.x, basis, hats(frames, knot), knot, velocity, gradient, self.progress)

    def _knot(self, basis: SpatialBasis, wanted: float) -> float:
        """Frames between knots: COARSE_KNOT, or a whole fraction or multiple of it, so that a field on coarse knots is one on finer too.

        Sparser than wanted when a long clip would make the dense solve too large.
        """
        affordable = 3.0 * basis.phi.shape[1] * self.objective.frames / UNKNOWNS
        knot = wanted
        while knot < affordable:
            knot *= 2.0
        if knot > wanted and wanted == FULL_KNOT:
            self.notes.append(f"Long clip: the force has a knot every {knot:.0f} frames, not {wanted:.0f}: fast gusts are smoothed.")
        return knot

    def _first_component(self, modes: int) -> np.ndarray:
        """(3, 3) covariance of the force's components before anything is learnt: round, but flat along what the data cannot show.

        That is a held body's axis, and the ray on which one camera sees a body as a mere point: no change of size tells its depth.
        """
        pinned, channels = self.particles.pinned, self.objective.channels
        if pinned.any():
            axis, shrink = self.particles.x[~pinned].mean(axis=0) - self.particles.x[pinned].mean(axis=0), AXIAL_SHRINK
        elif modes == 1 and len(channels) == 1 and isinstance(channels[0], TrackChannels):
            axis, shrink = self.particles.x.mean(axis=0) - channels[0].camera.pose(0)[:3, 3], RAY_SHRINK
        else:
            return np.eye(3)
        axis = axis / max(float(np.linalg.norm(axis)), 1e-12)
        return np.eye(3) - (1.0 - shrink**2) * np.outer(axis, axis)

    def _solve(
        self,
        forward: Forward,
        prior: Prior,
        theta: np.ndarray,
        iterations: int,
        share: tuple[float, float],
        what: str,
        active: np.ndarray | None = None,
        point: Linearisation | None = None,
        tolerance: float = TOLERANCE,
    ) -> Solution:
        """Gauss-Newton from theta over the frames that `forward` has; unknowns that are not `active` stay, and the solution lacks them
        but for its theta, which is whole."""
        objective = self.objective.until(len(forward.hats))
        active = np.ones(len(theta), bool) if active is None else active
        precision = prior.precision()
        inner = precision[np.ix_(active, active)]
        mean = -np.linalg.solve(inner, precision[np.ix_(active, ~active)] @ theta[~active])  # the prior, given those that stay

        def whole(candidates: np.ndarray) -> np.ndarray:
            full = np.repeat(theta[None], len(candidates), axis=0)
            full[:, active] = candidates
            return full

        def residuals(candidates: np.ndarray) -> np.ndarray:
            positions = forward.positions(whole(candidates))
            broken = ~np.isfinite(positions).all(axis=(1, 2, 3))
            white = objective.whiten(objective.residual(np.where(broken[:, None, None, None], self.particles.x, positions)))
            white[broken] = np.inf
            return white

        def linearise(candidate: np.ndarray) -> Linearisation:
            full = whole(candidate[None])[0]
            raw = forward.jacobian(full, active, objective, prior.deviation())
            return Linearisation.at(candidate, residuals(candidate[None])[0], objective.whiten(raw))

        def report(iteration: int, cost: float) -> None:
            fraction = share[0] + (share[1] - share[0]) * max(iteration - 1, 0) / max(iterations, 1)
            self.progress.update(fraction, f"{what}, iteration {iteration}", cost=cost)

        solution = solve(theta[active], mean, inner, residuals, linearise, iterations, report, point, tolerance)
        return replace(solution, theta=whole(solution.theta[None])[0])

    # -- result ---------------------------------------------------------------------------------------------------------------

    def _result(
        self, forward: Forward, prior: Prior, last: Solution, material: Material, views: int, iterations: int, began: float
    ) -> Recovery:
        self.progress.update(0.98, "Simulating the result")
        trajectory = forward.trajectory(last.theta)
        # What was only assumed of stretch is not known: the deviation leaves that assumption out.
        covariance = np.linalg.inv(last.point.normal + replace(prior, stretch=None).precision())
        deviation = posterior_deviation(forward, covariance)
        residual = self.objective.root_mean_square(trajectory.x)
        self._remark(trajectory, views)
        return Recovery(
            outcome=Outcome.CONVERGED if last.converged else Outcome.MAX_ITERATIONS,
            force_density=material.density * forward.acceleration(last.theta),
            deviation=material.density * deviation,
            x=trajectory.x,
            F=trajectory.F,
            v0=trajectory.v[0],
            residual=residual,
            residual_unit="px" if views else "m",
            iterations=iterations,
            seconds=time.monotonic() - began,
            notes=self.notes,
        )

    def _remark(self, trajectory: Trajectory, views: int) -> None:
        """Notes on what the clip does not show."""
        moved = np.linalg.norm(trajectory.x - trajectory.x[0], axis=-1).max()
        radius = np.linalg.norm(self.particles.x - self.particles.x.mean(axis=0), axis=1).max()
        if moved < STILL * max(radius, self.particles.spacing):
            self.notes.append(f"The body hardly moves ({1000 * moved:.2g} mm): the force is known only as the one that holds it still.")
        if views == 1:
            self.notes.append(
                "Force along the view is low confidence from one camera: a second view, a known length or a held part would settle it."
            )


def _rms(values: np.ndarray) -> float:
    """Root mean square length of vectors (..., 3)."""
    return float(np.sqrt((values**2).sum(axis=-1).mean()))
