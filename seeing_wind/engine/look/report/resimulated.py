"""resimulated.mp4: the object as the recovered force moves it, over the clip's clean background, and how alike that is to the clip.

The motion is the simulation's. The look is fitted to the clip along that motion, and the background is lit as it was filmed: both are
measured, not predicted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from ...errors import ClipError
from ...observe.clip.lens import Lens
from ...progress import NoProgress, Progress
from ...records import Body, Camera, Observation, Recovery
from ...take import Take
from ..gaussians import covariances
from ..over_clip import Footage, fit_appearance
from ..splatting import picture
from .backdrop import backdrops
from .video import video_writer

REACH = 3.0
"""Standard deviations of a Gaussian that the part of the picture which is rendered reaches beyond its centre."""

SSIM_SIGMA, SSIM_SIZE = 1.5, 11
"""Window of the structural similarity (Wang et al. 2004) [px]."""


def write_resimulated(
    take: Take, frames: np.ndarray, observation: Observation, body: Body, recovery: Recovery, progress: Progress | None = None
) -> dict[str, float]:
    """Render the Gaussians, carried by the simulated particles and their F (Eq. (8)), into resimulated.mp4 of the take.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB, the clip's pictures as filmed.

    Returns:
        `first_psnr`, inside the mask of picture 0 [dB]; `psnr` [dB] and `ssim`, means over pictures 1 to T of the boxes round the object.

    Raises:
        ClipError: when `frames` ends before picture T.
        TakeError, MissingPackage: when the video cannot be written.
    """
    progress = progress or NoProgress()
    straight = _straight(frames, observation, recovery, progress)
    height, width = straight.shape[1:3]
    likeness: list[tuple[float, float]] = []
    first = float("nan")
    with take.writing("resimulated.mp4") as path, video_writer(path, observation.fps, (width // 2 * 2, height // 2 * 2)) as writer:
        for t, image in enumerate(resimulated(straight, observation, body, recovery)):
            progress.update((t + 1) / len(recovery.x), "resimulated.mp4")
            writer.write(cv2.cvtColor(image[: height // 2 * 2, : width // 2 * 2], cv2.COLOR_RGB2BGR))
            mask = observation.masks[t]
            if t == 0:
                first = psnr(straight[0][mask], image[mask]) if mask.any() else first
            elif mask.any():
                rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
                box = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
                likeness.append((psnr(straight[t][box], image[box]), ssim(straight[t][box], image[box])))
    means = np.mean(likeness, axis=0) if likeness else (float("nan"), float("nan"))
    figures = {"first_psnr": first, "psnr": float(means[0]), "ssim": float(means[1])}
    return {name: value for name, value in figures.items() if np.isfinite(value)}


def resimulated(straight: np.ndarray, observation: Observation, body: Body, recovery: Recovery) -> Iterator[np.ndarray]:
    """Pictures 0 to T (H, W, 3) uint8 RGB of the simulated body over what was behind it (`backdrops`)."""
    behind = backdrops(straight, observation)
    for t, (x, F) in enumerate(zip(recovery.x, recovery.F)):
        yield _over(body, observation.camera, t, x, F, behind(t))


def look_over_clip(
    frames: np.ndarray, observation: Observation, body: Body, recovery: Recovery, progress: Progress | None = None
) -> Body:
    """The body with Gaussians whose look fits the whole clip along the simulated motion (`object.appearance`).

    Args:
        frames: (T+1, H, W, 3) uint8 RGB, the clip's pictures as filmed.

    Raises:
        ClipError: when `frames` ends before picture T.
        Cancelled: between pictures and between iterations.
    """
    straight = _straight(frames, observation, recovery, progress or NoProgress())
    footage = Footage(observation.camera, straight, observation.masks, backdrops(straight, observation))
    return replace(body, gaussians=fit_appearance(body, recovery, footage, progress))


def _straight(frames: np.ndarray, observation: Observation, recovery: Recovery, progress: Progress) -> np.ndarray:
    """Pictures 0 to T without the lens's distortion. Raises ClipError where there are fewer."""
    if len(frames) < len(recovery.x):
        raise ClipError(f"The clip ends at picture {len(frames)}, the recovery at {len(recovery.x) - 1}.", "Has the file been changed?")
    return Lens(observation.camera).straight(frames[: len(recovery.x)], progress)


def _over(body: Body, camera: Camera, frame: int, x: np.ndarray, F: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """The body over a background (H, W, 3) uint8 in picture `frame`; only the part that the body can reach is rendered."""
    centres = body.gaussians.attachment.follow(x)
    xy, depth = camera.project(centres, frame)
    seen = depth > 1e-3
    canvas = behind.copy()
    if not seen.any():
        return canvas
    size = np.sqrt(np.linalg.eigvalsh(covariances(body.gaussians, F))[:, -1])
    reach = REACH * (1.0 + size[seen] * max(camera.fx, camera.fy) / depth[seen])
    low, high = (xy[seen] - reach[:, None]).min(axis=0), (xy[seen] + reach[:, None]).max(axis=0)
    x0, y0 = (int(value) for value in np.maximum(np.floor(low), 0))
    x1, y1 = (int(value) for value in np.minimum(np.ceil(high) + 1, [camera.width, camera.height]))
    if x1 <= x0 or y1 <= y0:
        return canvas
    part = replace(
        camera, width=x1 - x0, height=y1 - y0, cx=camera.cx - x0, cy=camera.cy - y0, camera_to_world=camera.pose(frame), distortion=()
    )
    colour, alpha = picture(body.gaussians, part, 0, x, F)
    alpha = np.clip(alpha, 0.0, 1.0)[..., None]
    mixed = 255.0 * np.clip(colour, 0.0, 1.0) + (1.0 - alpha) * canvas[y0:y1, x0:x1]
    canvas[y0:y1, x0:x1] = np.clip(np.round(mixed), 0, 255).astype(np.uint8)
    return canvas


def psnr(want: np.ndarray, got: np.ndarray) -> float:
    """Peak signal to noise ratio [dB] of two uint8 arrays, at most 100."""
    error = float(((want.astype(np.float64) - got) ** 2).mean()) / 255.0**2
    return float(-10.0 * np.log10(max(error, 1e-10)))


def ssim(want: np.ndarray, got: np.ndarray) -> float:
    """Structural similarity (Wang et al. 2004) of two pictures (H, W, 3) uint8, mean over pixels and channels."""
    a, b = want.astype(np.float64), got.astype(np.float64)

    def blur(values: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(values, (SSIM_SIZE, SSIM_SIZE), SSIM_SIGMA)

    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b, both = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2, blur(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    alike = (2 * mean_a * mean_b + c1) * (2 * both + c2) / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))
    return float(alike.mean())
