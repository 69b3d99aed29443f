"""A clamp that moves: a hand that waves a flag, a branch that sways under its leaves.

The points on the pinned particles show the clamp's motion, as that of a rigid body: x = c + s(t) + R(t) (y - c). The force is solved for in
the clamp's own frame, in which the clamp stands still, and is then transformed back to the world, where a body with the motion y(t) in the
clamp's frame obeys

    f / rho = s'' + R (f' / rho + g) - g + w' x r + 2 w x R y' + w x (w x r)        r = R (y - c)

with f' the force found in the clamp's frame under the gravity g, and w the clamp's angular velocity (Goldstein, "Classical Mechanics",
section 4.9). Without this, the clamp's motion would be taken for a force on the body.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, make_smoothing_spline
from scipy.spatial.transform import Rotation

from ...records import Particles, PointTargets, Recovery
from .channels import check, noise_of
from .constants import NOISE

STEP = 0.25
"""Half-width of the central differences of the clamp's rotation [frames]."""


@dataclass(frozen=True)
class ClampMotion:
    """The rigid motion of the clamp since frame 0."""

    centre: np.ndarray
    """(3,) c [m]."""
    shift: BSpline
    """s [m] as a function of time [frames]."""
    turn: BSpline
    """Rotation vector of R [rad] as a function of time [frames]."""
    frames: int
    """T + 1."""
    fps: float

    @property
    def largest(self) -> float:
        """Largest displacement of the clamp over the frames [m]."""
        return float(np.linalg.norm(self.shift(np.arange(self.frames)), axis=1).max())

    @property
    def widest(self) -> float:
        """Largest rotation of the clamp over the frames [degrees]."""
        return float(np.degrees(np.linalg.norm(self.turn(np.arange(self.frames)), axis=1).max()))

    def in_clamp_frame(self, targets: PointTargets) -> PointTargets:
        """The points in the clamp's frame. Their covariance is left as it is, as it is a mean over the clip."""
        shift, turn = self._at(np.arange(self.frames))
        return replace(targets, x=np.einsum("tji,tkj->tki", turn, targets.x - self.centre - shift[:, None]) + self.centre)

    def gravity(self, particles: Particles, gravity: np.ndarray) -> np.ndarray:
        """Effective gravity (T, N, 3) [m/s²] on particles at rest in the clamp's frame, with inertial forces; gravity: (3,) in the world.

        With it in the solve, a force that the clip does not show comes out as zero in the world, not as one that keeps up with the clamp.
        """
        turn = self._at(self._middle)[1]
        r = np.einsum("tij,nj->tni", turn, particles.x - self.centre)
        return np.einsum("tji,tnj->tni", turn, gravity - self._carries(r))

    def to_world(self, recovery: Recovery, density: np.ndarray, gravity: np.ndarray, felt: np.ndarray) -> Recovery:
        """A recovery in the clamp's frame, transformed to the world.

        Args:
            density: (N,) density of the body [kg/m³].
            gravity: (3,) gravity in the world [m/s²].
            felt: (T, N, 3) effective gravity that the solve used [m/s²], see `gravity`.
        """
        frames, rho = np.arange(self.frames), density[:, None]
        shift, turn = self._at(frames)
        moved = np.einsum("tij,tnj->tni", turn, recovery.x - self.centre)
        spins = self._spin(frames)
        return replace(
            recovery,
            force_density=rho * self._force(recovery, recovery.force_density / rho + felt, gravity),
            x=self.centre + shift[:, None] + moved,
            F=np.einsum("tij,tnjk->tnik", turn, recovery.F),
            v0=recovery.v0 + self.fps * self.shift(0.0, 1) + np.cross(spins[0], moved[0]),
            clamp_moves=True,
        )

    def _force(self, recovery: Recovery, found: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """(T, N, 3) f / rho [m/s²] of the module's equation; `found` (T, N, 3) is f' / rho + g."""
        turn = self._at(self._middle)[1]
        r = np.einsum("tij,tnj->tni", turn, 0.5 * (recovery.x[1:] + recovery.x[:-1]) - self.centre)
        velocity = self.fps * np.einsum("tij,tnj->tni", turn, np.diff(recovery.x, axis=0))
        swung = 2.0 * np.cross(self._spin(self._middle)[:, None], velocity)
        return self._carries(r) + swung + np.einsum("tij,tnj->tni", turn, found) - gravity

    def _carries(self, r: np.ndarray) -> np.ndarray:
        """Acceleration (T, N, 3) [m/s²] in the middle of each interval of places that move with the clamp, r (T, N, 3) [m] from c."""
        spin = self._spin(self._middle)[:, None]
        faster = self.fps * ((self._spin(self._middle + STEP) - self._spin(self._middle - STEP)) / (2.0 * STEP))[:, None]
        return self.fps**2 * self.shift(self._middle, 2)[:, None] + np.cross(faster, r) + np.cross(spin, np.cross(spin, r))

    @property
    def _middle(self) -> np.ndarray:
        """(T,) the middle of each interval [frames]."""
        return np.arange(self.frames - 1) + 0.5

    def _at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """s (n, 3) [m] and R (n, 3, 3) at times (n,) [frames]."""
        return self.shift(time), Rotation.from_rotvec(self.turn(time)).as_matrix()

    def _spin(self, time: np.ndarray) -> np.ndarray:
        """Angular velocity (n, 3) [rad/s] at times (n,) [frames]."""
        after, before = (Rotation.from_rotvec(self.turn(time + step)) for step in (STEP, -STEP))
        return self.fps / (2.0 * STEP) * (after * before.inv()).as_rotvec()


def clamp_motion(particles: Particles, targets: PointTargets, fps: float) -> ClampMotion | None:
    """The motion of the clamp; None if it stands still, does not move as a rigid body, or too little of it is seen.

    Args:
        targets: points in 3D; those on pinned particles show the clamp.

    Raises:
        UsageError, ObjectError: for targets that cannot be right.
    """
    check(targets.x, targets.visible, 3, targets.attachment, len(particles.x))
    on = targets.attachment.matrix(len(particles.x)) @ particles.pinned.astype(float) > NOISE.clamp_rides
    seen = targets.visible[:, on]
    if len(seen) < NOISE.clamp_frames or on.sum() < 3 or not seen.all():
        return None
    held = targets.x[:, on]
    centre = held[0].mean(axis=0)
    shift = held.mean(axis=1) - centre
    start, turned = held[0] - centre, held - centre - shift[:, None]
    if np.linalg.matrix_rank(start, tol=0.1 * np.linalg.norm(start, 2)) < 2:
        return None  # points in a line do not show a rotation about that line
    turn = np.stack([Rotation.align_vectors(now, start)[0].as_rotvec() for now in turned])
    rigid = np.einsum("tij,kj->tki", Rotation.from_rotvec(turn).as_matrix(), start)
    # Twice the noise, as both compared frames have it.
    apart = ((turned - rigid) ** 2).mean() - 2.0 * noise_of(held) ** 2
    if apart > NOISE.clamp_rigid**2 * ((shift[:, None] + rigid - start) ** 2).mean():
        return None
    smooth = _smooth(shift), _smooth(turn)
    if smooth[0] is None and smooth[1] is None:
        return None
    still = BSpline(np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]), np.zeros((4, 3)), 3)
    return ClampMotion(centre, smooth[0] or still, smooth[1] or still, len(held), fps)


def _smooth(series: np.ndarray) -> BSpline | None:
    """Smoothing spline of a series (T+1, 3) of displacements since frame 0; None if they stay within the noise.

    Its smoothness is chosen by generalized cross-validation (Woltring 1986, "A Fortran package for generalized, cross-validatory spline
    smoothing and differentiation", written for the motion of limbs).
    """
    if not series.any():
        return None
    time = np.arange(len(series), dtype=np.float64)
    each = [make_smoothing_spline(time, component) for component in series.T]
    coefficients = np.stack([one.c - one(0.0) for one in each], axis=1)
    smooth = BSpline(each[0].t, coefficients, each[0].k)
    size = np.sqrt((smooth(time) ** 2).mean())
    return smooth if size > NOISE.clamp_clear * noise_of(series) else None
