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
from dataclasses import astuple, dataclass

import numpy as np
from scipy.linalg import eigh

from ....conventions import frame_named
from ....errors import ObjectError
from ....masks import Masks
from ....progress import Journal, NoProgress, Progress
from ....records import Measured
from ..motion.lifting import Sight
from .farthest import farthest
from .frame import FrameSolver, Prior, random_signs
from .mesh import SheetMesh
from .template import LOOSEST, Allowed
from .view import OUTLIER, View

SWIFT, SLOWEST = 60.0, 1.0
"""Standard deviation of the acceleration [m/s²] while only the motion before a frame is known: what a gale does to light cloth; and the
least that is estimated from the path."""
SWEEPS = 2
"""How often every frame is solved between its neighbours: first backwards, then forwards."""
FEWEST = 8
"""Least number of tracks on the sheet in frame 0, and of points from which the farthest shape is found."""
ELSEWHERE = 0.3
"""Root mean square distance of another start [mean edge] from which it is tried."""
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


class Follower:
    """Solves for a sheet's path, frame by frame, from what the cameras saw of it in T+1 frames."""

    def __init__(self, mesh: SheetMesh, views: Sequence[View], fps: float) -> None:
        self.mesh, self.views, self.fps = mesh, views, fps
        self.solver = FrameSolver(mesh, views)

    def ahead(self, path: np.ndarray) -> Prior:
        """The prior of frame t from the path (t, V, 3) [m] before it."""
        straight = path[-1] if len(path) == 1 else 2.0 * path[-1] - path[-2]
        return self.solver.prior(len(path), straight, (self.fps**2 / SWIFT) ** 2)

    def begin(self, frame: int, path: np.ndarray) -> np.ndarray:
        """Vertices (V, 3) [m] of a new frame, whose path before it is (t, V, 3): the best of the solutions that start from its straight
        continuation and from the farthest shapes; what its shape is allowed is learnt along with it."""
        motion, bends = self.ahead(path), self.solver.template.bends / LOOSEST.curvature**2
        seen = [view for view in self.views if view.count(frame) >= FEWEST]
        starts = [motion.x, *(farthest(self.mesh, view, frame, bends) for view in seen)]
        x = self.solver.best(frame, starts, motion)
        for _ in range(LEARNT):
            if abs(math.log(self.solver.learn(frame, x, motion))) < CURVATURE:
                break
            motion = self.ahead(path)
            x = self.solver.solve(frame, x, motion)
        return x

    def between(self, path: np.ndarray, frame: int, slowest: float = SLOWEST) -> Prior:
        """The prior of a frame from the others of the path (T+1, V, 3) [m].

        The standard deviation of the acceleration is that of the path round the frame: a frame that is wrong does not pull its neighbours
        along, and where the sheet hardly moves, they tell its place closely. slowest: the least of it [m/s²].
        """
        total, weight, apart = np.zeros_like(path[0]), 0.0, []
        for middle in range(max(1, frame - 1), min(frame + 1, len(path) - 2) + 1):
            own = -2.0 if middle == frame else 1.0
            second = path[middle - 1] - 2.0 * path[middle] + path[middle + 1]
            total, weight = total - own * (second - own * path[frame]), weight + own**2
            apart.append(float((second**2).mean()))
        acceleration = min(SWIFT, max(slowest, math.sqrt(max(apart)) * self.fps**2))
        return self.solver.prior(frame, total / weight, weight * (self.fps**2 / acceleration) ** 2)

    def revise(self, frame: int, path: np.ndarray) -> np.ndarray:
        """Vertices (V, 3) [m] of a frame of the path (T+1, V, 3), solved anew between its neighbours: also from where these say that it
        is, if that is elsewhere; what its shape is allowed is learnt anew."""
        motion, own, last = self.between(path, frame), path[frame], len(path) - 1
        others = [motion.x]
        others += [2.0 * path[frame - 1] - path[frame - 2]] if frame > 1 else []
        others += [2.0 * path[frame + 1] - path[frame + 2]] if frame < last - 1 else []
        new = [one for one in others if math.sqrt(float(((one - own) ** 2).sum(axis=1).mean())) > ELSEWHERE * self.mesh.spacing]
        x = self.solver.best(frame, [own, *new], motion)
        self.solver.learn(frame, x, motion)
        return x

    def deviation(self, path: np.ndarray, frame: int) -> np.ndarray:
        """Posterior standard deviation (V,) of the vertices' coordinates [m] in a frame of a path (T+1, V, 3) [m].

        The diagonal of the inverse Hessian is estimated with random signs (Bekas et al., Appl. Numer. Math. 57, 2007), and averaged over
        the faces round a vertex.
        """
        hessian = self.solver.linearise(frame, path[frame], self.between(path, frame), OUTLIER)[0]
        signs = random_signs(frame, path[0].size)
        variance = (self.solver.solve_linear(hessian, signs) * signs).mean(axis=1).reshape(-1, 3).mean(axis=1)
        faces = self.mesh.faces
        around = np.bincount(faces.ravel(), np.repeat(variance[faces].sum(axis=1), 3)) / (3.0 * np.bincount(faces.ravel()))
        return np.sqrt(np.maximum(around, 0.0))

    def measured(self, path: np.ndarray) -> Measured:
        """What each frame of a path (T+1, V, 3) [m] determines by itself: its solution with next to no tie to its neighbours.

        Smoothing the motion is biased where a frame determines little, such as the distance of a sheet seen edge-on. Neighbouring frames
        share such an error, and the acceleration that it implies would be taken for a gust.
        """
        areas, count = self.mesh.areas(), min(MODES, len(self.mesh.x))
        modes = eigh(self.solver.template.bends[::3, ::3].toarray(), np.diag(areas), subset_by_index=(0, count - 1))[1]
        onto = np.kron(areas[:, None] * modes, np.eye(3))
        x, covariance = path.copy(), np.zeros((len(path), *(count, 3) * 2))
        for frame in range(1, len(path)):
            loose, scale = self.between(path, frame, SWIFT), self.solver.outlier(frame, path[frame])
            hessian, gradient = self.solver.linearise(frame, path[frame], loose, scale)
            solved = self.solver.solve_linear(hessian, np.column_stack([onto, -gradient]))
            x[frame] += solved[:, -1].reshape(-1, 3)
            covariance[frame] = (onto.T @ solved[:, :-1]).reshape(covariance.shape[1:])
        return Measured(x, modes, covariance)


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
    path = np.repeat(mesh.x[None], frames, axis=0)
    loop = journal.loop("sheet")
    done, kept = loop.resume()
    if done:
        path, follower.solver.allowed = kept["path"], [Allowed(*map(float, one)) for one in kept["allowed"]]
        for number, view in enumerate(views):
            view.put(kept[f"places {number}"])

    def state() -> dict[str, np.ndarray]:
        places = {f"places {number}": view.places for number, view in enumerate(views)}
        return {"path": path, "allowed": np.array([astuple(one) for one in follower.solver.allowed]), **places}

    order = list(range(1, frames))
    steps = [(0, t) for t in order] + [(sweep, t) for sweep in range(1, SWEEPS + 1) for t in order[:: (-1) ** sweep]]
    for number, (sweep, t) in enumerate(steps[done:], start=done + 1):
        progress.update(number / len(steps), f"following the sheet, frame {t}" if sweep == 0 else f"frame {t} between its neighbours")
        path[t] = follower.begin(t, path[:t]) if sweep == 0 else follower.revise(t, path)
        if not np.isfinite(path[t]).all():
            raise ObjectError(f"The sheet is lost in {frame_named(t)}.", "Check mask and depth of frame 0, or use --form solid.")
        for view in views:
            view.place(t, path[t])
        loop.reached(number, state)
    deviation = [follower.deviation(path, t) for t in range(1, frames)]
    return Followed(path, np.stack([deviation[0], *deviation]), follower.measured(path), [view.places for view in views])


def _require_tracks(views: Sequence[View]) -> None:
    placed = sum(int(np.isfinite(view.places[:, 0]).sum()) for view in views)
    if placed < FEWEST:
        raise too_few(placed)


def too_few(placed: int) -> ObjectError:
    """The error for a sheet on which only `placed` tracked points lie in frame 0."""
    lie = "No tracked point lies" if placed == 0 else "Only one tracked point lies" if placed == 1 else f"Only {placed} tracked points lie"
    return ObjectError(
        f"{lie} on the sheet in frame 0; its shape needs {FEWEST}.",
        "A sheet needs texture: a print, a weave, seams. Begin where it shows its face and not its edge, give --tracks of your own, or "
        "recover it with --form solid.",
    )
