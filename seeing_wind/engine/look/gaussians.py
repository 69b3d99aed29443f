"""3D Gaussians of the object in frame 0 and how they deform (paper, section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, sparse
from scipy.spatial.transform import Rotation

from ..masks import box_of, rows_columns
from ..observe.object.motion.control import attach
from ..observe.object.shape.particles import columns_of
from ..observe.object.shape.relief import MAX_SLANT, Relief, sample
from ..records import Camera, Gaussians

COUNT = 12000
"""Number of Gaussians of an object with more pixels than this; a smaller object has one per pixel."""

SH0 = 0.28209479177387814
"""The constant spherical harmonic, 1 / (2 sqrt(pi)): colour = 0.5 + SH0 * sh[0]."""

INITIAL_OPACITY = 0.9
INITIAL_SIGMA = 0.45
"""Standard deviation along the surface, over the distance between neighbours."""
FLATTENING = 0.2
"""Standard deviation normal to the surface, over the smaller one along it: pixels show a surface, not a volume."""


def pixel_aligned(relief: Relief, image: np.ndarray, particles_x: np.ndarray, count: int = COUNT) -> Gaussians:
    """Gaussians G^0 from the pixels' point cloud: flat discs on the visible surface with the frame's colours.

    Args:
        image: (H, W, 3) uint8 RGB, frame 0; particles_x: (N, 3) the particles that the Gaussians are attached to [m]; count: at most
            about this many.
    """
    stride = max(1.0, float(np.sqrt(relief.mask.sum() / count)))
    if stride == 1.0:
        xy = np.argwhere(relief.mask)[:, ::-1].astype(float)
    else:
        xy = columns_of(relief, np.eye(2), stride, np.zeros_like(relief.mask)).xy
    x = relief.points(xy, 0.0)
    frame, size = surface_frames(relief, xy)
    along = INITIAL_SIGMA * stride * size
    scale = np.column_stack([along, FLATTENING * along.min(axis=1)])
    rotation = Rotation.from_matrix(frame).as_quat()[:, [3, 0, 1, 2]]
    colour = _colours(image, relief.mask, xy, stride)
    return Gaussians(
        x=x,
        scale=scale,
        rotation=rotation,
        opacity=np.full(len(x), INITIAL_OPACITY),
        sh=((colour - 0.5) / SH0)[:, None, :],
        attachment=attach(x, particles_x),
    )


def surface_frames(relief: Relief, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Local frames of the visible surface at pixels (G, 2).

    Returns:
        frames (G, 3, 3) with columns tangent, tangent, normal (towards the camera); and size (G, 2), metres per pixel along the tangents.
    """
    smooth = ndimage.gaussian_filter(relief.front, 1.0)

    def points(shift: tuple[float, float]) -> np.ndarray:
        return relief.camera.unproject(xy + shift, sample(smooth, xy + shift))

    du, dv = 0.5 * (points((1.0, 0.0)) - points((-1.0, 0.0))), 0.5 * (points((0.0, 1.0)) - points((0.0, -1.0)))
    facing = relief.front[relief.mask].mean() / np.sqrt(relief.camera.fx * relief.camera.fy)
    e1 = du / np.linalg.norm(du, axis=1, keepdims=True)
    across = dv - (dv * e1).sum(axis=1, keepdims=True) * e1
    e2 = across / np.linalg.norm(across, axis=1, keepdims=True)
    normal = np.cross(e1, e2)  # x right, y down: away from the camera
    frames = np.stack([e1, -e2, -normal], axis=2)
    size = np.stack([np.linalg.norm(du, axis=1), np.linalg.norm(across, axis=1)], axis=1)
    return frames, np.clip(size, 0.2 * facing, MAX_SLANT * facing)


def covariances(gaussians: Gaussians, F: np.ndarray) -> np.ndarray:
    """Covariances of the deformed Gaussians, Sigma^t = F Sigma^0 F^T, Eq. (8).

    Args:
        F: (N, 3, 3) deformation gradients of the particles; those of the Gaussians are blended with their attachment's weights.

    Returns:
        (G, 3, 3) [m²].
    """
    blended = blended_gradients(gaussians, F)
    return blended @ rest_covariances(gaussians) @ blended.transpose(0, 2, 1)


