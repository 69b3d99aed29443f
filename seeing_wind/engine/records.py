"""What the stages hand on to each other: frozen records of NumPy arrays. Tensors and Taichi fields never leave their rooms.

Letters and units are those of `conventions`. Arrays are float64 unless a field says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from .conventions import in_units
from .masks import Masks
from .materials import Material as Material
from .materials import Sheet


class Outcome(StrEnum):
    """How a solve ended. Only `diverged` leaves no usable result."""

    CONVERGED = "converged"
    MAX_ITERATIONS = "max_iterations"
    DIVERGED = "diverged"
    CANCELLED = "cancelled"


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with OpenCV axes, standing still or moving."""

    width: int
    height: int
    fx: float
    """Focal length [px], as are fy, cx, cy; pixel centres are at integers."""
    fy: float
    cx: float
    cy: float
    camera_to_world: np.ndarray
    """(4, 4) for a static camera, (T+1, 4, 4) for a moving one."""
    distortion: tuple[float, ...] = ()
    """The lens, k1 k2 p1 p2 k3 of OpenCV's model; () for none. Pixels everywhere are those of the pinhole, except in `filmed`."""

    def filmed(self, xy: np.ndarray) -> np.ndarray:
        """Where the lens showed the pinhole's pixels (..., 2): pixels of the clip's file."""
        if not any(self.distortion):
            return np.asarray(xy, dtype=np.float64)
        k1, k2, p1, p2, k3 = self.distortion
        x, y = (xy[..., 0] - self.cx) / self.fx, (xy[..., 1] - self.cy) / self.fy
        r2 = x**2 + y**2
        radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        bent_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x**2)
        bent_y = y * radial + p1 * (r2 + 2.0 * y**2) + 2.0 * p2 * x * y
        return np.stack([self.fx * bent_x + self.cx, self.fy * bent_y + self.cy], axis=-1)

    def pose(self, frame: int) -> np.ndarray:
        """camera_to_world (4, 4) at frame `frame`."""
        poses = np.asarray(self.camera_to_world, dtype=np.float64)
        return poses if poses.ndim == 2 else poses[frame]

    def project(self, points: np.ndarray, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """World points (..., 3) [m] at frame `frame` -> pixels (..., 2) and depth along the view axis (...,) [m]."""
        pose = self.pose(frame)
        local = (np.asarray(points, dtype=np.float64) - pose[:3, 3]) @ pose[:3, :3]
        depth = local[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            x = self.fx * local[..., 0] / depth + self.cx
            y = self.fy * local[..., 1] / depth + self.cy
        return np.stack([x, y], axis=-1), depth

    def projection_jacobian(self, points: np.ndarray, frame: int = 0) -> np.ndarray:
        """d(pixel)/d(world point): (..., 2, 3) [px/m] for world points (..., 3) at frame `frame`."""
        pose = self.pose(frame)
        local = (np.asarray(points, dtype=np.float64) - pose[:3, 3]) @ pose[:3, :3]
        x, y, z = np.moveaxis(local, -1, 0)
        zero = np.zeros_like(z)
        rows = np.stack(
            [np.stack([self.fx / z, zero, -self.fx * x / z**2], -1), np.stack([zero, self.fy / z, -self.fy * y / z**2], -1)], -2
        )
        return rows @ pose[:3, :3].T

    def unproject(self, xy: np.ndarray, depth: np.ndarray, frame: int = 0) -> np.ndarray:
        """Pixels (..., 2) with depth (...,) [m] along the view axis -> world points (..., 3), the paper's pi^-1 (section 3.4)."""
        pose = self.pose(frame)
        xy, depth = np.asarray(xy, dtype=np.float64), np.asarray(depth, dtype=np.float64)
        local = np.stack([(xy[..., 0] - self.cx) / self.fx * depth, (xy[..., 1] - self.cy) / self.fy * depth, depth], axis=-1)
        return local @ pose[:3, :3].T + pose[:3, 3]


@dataclass(frozen=True)
class Doubt:
    """What makes a clip less trustworthy, whatever is looked for in it."""

    severity: float
    """From 1 on the result cannot be trusted."""
    because: str
    do: str

    def __str__(self) -> str:
        return f"{self.because} {self.do}"


@dataclass(frozen=True)
class Doubts:
    """Those of a clip."""

    severity: np.ndarray
    """(D,), see `Doubt`."""
    because: tuple[str, ...]
    do: tuple[str, ...]

    @staticmethod
    def of(doubts: Iterable[Doubt]) -> Doubts:
        """The worst first."""
        found = sorted(doubts, key=lambda one: -one.severity)
        return Doubts(np.array([one.severity for one in found]), tuple(one.because for one in found), tuple(one.do for one in found))

    def __iter__(self) -> Iterator[Doubt]:
        return (Doubt(float(severity), because, do) for severity, because, do in zip(self.severity, self.because, self.do))


@dataclass(frozen=True)
class Recognised:
    """M points of frame 0 that were recognised in later frames; the same point often in several."""

    frame: np.ndarray
    """(M,) int32, the frame of each, 1 to T."""
    first: np.ndarray
    """(M, 2) where it is in frame 0 [px], and"""
    xy: np.ndarray
    """(M, 2) in that frame [px]."""

    def moved(self, to: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Recognised:
        """In other pixels: `to` maps places (M, 2) in frames (M,)."""
        return Recognised(self.frame, to(self.first, np.zeros_like(self.frame)), to(self.xy, self.frame))


@dataclass(frozen=True)
class Observation:
    """What was seen in the clip (stage *observe*)."""

    clip: str
    """The clip's path as the user gave it."""
    fps: float
    first_frame: int
    """Index in the file of frame 0."""
    camera: Camera
    image: np.ndarray
    """(H, W, 3) uint8 RGB, frame 0."""
    background: np.ndarray
    """(H, W, 3) uint8 RGB, the clip without the object as far as it was seen (temporal median)."""
    masks: Masks
    """(T+1, H, W) bool, the object; an array is packed."""
    depth: np.ndarray
    """(H, W) float32, metres along the view axis in frame 0, infinite off the object."""
    pin: np.ndarray
    """(H, W) bool, where the object is held in frame 0; all False for a free body."""
    xy: np.ndarray
    """(T+1, K, 2) tracked points [px]."""
    visible: np.ndarray
    """(T+1, K) bool."""
    sigma: np.ndarray
    """(T+1, K) standard deviation of a track [px]."""
    on_centroid: np.ndarray
    """(K,) bool: the track is the silhouette's centroid, not a surface point (bodies too small or too plain for corners)."""
    doubts: Doubts | None = None
    """What the clip itself makes doubtful; None in takes from before it was kept."""
    recognised: Recognised | None = None
    """Points that are found again where tracks get lost; None where they do not."""

    def __post_init__(self) -> None:
        if not isinstance(self.masks, Masks):
            object.__setattr__(self, "masks", Masks.of(self.masks))

    @property
    def frames(self) -> int:
        """T, the number of frame intervals."""
        return len(self.xy) - 1


@dataclass(frozen=True)
class Particles:
    """The material points of a body at rest."""

    x: np.ndarray
    """(N, 3) [m]."""
    volume: np.ndarray
    """(N,) rest volume [m³]."""
    pinned: np.ndarray
    """(N,) bool: held where they are."""
    spacing: float
    """Mean distance of neighbouring particles [m]; the grid's dx follows from it."""
    stiffness: np.ndarray | None = None
    """(N,) factor on the material's Young's modulus; None is one everywhere."""


@dataclass(frozen=True)
class Attachment:
    """Points that ride on particles: point k = sum_j weight[k, j] x[index[k, j]], weights fixed in frame 0, rows summing to one."""

    index: np.ndarray
    """(K, J) int32."""
    weight: np.ndarray
    """(K, J)."""

    def follow(self, x: np.ndarray) -> np.ndarray:
        """Particle positions (..., N, 3) -> attached points (..., K, 3)."""
        return np.einsum("kj,...kjc->...kc", self.weight, x[..., self.index, :])

    def matrix(self, particles: int) -> np.ndarray:
        """The same as a dense matrix (K, N)."""
        matrix = np.zeros((len(self.index), particles))
        np.add.at(matrix, (np.arange(len(matrix))[:, None], self.index), self.weight)
        return matrix


@dataclass(frozen=True)
class Gaussians:
    """3D Gaussians G^0 of the object in frame 0 (paper, section 3.1)."""

    x: np.ndarray
    """(G, 3) centres [m]."""
    scale: np.ndarray
    """(G, 3) standard deviations along the axes [m]."""
    rotation: np.ndarray
    """(G, 4) unit quaternions w x y z: the axes."""
    opacity: np.ndarray
    """(G,) in 0..1."""
    sh: np.ndarray
    """(G, B, 3) spherical harmonics, degree 0 first (B = 1 for a colour that does not depend on the view)."""
    attachment: Attachment
    """How the centres ride on the particles."""


@dataclass(frozen=True)
class Surface:
    """The object's surface as a triangle mesh, for display and for baking in Blender."""

    vertices: np.ndarray
    """(V, 3) in frame 0 [m]."""
    triangles: np.ndarray
    """(M, 3) int32."""
    uv: np.ndarray
    """(V, 2) in 0..1, Blender's convention (origin bottom left), into frame 0."""
    attachment: Attachment


@dataclass(frozen=True)
class Measured:
    """Where each frame by itself, hardly tied to its neighbours, puts the V vertices of a sheet, and how far that may be off.

    Errors are displacements `modes` c with a Gaussian c in each frame, apart from the other frames': vertices share most of their error,
    as a whole sheet seems nearer or farther.
    """

    x: np.ndarray
    """(T+1, V, 3) [m]."""
    modes: np.ndarray
    """(V, R), smooth over the sheet, orthonormal over its areas [1/m]."""
    covariance: np.ndarray
    """(T+1, R, 3, R, 3) of c, which has three components for each mode [m⁴]; 0 in frame 0, where the sheet is defined."""


@dataclass(frozen=True)
class Body:
    """The object as physics sees it (stage *build*)."""

    particles: Particles
    material: Material
    gaussians: Gaussians
    surface: Surface
    keypoints: Attachment
    """The K tracked points of the observation on the particles (the paper's control, Eq. (13), generalised: see
    `observe/object/motion/control.py`)."""
    lifted: np.ndarray
    """(T+1, K, 3) key points P^t lifted to 3D [m], NaN where never seen or not placed: a display and a start, not the target of the fit."""
    tie_sigma: tuple[float, ...] = ()
    """Per key point, how uncertain [px] its place is beyond what tracks placed in frame 0 have; () where all are certain."""
    sheet: Sheet | None = None
    """Of a thin sheet, whose particles are the vertices of `surface`; None for a solid."""
    path: np.ndarray | None = None
    """(T+1, V, 3) where the vertices of a sheet were seen [m]; None for a solid."""
    path_sigma: np.ndarray | None = None
    """(T+1, V) standard deviation of a coordinate of `path` [m]."""
    measured: Measured | None = None
    """What the frames say of a sheet, of which `path` makes a smooth motion; None for a solid."""


@dataclass(frozen=True)
class PointTargets:
    """Where material points went, in 3D."""

    x: np.ndarray
    """(T+1, K, 3) [m]."""
    visible: np.ndarray
    """(T+1, K) bool."""
    attachment: Attachment
    sigma: float | None = None
    """Standard deviation [m] per coordinate, or None to estimate it from the data."""
    covariance: np.ndarray | None = None
    """(K, 3, 3) [m²] of every point's errors, the same in all frames, in the place of `sigma`: depth is seen less well than place.
    Where neighbouring frames differ by more, which is noise that points share or a motion too fast to tell from it, that counts."""

    @property
    def stated(self) -> np.ndarray:
        """(K,) variance [m²] of each point's place, its three coordinates together, as it was given; 0 where it was not."""
        if self.covariance is not None:
            return np.trace(self.covariance, axis1=1, axis2=2)
        return np.full(self.visible.shape[1], 3.0 * (self.sigma or 0.0) ** 2)


@dataclass(frozen=True)
class TrackTargets:
    """Where surface points appeared in one camera's frame."""

    xy: np.ndarray
    """(T+1, K, 2) [px]."""
    visible: np.ndarray
    """(T+1, K) bool."""
    sigma: np.ndarray
    """(T+1, K) [px]."""
    camera: Camera
    attachment: Attachment
    offset: np.ndarray | None = None
    """(K,) standard deviation [px] of a constant error of each attachment, for tracks that begin after frame 0; None leaves it small."""


@dataclass(frozen=True)
class Recovery:
    """What the solve found (stage *recover*), before it is distilled into a field."""

    outcome: Outcome
    force_density: np.ndarray
    """(T, N, 3) [N/m³] on the particles, held over frame t, queried at x[t]."""
    deviation: np.ndarray
    """(T, N, 3) posterior standard deviation of the force density [N/m³]."""
    x: np.ndarray
    """(T+1, N, 3) simulated positions under that force [m]."""
    F: np.ndarray
    """(T+1, N, 3, 3) simulated deformation gradients."""
    v0: np.ndarray
    """(N, 3) estimated initial velocity [m/s]."""
    residual: np.ndarray
    """(T+1,) root mean square distance of simulated and observed points: [px] for tracks, [m] for points."""
    residual_unit: str
    iterations: int
    seconds: float
    notes: list[str] = field(default_factory=list)
    """What the user should know: capped stiffness, unseen directions, dropped tracks."""
    youngs_modulus: float | None = None
    """What the motion of a held body fits [Pa]; None where it was not free or the clip does not tell it: then the material's holds."""
    stiffness_deviation: float | None = None
    """Standard deviation of the logarithm of `youngs_modulus`, by the fit itself."""
    stiffness: np.ndarray | None = None
    """(N,) factor on Young's modulus besides, of a held body whose section is stiffer one way than the other; None is one everywhere."""
    clamp_depth: float = 0.0
    """As in the settings: where the held part began to be held."""
    cell: float = 0.0
    """Grid spacing of the simulation [m]."""
    section: np.ndarray | None = None
    """(2,) a and b of `recovery.solve.stiffness`, where the clip tells the stiffness."""
    section_axes: np.ndarray | None = None
    """(2, 3) the directions u and v that they belong to."""
    held_covariance: np.ndarray | None = None
    """(4, 4) of log E, clamp depth [grid cells], a and b, by the fit itself."""
    substeps: int | None = None
    """Per frame. A solver's damping hangs on them: the same force swings a body differently with others."""
    wild: np.ndarray | None = None
    """(T,) bool: frames at the clip's ends in which the force is not seen, as the tracks there leave the motion of all others; None where
    there are none."""
    clamp_moves: bool = False
    """Whether what is held goes the way that its particles have in `x`, rather than stands still."""
    borne: np.ndarray | None = None
    """(3,) gravity [m/s²] that a held body bears in the shape of frame 0, see `recovery.targets.weight`; None where it acts on it."""


def body_as_found(particles: Particles, recovery: Recovery) -> Particles:
    """The body with its stiffness spread as the recovery found it."""
    if particles.stiffness is None or recovery.stiffness is None:
        return replace(particles, stiffness=particles.stiffness if recovery.stiffness is None else recovery.stiffness)
    return replace(particles, stiffness=particles.stiffness * recovery.stiffness)


def as_found(material: Material, recovery: Recovery) -> Material:
    """`material` with the stiffness that the recovery found for the body: its field belongs to that one."""
    if recovery.youngs_modulus is None:
        return material
    source = f"{material.source}; Young's modulus: found from the motion, given {in_units(material.youngs_modulus, 'Pa')}"
    return replace(material, youngs_modulus=recovery.youngs_modulus, source=source)
