"""Where a sheet goes: shape from template. Tracks say in which direction a point is, and lengths that stay say how far away.

Frame by frame, starting from the straight continuation of the motion, the vertices minimise

    sum_k rho(|pi(x(k)) - p_k| / sigma_k)² + strains² + bends² + (second difference in time)²

with Gauss-Newton steps, damped as Levenberg and Marquardt do. Once every frame is there, each is solved again between its neighbours. The
problem is known as shape from template (Bartoli et al., Shape-from-Template, PAMI 2015); where the sheet is seen exactly from the front,
whether it bends towards the camera or away is told by perspective and by the motion only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix, identity
from scipy.sparse.linalg import splu

from ....errors import ObjectError
from ....progress import Journal, NoProgress, Progress
from ..motion.lifting import Sight
from ..motion.views import surface_points
from .mesh import SheetMesh
from .riding import ride_flat
from .template import Template

HELD = 1e-3
"""Standard deviation of where a held vertex is, relative to the mean edge."""
SWIFT = 60.0
"""m/s², of the acceleration while the motion before a frame is all that is known: a gale on light cloth makes as much."""
SLOWEST = 1.0
"""m/s², the least that the motion found makes of it afterwards."""
SWEEPS = 2
"""Solves of every frame between its neighbours."""
STEPS = 15
"""Gauss-Newton's in a frame at most."""
DAMPING = (1e-4, 1.0)
"""Levenberg's, least and most, in units of the Hessian's mean diagonal."""
SETTLED = 3e-3
"""They end when the cost falls by less than this part."""
FINEST, TIED = 0.1, 0.5
"""px: least standard deviation of a track, and that of where on the sheet one is that begins after frame 0."""
FEWEST = 8
"""Tracks on the sheet in frame 0."""
CHECKED, PROBES = 6, 16
"""Frames in which the result's uncertainty is looked at, and random vectors in each."""
OUTLIER = 3.0
"""Standard deviations from which a track counts less and less (Cauchy's weights): it may slide where the sheet folds. Larger while all
tracks are missed by more."""


@dataclass(frozen=True)
class _Continued:
    """What the motion says of a frame's vertices."""

    x: np.ndarray
    """(V, 3) where they are likely [m]."""
    precision: float
    """[1/m²]."""

    def cost(self, x: np.ndarray) -> float:
        return 0.5 * self.precision * float(((x - self.x) ** 2).sum())


