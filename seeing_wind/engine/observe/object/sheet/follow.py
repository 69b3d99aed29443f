"""The path of a sheet: shape from template. Tracks give the direction of a point, and the sheet's constant lengths give its distance.

Frame by frame, starting from the straight continuation of the motion, the vertices minimise

    sum_k rho(|pi(x(k)) - p_k| / sigma_k)² + (px outside the outline, and px by which the sheet falls short of it)²
        + strains² + bends² + (second difference in time)²

over tracks and recognised points k, with Gauss-Newton steps and Levenberg-Marquardt damping. Once all frames have been solved, each is
solved again between its neighbours. The problem is known as shape from template (Bartoli et al., Shape-from-Template, PAMI 2015). Where
the sheet is seen exactly from the front, only perspective and motion decide whether it bends towards the camera or away from it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.sparse import csr_matrix, identity
from scipy.sparse.linalg import splu

from ....conventions import frame_named
from ....errors import ObjectError
from ....masks import Masks
from ....progress import Journal, NoProgress, Progress
from ....records import Measured
from ..motion.lifting import Sight
from .mesh import SheetMesh
from .template import CURVED, LEAST_CURVED, Template
from .view import OUTLIER, View

HELD = 1e-3
"""Standard deviation of a held vertex from its place, in units of the mean edge."""
SWIFT = 60.0
"""Standard deviation of the acceleration [m/s²] while only the motion before a frame is known: what a gale does to light cloth."""
SLOWEST = 1.0
"""Least standard deviation of the acceleration [m/s²] once it is estimated from the path."""
SWEEPS = 2
"""How often every frame is solved between its neighbours."""
STEPS = 30
"""Largest number of Gauss-Newton steps in a frame."""
FAR, NARROWED = 0.99, 0.6
"""Fraction of the tracks within the outlier threshold at a frame's start, and the factor by which it shrinks in each step, so that a corner
which appears from behind a fold, far from its expected place, is pulled in (graduated non-convexity, Blake and Zisserman 1987)."""
DAMPING = (1e-4, 1.0)
"""Least and largest Levenberg damping, in units of the Hessian's mean diagonal."""
SETTLED = 3e-3
"""Relative decrease of the cost below which the steps end."""
FEWEST = 8
"""Least number of tracks on the sheet in frame 0."""
PROBES = 24
"""Number of random vectors that estimate the uncertainty."""
LEARNT, CURVATURE = 8, 0.2
"""A new frame is solved at most LEARNT times, as long as the logarithm of its estimated curvature changes by more than CURVATURE."""
MODES = 30
"""Largest number R of modes of the errors that vertices share: twice as many as the balance of forces uses."""


@dataclass(frozen=True)
class Followed:
    """A sheet's path and its uncertainty."""

    path: np.ndarray
    """(T+1, V, 3) vertices [m]."""
    sigma: np.ndarray
    """(T+1, V) standard deviation of a vertex's coordinates [m]."""
    measured: Measured
    places: list[np.ndarray]
    """Per view, the places (K, 2) of its tracks on the sheet laid flat [m], NaN for tracks off the sheet."""


@dataclass(frozen=True)
class _Continued:
    """The Gaussian prior that the motion gives a frame's vertices."""

    x: np.ndarray
    """(V, 3) mean [m]."""
    precision: csr_matrix
    """(3V, 3V) [1/m²]."""

    def cost(self, x: np.ndarray) -> float:
        """Negative log probability of vertices at x (V, 3) [m], up to a constant."""
        off = (x - self.x).ravel()
        return 0.5 * float(off @ (self.precision @ off))


