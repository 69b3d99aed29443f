"""What the stages pass on to each other: frozen records of NumPy arrays. Tensors and Taichi fields never leave their rooms.

Letters and units are those of `conventions`. Arrays are float64 unless a field says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from .conventions import in_units
from .masks import Masks
from .materials import Material, Sheet


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
    """Distortion of the lens, k1 k2 p1 p2 k3 of OpenCV's model; () for none. All pixels are those of the pinhole, except in `filmed`."""

    def filmed(self, xy: np.ndarray) -> np.ndarray:
        """The pinhole's pixels (..., 2) -> where the lens shows them: pixels of the clip's file."""
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
    """A reason why results from a clip may be wrong, whatever is recovered from it."""

    severity: float
    """From 1 on the result cannot be trusted."""
    because: str
    do: str

    def __str__(self) -> str:
        return f"{self.because} {self.do}"


@dataclass(frozen=True)
class Doubts:
    """All `Doubt`s about a clip, as one record."""

    severity: np.ndarray
    """(D,), see `Doubt`."""
    because: tuple[str, ...]
    do: tuple[str, ...]

    @staticmethod
    def of(doubts: Iterable[Doubt]) -> Doubts:
        """The doubts, the worst first."""
        found = sorted(doubts, key=lambda one: -one.severity)
        return Doubts(np.array([one.severity for one in found]), tuple(one.because for one in found), tuple(one.do for one in found))

    def __iter__(self) -> Iterator[Doubt]:
        return (Doubt(float(severity), because, do) for severity, because, do in zip(self.severity, self.because, self.do))


