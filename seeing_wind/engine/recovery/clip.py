"""A clip solved in overlapping blocks: the cost grows with the clip's length, the memory of the solve does not.

Each block starts from the state that the block before reached well before its end, and solves the frames after that state again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..errors import UsageError
from ..materials import Material
from ..mpm.model import Model
from ..progress import Journal, Progress, in_words
from ..records import Outcome, Particles, Recovery
from ..settings import RecoverSettings
from .blocks import blocks, most_modes
from .diagnostics.missed import fall_of, verdict
from .diagnostics.posterior import missed_acceleration, unseen_guess
from .diagnostics.remarks import (
    end_remarks,
    force_remarks,
    held_remarks,
    motion_remarks,
    reaction_remarks,
    unseen_remarks,
    wider_remarks,
    wild_remarks,
)
from .kept import Kept, kept_of
from .prior.basis import SpatialBasis, held_axis, spatial_basis, told_apart
from .prior.constants import PRIOR
from .prior.kernel import steady_part
from .prior.learning import Expected
from .solve.block import BlockSolver
from .solve.constants import PACE
from .solve.first_field import FINELY, Pace
from .solve.section import section_axes
from .solve.stiffness import Stiffness, remark, stiffer, youngs_modulus
from .targets.objective import Objective
from .targets.points import PointChannels
from .targets.tracks import TrackChannels


def still_frames(settings: RecoverSettings, frames: int, first_frame: int = 0) -> np.ndarray:
    """(T,) bool: the frames that --still names, in a clip of T `frames`; `first_frame` is the number of the first one, as --still counts.

    Raises:
        UsageError: if the clip lacks some of the frames named, or has no others.
    """
    still = np.zeros(frames, dtype=bool)
    if settings.still is not None:
        first, last = (number - first_frame for number in settings.still)
        inside = 0 <= first < frames and last <= frames  # the number of the last image is taken for the interval before it
        still[max(first, 0) : last + 1] = True
        if not inside or still.all():
            used = f"{first_frame} to {first_frame + frames}"
            wrong = f"names all frames that are used, {used}" if inside else f"names frames that are not used: {used} are"
            raise UsageError(
                f"--still {settings.still[0]}:{settings.still[1]} {wrong}.",
                "Name the frames in which the air is still; in the others a force is looked for.",
            )
    return still


Foresee = Callable[[int, int], float | None]
"""Function from the number of blocks that need denser knots, and of those that are followed again finely, to the duration of the whole
solve [s]; None if it cannot be estimated."""


def unforeseen(densely: int, finely: int) -> float | None:
    """The `Foresee` where there is no estimate."""
    return None


@dataclass
class Clip:
    """A clip with its body, targets and settings, from which a recovery is made."""

    particles: Particles
    model: Model
    objective: Objective
    fps: float
    settings: RecoverSettings
    progress: Progress
    journal: Journal
    notes: list[str]
    stiffness: Stiffness
    """Free until a block has determined it."""
    still: np.ndarray
    """(T,) bool: frames without a force."""
    foresee: Foresee = unforeseen

    def solve_blocks(self) -> list[Kept]:
        """Solve the blocks one after the other."""
        basis = self._observable(spatial_basis(self.particles.x, self._weight, most_modes(self.particles)))
        expected = self._expected(len(basis.degree))
        kept: list[Kept] = []
        cuts = blocks(self.objective.frames)
        done, densely, finely = 0.0, set[int](), set[int]()
        while len(kept) < len(cuts):
            part = len(kept)
            begin, end = cuts[part]
            # If a later block determines the stiffness, the solve begins again with the first.
            share = (1.0 - done) / (len(cuts) - part + (len(cuts) if part and self.stiffness.free else 0))

            def tell(fraction: float, what: str, residual: float | None, part: int = part, at: float = done, share: float = share) -> None:
                where = f" (part {part + 1} of {len(cuts)})" if len(cuts) > 1 else ""
                known = residual is not None and np.isfinite(residual)
                figures: dict[str, Any] = {"residual": float(f"{residual:.3g}"), "residual_unit": self.objective.unit} if known else {}
                self.progress.update(at + share * fraction, what + where, **figures)

            def lost(fraction: float, pace: Pace, part: int = part, at: float = done, share: float = share) -> None:
                if pace is FINELY:
                    finely.add(part)
                else:  # the later blocks begin with knots as dense
                    densely.update(range(part, len(cuts)))
                seconds = self.foresee(len(densely), len(finely))
                if seconds is not None:
                    what = f"The object strays and is sought again: about {in_words(seconds)} in all on this machine"
                    self.progress.update(at + share * fraction, what, expected_seconds=seconds)

            start = kept[-1].trajectory.state(-1) if kept else None
            springy = not self.model.plastic and not self.stiffness.free
            before = kept[-1].onward if kept and springy and self.settings.iterations > 1 else None  # continuing takes two
            solver = BlockSolver(
                self.particles, self.model.from_frame(begin), self.objective.between(begin, end), basis, expected, start,
                self.settings.iterations, self.progress, tell, self.still[begin:end], self._steady(kept), self.stiffness, before=before,
                journal=self.journal, lost=lost,
            )  # fmt: skip
            frames = cuts[part + 1][0] - begin if part + 1 < len(cuts) else end - begin
            found = self.journal.once("block", Kept, partial(kept_of, solver, frames), begin, end, start, self.stiffness)
            done += share
            if self.stiffness.free:
                self.stiffness = found.stiffness.settled() if found.stiffness.known else found.stiffness
                if part and self.stiffness.known:  # the body is the same all through the clip, but the blocks so far had another stiffness
                    kept = []
                    continue
            if found.knot_spacing > PACE.knot and not part and found.acceleration.any():
                self.notes.append(f"The force has a knot every {found.knot_spacing:.0f} frames: faster gusts are smoothed.")
            kept.append(found)
        return kept

    @property
    def _weight(self) -> np.ndarray:
        """(N,) weight of a particle's share of the force on the whole body: the free volume, as mass of the body's material [kg]."""
        return self.model.mass / self.particles.relative_density * ~self.particles.pinned

    def _steady(self, kept: list[Kept]) -> np.ndarray:
        """(3,) the constant part of the force on the whole body in the blocks so far, over the mass of as much of its material [m/s²]."""
        if not kept:
            return np.zeros(3)
        share = self.model.mass * ~self.particles.pinned / self._weight.sum()
        force = np.concatenate([np.einsum("n,tni->ti", share, one.acceleration) for one in kept])
        at = np.flatnonzero(~self.still[: len(force)])
        return steady_part(force[at], at.astype(float), kept[-1].onward.kernel.duration)

    def _observable(self, basis: SpatialBasis) -> SpatialBasis:
        """The modes that the observed points can tell apart; the constant one always."""
        count = max(1, told_apart(self.objective.points() @ basis.phi, PRIOR.observable))
        if count < min(4, basis.phi.shape[1]):
            self.notes.append(
                f"The observed points determine only {count} of the patterns in which a force can vary over the body; the rest is a guess."
            )
        return basis.first(count)

    def _expected(self, modes: int) -> Expected:
        """Expected sizes before the solve: of the field, from the observed acceleration and gravity, and of the initial velocity."""
        observed = max(one.acceleration(self.particles.x, self.fps) for one in self.objective.channels)
        size = float(np.hypot(observed, np.linalg.norm(self.settings.gravity))) or 1e-3
        size *= float((self.model.mass * ~self.particles.pinned).sum() / self._weight.sum())  # a light body needs less force for it
        component = self._first_component(modes)
        speed = max([PRIOR.slowest, *(one.speed(self.particles.x, self.fps) for one in self.objective.channels)])
        axes = np.sqrt(np.diag(component))  # uniform along x, y, z, then spins about x, y, z
        first = speed * np.resize(axes, 3 if self.particles.pinned.any() else 6)
        if modes == 1:
            first[3:] *= PRIOR.unseen_spin
        return Expected(size, first, component)

    def _first_component(self, modes: int) -> np.ndarray:
        """Initial covariance (3, 3) of the force's components: isotropic, but small along the direction that the data cannot show.

        That is a held body's axis, or the view of a single camera that sees the body as a point, whose depth no change of size shows. The
        view is the camera's axis, not the ray to the body, which turns as the body crosses the frame.
        """
        pinned, channels = self.particles.pinned, self.objective.channels
        axis, shrink = held_axis(self.particles.x, pinned) if pinned.any() else None, PRIOR.axial_shrink
        if not pinned.any() and modes == 1 and len(channels) == 1 and isinstance(channels[0], TrackChannels):
            view = channels[0].camera.pose(0)[:3, 2]
            axis, shrink = view / np.linalg.norm(view), PRIOR.ray_shrink
        return np.eye(3) if axis is None else np.eye(3) - (1.0 - shrink**2) * np.outer(axis, axis)

    def result(self, kept: list[Kept], material: Material, views: int, began: float) -> Recovery:
        """The recovery of the whole clip from its blocks. Raises ObjectError when the simulation does not follow points in 3D."""
        x = np.concatenate([one.trajectory.x[:-1] for one in kept] + [kept[-1].trajectory.x[-1:]])
        F = np.concatenate([one.trajectory.F[:-1] for one in kept] + [kept[-1].trajectory.F[-1:]])
        acceleration = np.concatenate([one.acceleration for one in kept])
        wild = np.concatenate([one.wild for one in kept])
        residual = self.objective.root_mean_square(x)
        held_up = self._remark(x, kept[0].trajectory.v[0], acceleration, material, residual, views, wild)
        deviation = self._deviation(np.concatenate([one.deviation for one in kept]), x, acceleration, held_up)
        density = self.particles.density(material)[:, None]
        return Recovery(
            outcome=Outcome.CONVERGED if all(one.converged for one in kept) else Outcome.MAX_ITERATIONS,
            force_density=density * acceleration,
            deviation=density * deviation,
            x=x,
            F=F,
            v0=kept[0].trajectory.v[0],
            residual=residual,
            residual_unit=self.objective.unit,
            iterations=sum(one.iterations for one in kept),
            seconds=time.monotonic() - began,
            notes=self.notes,
            youngs_modulus=youngs_modulus(self.model, self.particles, self.stiffness.s) if self.stiffness.known else None,
            stiffness_deviation=self.stiffness.deviation if self.stiffness.known else None,
            stiffness=self.stiffness.spread(self.particles) if self.stiffness.known else None,
            clamp_depth=self.settings.clamp_depth + self.stiffness.deeper,
            cell=self.model.dx,
            section=self.stiffness.q[2:] if self.stiffness.known else None,
            section_axes=section_axes(self.particles) if self.stiffness.known else None,
            held_covariance=self.stiffness.covariance if self.stiffness.known else None,
            substeps=self.stiffness.of(self.model, self.particles).substeps,
            wild=wild if wild.any() else None,
        )

    def _remark(
        self,
        x: np.ndarray,
        v0: np.ndarray,
        acceleration: np.ndarray,
        material: Material,
        residual: np.ndarray,
        views: int,
        wild: np.ndarray,
    ) -> bool:
        """Add notes, the worst first, on what is doubtful in a motion x (T+1, N, 3) [m] with the initial velocity v0 (N, 3) [m/s] and an
        acceleration (T, N, 3) [m/s²].

        Returns: whether the force is only the reaction that holds the body up against gravity.

        Raises:
            ObjectError: as `verdict`.
        """
        fall = fall_of(self.particles, acceleration, x, v0, self.fps, self.settings.gravity)
        useless = verdict(self.particles, self.objective.channels, x, residual, fall)
        stated = [one.targets.stated for one in self.objective.channels if isinstance(one, PointChannels)]
        errors = math.sqrt(float(np.mean(np.concatenate(stated)))) if stated else 0.0
        self.notes += wider_remarks(self.particles) + motion_remarks(self.particles, x, residual, views, errors)
        self.notes += held_remarks(self.particles, self.objective.channels)
        self.notes += unseen_remarks(self.objective.used, self.objective.shown(self.particles.pinned))
        self.notes += wild_remarks(self.objective.channels)
        self.notes += end_remarks(wild)
        if not self.particles.pinned.any():
            self.notes += force_remarks(acceleration, material.density, x, self.fps, self.settings.gravity)
        held_up = reaction_remarks(self.particles, acceleration, x, self.settings.gravity)
        self.notes[:0] = held_up
        self.notes[:0] = useless
        self.notes += self._stiffness_remark(material)
        return bool(held_up)

    def _stiffness_remark(self, material: Material) -> list[str]:
        """Notes on the stiffness, compared with the one given: that of another clip, or of the material before it was softened."""
        if not self.stiffness.known:
            return remark(self.stiffness, self.model, self.particles)
        given = float(self.stiffness.expected[0]) or math.log(material.youngs_modulus / youngs_modulus(self.model, self.particles))
        beside = self.stiffness.at(self.stiffness.q - [given, 0.0, 0.0, 0.0], self.stiffness.covariance)
        return remark(beside, stiffer(self.model, math.exp(given)), self.particles)

    def _deviation(self, posterior: np.ndarray, x: np.ndarray, acceleration: np.ndarray, held_up: bool) -> np.ndarray:
        """(T, N, 3) standard deviation of the acceleration [m/s²]: the posterior's, plus the misfit of 3D points, a guess for frames in
        which nothing that moves freely is seen, and gravity if the force only holds the body up."""
        unseen = np.where(self.still, 0.0, unseen_guess(acceleration, self.objective.shown(self.particles.pinned)))
        deviation = np.hypot(posterior, unseen[:, None, None])
        for one in self.objective.channels:
            if isinstance(one, PointChannels):
                missed = np.where(self.still, 0.0, missed_acceleration(one.targets, x, self.fps))
                deviation = np.hypot(deviation, missed[:, None, None])
        if held_up:  # the clip does not show how much of the force is the reaction to gravity
            deviation = np.hypot(deviation, np.linalg.norm(self.settings.gravity))
        return deviation