class Follower:
    """Solves for a sheet's vertices, frame by frame, from what the cameras saw of it in T+1 frames."""

    def __init__(self, mesh: SheetMesh, views: Sequence[View], fps: float) -> None:
        self.mesh, self.views, self.fps = mesh, views, fps
        self.template = Template(mesh)
        self.curved = np.full(len(views[0].sight.xy), CURVED)
        """(T+1,) standard deviation of the curvature in each frame, times the sheet's size."""
        held = np.repeat(np.where(mesh.pinned, 1.0 / (HELD * mesh.spacing) ** 2, 0.0), 3)
        self._held, self._identity = csr_matrix((held, (np.arange(held.size),) * 2)), identity(held.size, format="csr")

    def ahead(self, path: np.ndarray) -> _Continued:
        """The prior of frame t from the path (t, V, 3) [m] before it."""
        straight = path[-1] if len(path) == 1 else 2.0 * path[-1] - path[-2]
        return self._continued(len(path), straight, (self.fps**2 / SWIFT) ** 2)

    def begun(self, frame: int, path: np.ndarray) -> np.ndarray:
        """Vertices (V, 3) [m] of a new frame, starting from the path (t, V, 3) before it; its curvature is learnt along with them."""
        self.curved[frame] = self.curved[frame - 1]
        motion = self.ahead(path)
        x = motion.x
        for _ in range(LEARNT):
            x = self.solved(frame, x, motion)
            if abs(math.log(self.learn_curvature(frame, x, motion))) < CURVATURE:
                break
            motion = self.ahead(path)
        return x

    def between(self, path: np.ndarray, frame: int, acceleration: float) -> _Continued:
        """The prior of a frame from the others of the path (T+1, V, 3) [m]; acceleration: standard deviation of a component [m/s²]."""
        last = len(path) - 1
        total, weight = np.zeros_like(path[0]), 0.0
        for middle in (frame - 1, frame, frame + 1):
            if not 1 <= middle <= last - 1:
                continue
            own = -2.0 if middle == frame else 1.0
            others = path[middle - 1] - 2.0 * path[middle] + path[middle + 1] - own * path[frame]
            total, weight = total - own * others, weight + own**2
        return self._continued(frame, total / weight, weight * (self.fps**2 / acceleration) ** 2)

    def _continued(self, frame: int, x: np.ndarray, precision: float) -> _Continued:
        """The prior round x (V, 3) [m] with that precision [1/m²] of a coordinate, and round x's bends: unseen parts keep their shape."""
        return _Continued(x, precision * self._identity + self.template.bends / self.curved[frame] ** 2)

    def solved(self, frame: int, start: np.ndarray, motion: _Continued) -> np.ndarray:
        """Vertices (V, 3) [m] of a frame that minimise the cost, from the start (V, 3)."""
        x, damping, wide = start, 0.0, self._widest(frame, start)
        for _ in range(STEPS):
            scale, wide = max(wide, self._outlier(frame, x)), NARROWED * wide
            cost = self._cost(frame, x, motion, scale)
            hessian, gradient = self._linearised(frame, x, motion, scale)
            size = float(hessian.diagonal().mean())
            while True:
                step = _solve(hessian + damping * size * self._identity, -gradient).reshape(-1, 3)
                new = self._cost(frame, x + step, motion, scale)
                if new <= cost:
                    break
                damping = max(10.0 * damping, DAMPING[0])
                if damping > DAMPING[1]:
                    return x
            x, damping = x + step, 0.1 * damping if damping > DAMPING[0] else 0.0
            if cost - new < SETTLED * cost and wide < scale:
                break
        return x

    def learn_curvature(self, frame: int, x: np.ndarray, motion: _Continued) -> float:
        """Set a frame's curvature from its solution x (V, 3) [m] and the uncertainty of that; return the new curvature over the old one.

        If the curvature were left too large, noise would crumple the sheet, which then seems shorter, and so nearer to the camera. This is
        a step of expectation maximisation: the mean square of the bends is that of the solution plus, estimated with random signs, that of
        its uncertainty.
        """
        bends, before, signs = self.template.bends, self.curved[frame], _signs(frame, x.size)
        hessian = self._linearised(frame, x, motion, self._outlier(frame, x))[0]
        unknown = float(((bends @ signs) * _solve(hessian, signs)).sum()) / PROBES
        square = (float(x.ravel() @ (bends @ x.ravel())) + unknown) / len(self.template.hinges)
        self.curved[frame] = min(CURVED, max(LEAST_CURVED, math.sqrt(square)))
        return float(self.curved[frame] / before)

    def deviation(self, path: np.ndarray, frame: int, acceleration: float) -> np.ndarray:
        """Posterior standard deviation (V,) of the vertices' coordinates [m] in a frame of a path (T+1, V, 3) [m].

        The diagonal of the inverse Hessian is estimated with random signs (Bekas et al., Appl. Numer. Math. 57, 2007), and averaged over
        the faces round a vertex.
        """
        hessian = self._linearised(frame, path[frame], self.between(path, frame, acceleration), OUTLIER)[0]
        signs = _signs(frame, path[0].size)
        variance = (_solve(hessian, signs) * signs).mean(axis=1).reshape(-1, 3).mean(axis=1)
        faces = self.mesh.faces
        around = np.bincount(faces.ravel(), np.repeat(variance[faces].sum(axis=1), 3)) / (3.0 * np.bincount(faces.ravel()))
        return np.sqrt(np.maximum(around, 0.0))

    def measured(self, path: np.ndarray) -> Measured:
        """What each frame of a path (T+1, V, 3) [m] determines by itself: its solution with next to no tie to its neighbours.

        Smoothing the motion is biased where a frame determines little, such as the distance of a sheet seen edge-on. Neighbouring frames
        share such an error, and the acceleration that it implies would be taken for a gust.
        """
        areas, count = self.mesh.areas(), min(MODES, len(self.mesh.x))
        modes = eigh(self.template.bends[::3, ::3].toarray(), np.diag(areas), subset_by_index=(0, count - 1))[1]
        onto = np.kron(areas[:, None] * modes, np.eye(3))
        x, covariance = path.copy(), np.zeros((len(path), *(count, 3) * 2))
        for frame in range(1, len(path)):
            loose, scale = self.between(path, frame, SWIFT), self._outlier(frame, path[frame])
            hessian, gradient = self._linearised(frame, path[frame], loose, scale)
            solved = _solve(hessian, np.column_stack([onto, -gradient]))
            x[frame] += solved[:, -1].reshape(-1, 3)
            covariance[frame] = (onto.T @ solved[:, :-1]).reshape(covariance.shape[1:])
        return Measured(x, modes, covariance)

    def _cost(self, frame: int, x: np.ndarray, motion: _Continued, scale: float) -> float:
        held = 0.5 * float(((x - self.mesh.x).ravel() ** 2 * self._held.diagonal()).sum())
        return sum(view.cost(frame, x, scale) for view in self.views) + self.template.cost(x, self.curved[frame]) + motion.cost(x) + held

    def _outlier(self, frame: int, x: np.ndarray) -> float:
        """The residual from which a track is an outlier [standard deviations]."""
        missed = np.concatenate([view.missed(frame, x) for view in self.views])
        return max(OUTLIER, 2.0 * float(np.median(missed)) if missed.size else 0.0)

    def _widest(self, frame: int, x: np.ndarray) -> float:
        """The same at a start, where the sheet is not yet in its place and many residuals may be large: hardly any track is an outlier."""
        missed = np.concatenate([view.missed(frame, x) for view in self.views])
        return float(np.quantile(missed, FAR)) if missed.size else OUTLIER

    def _linearised(self, frame: int, x: np.ndarray, motion: _Continued, scale: float) -> tuple[csr_matrix, np.ndarray]:
        """Gauss-Newton Hessian (3V, 3V) and gradient (3V,) of the cost."""
        hessian, gradient = self.template.linearise(x, self.curved[frame])
        hessian, gradient = hessian + self._held, gradient + self._held @ (x - self.mesh.x).ravel()
        for view in self.views:
            own, slope = view.linearise(frame, x, scale)
            hessian, gradient = hessian + own, gradient + slope
        return hessian + motion.precision, gradient + motion.precision @ (x - motion.x).ravel()