@dataclass(frozen=True)
class Recognised:
    """M recognitions of points of frame 0 in later frames; a point may be recognised in several."""

    frame: np.ndarray
    """(M,) int32, the frame of each recognition, 1 to T."""
    first: np.ndarray
    """(M, 2) where the point is in frame 0 [px]."""
    xy: np.ndarray
    """(M, 2) where it is in `frame` [px]."""

    def moved(self, to: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Recognised:
        """The same in other pixel coordinates: `to` maps places (M, 2) in frames (M,)."""
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
    """(H, W, 3) uint8 RGB, the clip without the object, as far as it was seen (temporal median)."""
    masks: Masks
    """(T+1, H, W) bool, the object; an array is converted to `Masks`."""
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
    """(K,) bool: whether the track is the silhouette's centroid, not a surface point (bodies too small or too plain for corners)."""
    doubts: Doubts | None = None
    """Doubts about the clip itself; None in takes from before these were kept."""
    recognised: Recognised | None = None
    """Points found again where tracks get lost; None where this is not needed."""
    told: tuple[str, ...] = ()
    """Warnings about the clip and what was given with it that neither a doubt nor a verdict repeats."""

    def __post_init__(self) -> None:
        if not isinstance(self.masks, Masks):
            object.__setattr__(self, "masks", Masks.of(self.masks))

    @property
    def frames(self) -> int:
        """T, the number of frame intervals."""
        return len(self.xy) - 1


@dataclass(frozen=True)
class Mixture:
    """How the materials of a body's parts differ from the body's own material, by particle."""

    density: np.ndarray
    """(N,) factor on the material's density."""
    youngs_modulus: np.ndarray
    """(N,) factor on the material's Young's modulus."""
    poisson_ratio: np.ndarray
    """(N,) of the part itself."""
    retardation: np.ndarray
    """(N,) of the part itself [s], see `Material.retardation`."""


@dataclass(frozen=True)
class Particles:
    """The material points of a body at rest."""

    x: np.ndarray
    """(N, 3) [m]."""
    volume: np.ndarray
    """(N,) rest volume [m³]."""
    pinned: np.ndarray
    """(N,) bool: whether a particle is held where it is."""
    spacing: float
    """Mean distance of neighbouring particles [m]; the grid's dx follows from it."""
    stiffness: np.ndarray | None = None
    """(N,) factor on the Young's modulus of the particle's material; None is one everywhere."""
    mixture: Mixture | None = None
    """The materials of the body's parts; None if all have the body's material."""

    @property
    def relative_density(self) -> np.ndarray:
        """(N,) density in units of the body's material's."""
        return np.ones(len(self.x)) if self.mixture is None else self.mixture.density

    def density(self, material: Material) -> np.ndarray:
        """(N,) density [kg/m³] of a body of this material."""
        return material.density * self.relative_density

    def mass(self, material: Material) -> float:
        """Mass [kg] of a body of this material."""
        return material.density * float((self.volume * self.relative_density).sum())


@dataclass(frozen=True)
class Attachment:
    """Points that move with particles: point k = sum_j weight[k, j] x[index[k, j]]; weights are fixed in frame 0, and rows sum to one."""

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
    """(G, 4) unit quaternions w x y z of the axes' orientation."""
    opacity: np.ndarray
    """(G,) in 0..1."""
    sh: np.ndarray
    """(G, B, 3) spherical harmonics of the colour, degree 0 first (B = 1 for a colour that does not depend on the view)."""
    attachment: Attachment
    """How the centres move with the particles."""


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
    """The V vertices of a sheet as measured in each frame by itself, hardly tied to its neighbours, and the errors of that.

    Errors are displacements `modes` c, with a Gaussian c in each frame that is independent of the other frames'. Vertices share most of
    their error, because the whole sheet seems nearer or farther.
    """

    x: np.ndarray
    """(T+1, V, 3) [m]."""
    modes: np.ndarray
    """(V, R), smooth over the sheet, orthonormal over its areas [1/m]."""
    covariance: np.ndarray
    """(T+1, R, 3, R, 3) covariance of c, which has three components for each mode [m⁴]; 0 in frame 0, where the sheet is defined."""


@dataclass(frozen=True)
class Body:
    """The object as the solver moves it and as it looks (stage *build*)."""

    particles: Particles
    material: Material
    gaussians: Gaussians
    surface: Surface
    keypoints: Attachment
    """The key points of the observation's K tracks, attached to the particles (the paper's control, Eq. (13), generalised: see
    `observe/object/motion/control.py`)."""
    lifted: np.ndarray
    """(T+1, K, 3) key points P^t lifted to 3D [m], NaN where never seen or not placed: a display and a start, not the target of the fit."""
    tie_sigma: tuple[float, ...] = ()
    """For each key point, the uncertainty [px] of its place beyond that of tracks placed in frame 0; () if there is none."""
    sheet: Sheet | None = None
    """The properties of a thin sheet, whose particles are the vertices of `surface`; None for a solid."""
    path: np.ndarray | None = None
    """(T+1, V, 3) where the vertices of a sheet were seen [m]; None for a solid."""
    path_sigma: np.ndarray | None = None
    """(T+1, V) standard deviation of a coordinate of `path` [m]."""
    measured: Measured | None = None
    """The measurements of a sheet in single frames, from which `path` is a smooth motion; None for a solid."""
    told: tuple[str, ...] = ()
    """Notes on how it was built."""
    top_heavy: str = ""
    """The note on a head that is heavier than its stem can bear, which matters under gravity; "" if it is not."""


@dataclass(frozen=True)
class PointTargets:
    """Targets in 3D: where material points were in each frame."""

    x: np.ndarray
    """(T+1, K, 3) [m]."""
    visible: np.ndarray
    """(T+1, K) bool."""
    attachment: Attachment
    sigma: float | None = None
    """Standard deviation [m] per coordinate, or None to estimate it from the data."""
    covariance: np.ndarray | None = None
    """(K, 3, 3) covariance [m²] of each point's errors, the same in all frames, instead of `sigma`: depth is less certain than position in
    the image. Larger differences between neighbouring frames (shared noise, or motion too fast to tell from it) count in its place."""

    @property
    def stated(self) -> np.ndarray:
        """(K,) the given variance [m²] of each point's position, summed over its three coordinates; 0 where none was given."""
        if self.covariance is not None:
            return np.trace(self.covariance, axis1=1, axis2=2)
        return np.full(self.visible.shape[1], 3.0 * (self.sigma or 0.0) ** 2)


@dataclass(frozen=True)
class TrackTargets:
    """Targets in pixels: where surface points appeared in one camera's frames."""

    xy: np.ndarray
    """(T+1, K, 2) [px]."""
    visible: np.ndarray
    """(T+1, K) bool."""
    sigma: np.ndarray
    """(T+1, K) [px]."""
    camera: Camera
    attachment: Attachment
    offset: np.ndarray | None = None
    """(K,) standard deviation [px] of a constant error of each attachment, for tracks that begin after frame 0; None takes a small one."""


@dataclass(frozen=True)
class Recovery:
    """The result of the solve (stage *recover*), before it is distilled into a field."""

    outcome: Outcome
    force_density: np.ndarray
    """(T, N, 3) [N/m³] on the particles, constant over interval t, at x[t]."""
    deviation: np.ndarray
    """(T, N, 3) posterior standard deviation of the force density [N/m³]."""
    x: np.ndarray
    """(T+1, N, 3) simulated positions under that force [m]."""
    F: np.ndarray
    """(T+1, N, 3, 3) simulated deformation gradients."""
    v0: np.ndarray
    """(N, 3) estimated initial velocity [m/s]."""
    residual: np.ndarray
    """(T+1,) root mean square distance between simulated and observed points: [px] for tracks, [m] for points."""
    residual_unit: str
    iterations: int
    seconds: float
    notes: list[str] = field(default_factory=list)
    """What the user should know: capped stiffness, unseen directions, dropped tracks."""
    youngs_modulus: float | None = None
    """Young's modulus of a held body, from its motion [Pa]; None for the material's: it was not free, or the clip does not determine it."""
    stiffness_deviation: float | None = None
    """Standard deviation of the logarithm of `youngs_modulus`, according to the fit itself."""
    stiffness: np.ndarray | None = None
    """(N,) further factor on Young's modulus, for a held body whose section is stiffer one way than the other; None is one everywhere."""
    clamp_depth: float = 0.0
    """Clamp depth [grid cells], as in the settings."""
    cell: float = 0.0
    """Grid spacing of the simulation [m]."""
    section: np.ndarray | None = None
    """(2,) a and b of `recovery.solve.stiffness`, if the clip determines the stiffness."""
    section_axes: np.ndarray | None = None
    """(2, 3) the directions u and v of a and b."""
    held_covariance: np.ndarray | None = None
    """(4, 4) covariance of log E, clamp depth [grid cells], a and b, according to the fit itself."""
    substeps: int | None = None
    """Substeps per frame. The solver's damping depends on them: with another number, the same force swings a body differently."""
    wild: np.ndarray | None = None
    """(T,) bool: frames at the clip's ends in which the force is not seen, because the tracks there do not fit the motion in the other
    frames; None if there are none."""
    clamp_moves: bool = False
    """Whether the held part moves as its particles do in `x`, rather than stands still."""
    borne: np.ndarray | None = None
    """(3,) gravity [m/s²] that a held body bears in its shape of frame 0, see `recovery.targets.weight`; None if gravity acts on it."""


def body_as_found(particles: Particles, recovery: Recovery) -> Particles:
    """The body with the distribution of stiffness that the recovery found."""
    if particles.stiffness is None or recovery.stiffness is None:
        return replace(particles, stiffness=particles.stiffness if recovery.stiffness is None else recovery.stiffness)
    return replace(particles, stiffness=particles.stiffness * recovery.stiffness)


def as_found(material: Material, recovery: Recovery) -> Material:
    """`material` with the stiffness that the recovery found for the body; the recovered field belongs to that stiffness."""
    if recovery.youngs_modulus is None:
        return material
    source = f"{material.source}; Young's modulus: found from the motion, given {in_units(material.youngs_modulus, 'Pa')}"
    return replace(material, youngs_modulus=recovery.youngs_modulus, source=source)