def blended_gradients(gaussians: Gaussians, F: np.ndarray) -> np.ndarray:
    """Deformation gradients (G, 3, 3) of the Gaussians from those of the particles (N, 3, 3), by their attachment's weights."""
    index, weight = gaussians.attachment.index, gaussians.attachment.weight
    # A sparse product, because gathering 16 gradients for every Gaussian takes several times as long.
    ride = sparse.csr_matrix((weight.ravel(), index.ravel(), np.arange(0, index.size + 1, index.shape[1])), (len(index), len(F)))
    return (ride @ np.asarray(F).reshape(-1, 9)).reshape(-1, 3, 3)


def rest_covariances(gaussians: Gaussians) -> np.ndarray:
    """Sigma^0 = R S² R^T, (G, 3, 3) [m²]."""
    axes = axes_of(gaussians) * gaussians.scale[:, None, :]
    return axes @ axes.transpose(0, 2, 1)


def axes_of(gaussians: Gaussians) -> np.ndarray:
    """(G, 3, 3) the unit axes of the Gaussians as columns."""
    return Rotation.from_quat(gaussians.rotation[:, [1, 2, 3, 0]]).as_matrix()


def _colours(image: np.ndarray, mask: np.ndarray, xy: np.ndarray, stride: float) -> np.ndarray:
    """(G, 3) mean colour of the object's pixels around pixels (G, 2), over about the width of a stride."""
    width = max(0.3 * stride, 0.1)
    weight = ndimage.gaussian_filter(mask.astype(float), width) + 1e-9
    channels = [ndimage.gaussian_filter(np.where(mask, image[..., c] / 255.0, 0.0), width) / weight for c in range(3)]
    return np.stack([np.clip(sample(channel, xy), 0.0, 1.0) for channel in channels], axis=1)


@dataclass(frozen=True)
class Crop:
    """A part of a frame, reduced by an integer factor."""

    camera: Camera
    """The camera of the reduced part."""
    box: tuple[int, int, int, int]
    """x0, y0, x1, y1 [px], ends exclusive."""
    reduce: int

    @staticmethod
    def around(mask: np.ndarray, camera: Camera, frame: int, margin: int, pixels: int) -> Crop:
        """The box of a mask (H, W) bool, widened by `margin` [px], reduced to at most about `pixels`."""
        x0, y0, x1, y1 = box_of(mask, margin)
        reduce = max(1, int(np.ceil(np.sqrt((x1 - x0) * (y1 - y0) / pixels))))
        return Crop(view_camera(camera, (x0, y0, x1, y1), reduce, frame), (x0, y0, x1, y1), reduce)

    def cut(self, image: np.ndarray) -> np.ndarray:
        """The part of a whole frame (H, W, ...)."""
        return image[rows_columns(self.box)]

    def reduced(self, part: np.ndarray) -> np.ndarray:
        """Means (h, w, channels) over blocks of pixels of a `part` returned by `cut`."""
        height, width, reduce = self.camera.height, self.camera.width, self.reduce
        return part[: height * reduce, : width * reduce].reshape(height, reduce, width, reduce, -1).mean(axis=(1, 3))


def view_camera(camera: Camera, box: tuple[int, int, int, int], reduce: int, frame: int = 0) -> Camera:
    """The camera of a frame cropped to box x0 y0 x1 y1 (exclusive) and reduced by an integer factor."""
    x0, y0, x1, y1 = box
    return Camera(
        width=(x1 - x0) // reduce,
        height=(y1 - y0) // reduce,
        fx=camera.fx / reduce,
        fy=camera.fy / reduce,
        # Pixel centres are at integers: the reduced pixel i covers reduce * i - 0.5 to reduce * (i + 1) - 0.5.
        cx=(camera.cx - x0 + 0.5) / reduce - 0.5,
        cy=(camera.cy - y0 + 0.5) / reduce - 0.5,
        camera_to_world=camera.pose(frame),
    )