def follow(
    mesh: SheetMesh,
    sights: Sequence[Sight],
    fps: float,
    masks: Masks | None = None,
    progress: Progress = NoProgress(),
    journal: Journal = Journal(),
) -> Followed:
    """The path of a sheet that begins with its mesh in frame 0, as one or several cameras saw it in at least three frames.

    Args:
        masks: the sheet in the first view's frames, if known.
        journal: keeps the frames that are done.

    Raises:
        ObjectError: too few tracks on the sheet, or the sheet is lost in a frame. Cancelled: between frames.
    """
    views = [View(mesh, sight, None if number else masks) for number, sight in enumerate(sights)]
    follower, frames = Follower(mesh, views, fps), len(sights[0].xy)
    for view in views:
        view.place(0, mesh.x)
    _require_tracks(views)
    path, acceleration = np.repeat(mesh.x[None], frames, axis=0), SWIFT
    loop = journal.loop("sheet")
    done, kept = loop.resume()
    if done:
        path, acceleration, follower.curved = kept["path"], float(kept["acceleration"]), kept["curved"]
        for number, view in enumerate(views):
            view.put(kept[f"places {number}"])

    def state() -> dict[str, np.ndarray]:
        places = {f"places {number}": view.places for number, view in enumerate(views)}
        return {"path": path, "acceleration": np.array(acceleration), "curved": follower.curved, **places}

    steps = [(sweep, t) for sweep in range(SWEEPS + 1) for t in range(1, frames)]
    for number, (sweep, t) in enumerate(steps[done:], start=done + 1):
        progress.update(number / len(steps), f"following the sheet, frame {t}" if sweep == 0 else f"frame {t} between its neighbours")
        if sweep == 0:
            path[t] = follower.begun(t, path[:t])
            for view in views:
                view.place(t, path[t])
        else:
            if t == 1:
                acceleration = max(SLOWEST, _acceleration(path, fps))
            motion = follower.between(path, t, acceleration)
            path[t] = follower.solved(t, path[t], motion)
            follower.learn_curvature(t, path[t], motion)
        if not np.isfinite(path[t]).all():
            raise ObjectError(f"The sheet is lost in {frame_named(t)}.", "Check mask and depth of frame 0, or use --form solid.")
        loop.reached(number, state)
    deviation = [follower.deviation(path, t, acceleration) for t in range(1, frames)]
    return Followed(path, np.stack([deviation[0], *deviation]), follower.measured(path), [view.places for view in views])


def _require_tracks(views: Sequence[View]) -> None:
    placed = sum(int(np.isfinite(view.places[:, 0]).sum()) for view in views)
    if placed < FEWEST:
        raise ObjectError(
            f"Only {placed} tracked points lie on the sheet in frame 0; its shape needs {FEWEST}.",
            "A sheet needs texture: a print, a weave, seams. Begin where it shows its face and not its edge, give --tracks of your own, or "
            "recover it with --form solid.",
        )


def _acceleration(path: np.ndarray, fps: float) -> float:
    """Root mean square of the components of a path's (T+1, V, 3) acceleration [m/s²], from second differences."""
    return float(np.sqrt((np.diff(path, 2, axis=0) ** 2).mean())) * fps**2


def _signs(frame: int, size: int) -> np.ndarray:
    """(size, PROBES) random signs, always the same for a frame."""
    return np.random.default_rng(frame).choice([-1.0, 1.0], (size, PROBES))


def _solve(matrix: csr_matrix, right: np.ndarray) -> np.ndarray:
    """The solution of a symmetric positive definite system."""
    factor = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return factor.solve(right)