class Follower:
    """A sheet and what cameras saw of it in T+1 frames."""

    def __init__(self, mesh: SheetMesh, sights: Sequence[Sight], fps: float) -> None:
        self.mesh, self.sights, self.fps = mesh, sights, fps
        self.template = Template(mesh)
        self.edge = mesh.spacing
        held = np.repeat(np.where(mesh.pinned, 1.0 / (HELD * self.edge) ** 2, 0.0), 3)
        self._held, self._identity = csr_matrix((held, (np.arange(held.size),) * 2)), identity(held.size, format="csr")
        self.places = [np.full((one.xy.shape[1], 2), np.nan) for one in sights]
        """Per view, (K, 2) where its tracked points are on the sheet laid flat [m], NaN where that is not known."""
        self._ride = [csr_matrix((len(place), len(mesh.x))) for place in self.places]
        self._late = [np.zeros(len(place), bool) for place in self.places]

    def place(self, frame: int, x: np.ndarray) -> None:
        """Give the tracks that are first visible in this frame, with the vertices at x (V, 3) [m], their places on the sheet."""
        for number, one in enumerate(self.sights):
            first = one.visible[frame] & ~one.visible[:frame].any(axis=0)
            begun = np.flatnonzero(first & np.isfinite(one.xy[frame]).all(axis=1))
            if not begun.size:
                continue
            flat = np.column_stack([self.mesh.flat, np.zeros(len(x))])
            found, hit = surface_points(x, self.mesh.faces, one.camera, one.xy[frame, begun], frame, flat)
            self.places[number][begun[hit]] = found[hit, :2]
            self._late[number][begun[hit]] = frame > 0
        self.put(self.places)

    def put(self, places: Sequence[np.ndarray]) -> None:
        """Take the places of all views' tracks as they are."""
        self.places = [np.array(one) for one in places]
        self._ride = [_matrix(place, self.mesh.flat) for place in self.places]
        self._late = [np.isfinite(place[:, 0]) & ~one.visible[0] for place, one in zip(self.places, self.sights, strict=True)]

    def ahead(self, path: np.ndarray) -> _Continued:
        """From the frames (t, V, 3) before."""
        straight = path[-1] if len(path) == 1 else 2.0 * path[-1] - path[-2]
        return _Continued(straight, (self.fps**2 / SWIFT) ** 2)

    def between(self, path: np.ndarray, frame: int, acceleration: float) -> _Continued:
        """From the frames round a frame of the path (T+1, V, 3), whose second differences make so much in each direction [m/s²]."""
        last = len(path) - 1
        total, weight = np.zeros_like(path[0]), 0.0
        for middle in (frame - 1, frame, frame + 1):
            if not 1 <= middle <= last - 1:
                continue
            own = -2.0 if middle == frame else 1.0
            others = path[middle - 1] - 2.0 * path[middle] + path[middle + 1] - own * path[frame]
            total, weight = total - own * others, weight + own**2
        return _Continued(total / weight, weight * (self.fps**2 / acceleration) ** 2)

    def solved(self, frame: int, start: np.ndarray, motion: _Continued) -> np.ndarray:
        """Vertices (V, 3) of a frame [m] from a start."""
        x, damping = start, 0.0
        for _ in range(STEPS):
            scale = self._missed(frame, x)
            cost = self._cost(frame, x, motion, scale)
            hessian, gradient = self._linearised(frame, x, motion, scale)
            size = float(hessian.diagonal().mean())
            while True:
                whole = hessian + (motion.precision + damping * size) * self._identity
                step = _solve(whole, -gradient).reshape(-1, 3)
                new = self._cost(frame, x + step, motion, scale)
                if new <= cost:
                    break
                damping = max(10.0 * damping, DAMPING[0])
                if damping > DAMPING[1]:
                    return x
            x, damping = x + step, 0.1 * damping if damping > DAMPING[0] else 0.0
            if cost - new < SETTLED * cost:
                break
        return x

    def deviation(self, path: np.ndarray, acceleration: float) -> float:
        """Posterior standard deviation of a vertex's coordinate [m], the mean over some frames of a path (T+1, V, 3) [m].

        The trace of the inverse Hessian is estimated with random signs (Hutchinson, Comm. Stat. Simul. 1990).
        """
        signs = np.random.default_rng(0).choice([-1.0, 1.0], (path[0].size, PROBES))
        variances = []
        for frame in np.unique(np.linspace(1, len(path) - 1, CHECKED).astype(int)):
            motion = self.between(path, frame, acceleration) if len(path) > 2 else self.ahead(path[:frame])
            hessian = self._linearised(frame, path[frame], motion, OUTLIER)[0] + motion.precision * self._identity
            variances.append(float((_solve(hessian, signs) * signs).mean()))
        return float(np.sqrt(np.mean(variances)))

    def _cost(self, frame: int, x: np.ndarray, motion: _Continued, scale: float) -> float:
        tracks = sum(float(np.log1p((self._residuals(number, frame, x) / scale) ** 2).sum()) for number in range(len(self.sights)))
        held = 0.5 * float(((x - self.mesh.x).ravel() ** 2 * self._held.diagonal()).sum())
        return 0.5 * scale**2 * tracks + self.template.cost(x) + motion.cost(x) + held

    def _missed(self, frame: int, x: np.ndarray) -> float:
        """Standard deviations from which a track is an outlier."""
        missed = np.concatenate([self._residuals(number, frame, x) for number in range(len(self.sights))])
        return max(OUTLIER, 2.0 * float(np.median(missed)) if missed.size else 0.0)

    def _looked(self, number: int, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Which tracks (M,) of a view count in a frame, and their standard deviations (M,) [px]."""
        one = self.sights[number]
        seen = np.flatnonzero(one.visible[frame] & np.isfinite(self.places[number][:, 0]) & np.isfinite(one.xy[frame]).all(axis=1))
        return seen, np.hypot(np.maximum(one.sigma[frame, seen], FINEST), np.where(self._late[number][seen], TIED, 0.0))

    def _residuals(self, number: int, frame: int, x: np.ndarray) -> np.ndarray:
        """(M,) by how many standard deviations the tracks of a view are missed in the frame."""
        one, (seen, sigma) = self.sights[number], self._looked(number, frame)
        xy, _ = one.camera.project(self._ride[number][seen] @ x, frame)
        return np.linalg.norm(xy - one.xy[frame, seen], axis=1) / sigma

    def _linearised(self, frame: int, x: np.ndarray, motion: _Continued, scale: float) -> tuple[csr_matrix, np.ndarray]:
        """Hessian (3V, 3V) without what the motion says, and gradient (3V,)."""
        hessian, gradient = self.template.linearise(x)
        hessian, gradient = hessian + self._held, gradient + self._held @ (x - self.mesh.x).ravel()
        for number, one in enumerate(self.sights):
            seen, sigma = self._looked(number, frame)
            ride = self._ride[number][seen]
            points = ride @ x
            off = one.camera.project(points, frame)[0] - one.xy[frame, seen]
            missed = np.linalg.norm(off, axis=1) / sigma
            weight = 1.0 / (1.0 + (missed / scale) ** 2) / sigma**2
            slope = one.camera.projection_jacobian(points, frame)
            rows = _spread(ride, slope)
            weights = np.repeat(weight, 2)
            hessian = hessian + rows.T @ rows.multiply(weights[:, None]).tocsr()
            gradient = gradient + rows.T @ (weights * off.ravel())
        return hessian, gradient + motion.precision * (x - motion.x).ravel()


def follow(
    mesh: SheetMesh, sights: Sequence[Sight], fps: float, progress: Progress | None = None, journal: Journal | None = None
) -> tuple[np.ndarray, float, list[np.ndarray]]:
    """The path of a sheet whose frame 0 is that of its mesh, as one or several cameras saw it.

    Args:
        journal: keeps the frames that are done.

    Returns:
        vertices (T+1, V, 3) [m]; the standard deviation of a coordinate [m]; per view the places (K, 2) of its tracks on the sheet laid
        flat [m], NaN for those off the sheet.

    Raises:
        ObjectError: too few tracks on the sheet, or one that is lost. Cancelled: between frames.
    """
    progress, follower = progress or NoProgress(), Follower(mesh, sights, fps)
    follower.place(0, mesh.x)
    _require_tracks(follower)
    frames = len(sights[0].xy)
    path, acceleration = np.repeat(mesh.x[None], frames, axis=0), SWIFT
    loop = (journal or Journal()).loop("sheet")
    done, kept = loop.resume()
    if done:
        path, acceleration = kept["path"], float(kept["acceleration"])
        follower.put([kept[f"places {number}"] for number in range(len(sights))])

    def state() -> dict[str, np.ndarray]:
        places = {f"places {number}": place for number, place in enumerate(follower.places)}
        return {"path": path, "acceleration": np.array(acceleration), **places}

    steps = [(sweep, t) for sweep in range(SWEEPS + 1) for t in range(1, frames)]
    for number, (sweep, t) in enumerate(steps[done:], start=done + 1):
        progress.update(number / len(steps), f"following the sheet, frame {t}" if sweep == 0 else f"frame {t} between its neighbours")
        if sweep == 0:
            motion = follower.ahead(path[:t])
            path[t] = follower.solved(t, motion.x, motion)
            follower.place(t, path[t])
        elif frames > 2:
            if t == 1:
                acceleration = max(SLOWEST, _acceleration(path, fps))
            path[t] = follower.solved(t, path[t], follower.between(path, t, acceleration))
        if not np.isfinite(path[t]).all():
            raise ObjectError(f"The sheet is lost in frame {t}.", "Check mask and depth of frame 0, or recover it with --form solid.")
        loop.reached(number, state)
    return path, follower.deviation(path, acceleration), follower.places


def _require_tracks(follower: Follower) -> None:
    placed = sum(int(np.isfinite(one[:, 0]).sum()) for one in follower.places)
    if placed < FEWEST:
        raise ObjectError(
            f"Only {placed} tracked points lie on the sheet in frame 0; its shape needs {FEWEST}.",
            "A sheet needs texture: a print, a weave, seams. Give --tracks of your own, or recover it with --form solid.",
        )


def _acceleration(path: np.ndarray, fps: float) -> float:
    """Root mean square of a component of the second differences [m/s²]."""
    return float(np.sqrt((np.diff(path, 2, axis=0) ** 2).mean())) * fps**2


def _matrix(places: np.ndarray, flat: np.ndarray) -> csr_matrix:
    """(K, V) vertices to points at `places` (K, 2) on the sheet laid flat; empty rows for those without a place."""
    known = np.flatnonzero(np.isfinite(places[:, 0]))
    riding = ride_flat(places[known], flat)
    rows = np.repeat(known, riding.index.shape[1])
    return csr_matrix((riding.weight.ravel(), (rows, riding.index.ravel())), (len(places), len(flat)))


def _solve(matrix: csr_matrix, right: np.ndarray) -> np.ndarray:
    """Of a symmetric positive definite system."""
    factor = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return factor.solve(right)


def _spread(ride: csr_matrix, slope: np.ndarray) -> csr_matrix:
    """(2M, 3V) derivative of the pixels (M, 2) by the vertices."""
    entries = ride.tocoo()
    values = entries.data[:, None, None] * slope[entries.row]
    rows = 2 * entries.row[:, None, None] + np.arange(2)[:, None] + np.zeros(3, int)
    columns = 3 * entries.col[:, None, None] + np.zeros((2, 1), int) + np.arange(3)
    return csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), (2 * ride.shape[0], 3 * ride.shape[1]))
