"""resimulated.mp4: the object as the recovered force moves it, over the clip's clean background, and its likeness to the clip.

The motion is that of the simulation. The look is fitted to the clip along this motion, and the background is lit as in the clip: these two
are measured, not predicted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import cv2
import numpy as np

from ...masks import Masks, areas, box_of, rows_columns
from ...observe.clip.lens import Lens
from ...observe.clip.stored import Frames
from ...observe.clip.video import video_writer
from ...progress import Journal, NoProgress, Progress
from ...records import Body, Observation, Recovery
from ...take import Take
from .. import over_clip
from ..gaussians import covariances
from ..over_clip import Box
from ..splatting import render_gaussians
from .backdrop import behind
from .footage import Footage, check_length

SAMPLED = 24
"""How many frames are compared at the file's own size if the clip is larger than the report's videos; of a smaller clip, all are."""

PART = 24
"""Frames that are rendered and then kept in the journal together."""

REACH = 3.0
"""The rendered part of a frame extends by this many standard deviations beyond the centre of every Gaussian."""

SSIM_SIGMA, SSIM_SIZE = 1.5, 11
"""Window of the structural similarity (Wang et al. 2004) [px]."""


@dataclass
class _Likeness:
    """The likeness of rendered frames to those filmed, in the boxes around the object."""

    first: float = float("nan")
    later: list[tuple[float, float]] = field(default_factory=list)

    def add(self, t: int, want: np.ndarray, got: np.ndarray, inside: np.ndarray) -> None:
        """Compare the box (h, w, 3) of frame t as filmed (`want`) and as rendered (`got`); inside (h, w) bool: the object in it."""
        if t == 0:
            self.first = psnr(want[inside], got[inside])
        else:
            self.later.append((psnr(want, got), ssim(want, got)))

    def figures(self) -> dict[str, float]:
        """The figures that `write_resimulated` returns; those that could not be measured are left out."""
        means = np.mean(self.later, axis=0) if self.later else (np.nan, np.nan)
        found = {"first_psnr": self.first, "psnr": float(means[0]), "ssim": float(means[1])}
        return {"measured": len(self.later), **{name: value for name, value in found.items() if np.isfinite(value)}}


def write_resimulated(
    take: Take,
    frames: Frames,
    observation: Observation,
    body: Body,
    recovery: Recovery,
    progress: Progress = NoProgress(),
    journal: Journal = Journal(),
) -> dict[str, float]:
    """Render the Gaussians, moved by the simulated particles and their F (Eq. (8)), into the take's resimulated.mp4.

    Args:
        frames: (T+1, H, W, 3) uint8 RGB, the clip's frames as filmed; observation: at the frames' size.
        journal: keeps the frames rendered so far.

    Returns:
        `first_psnr`, inside the mask of frame 0 [dB]; `psnr` [dB] and `ssim` in the boxes around the object, means over the frames from
        1 to T that show it; `measured`, the number of these frames.

    Raises:
        ClipError: when `frames` ends before frame T.
        TakeError, MissingPackage: when the video cannot be written.
    """
    check_length(len(frames), recovery)
    height, width = observation.image.shape[:2]
    lens, likeness = Lens(observation.camera), _Likeness()

    def render(t: int) -> np.ndarray:
        progress.update((t + 1) / len(recovery.x), "resimulated.mp4")
        return resimulated(lens.straight_one(frames[t]), observation, body, recovery, t)

    with take.writing("resimulated.mp4") as path, video_writer(path, observation.fps, (width // 2 * 2, height // 2 * 2)) as writer:
        for t, image in enumerate(_in_parts(render, len(recovery.x), journal)):
            filmed = lens.straight_one(frames[t])
            writer.write(cv2.cvtColor(image[: height // 2 * 2, : width // 2 * 2], cv2.COLOR_RGB2BGR))
            mask = observation.masks[t]
            if mask.any():
                part = rows_columns(box_of(mask))
                likeness.add(t, filmed[part], image[part], mask[part])
    return likeness.figures()


@dataclass(frozen=True)
class _Part:
    """Some consecutive frames, as PNG."""

    ends: np.ndarray
    """(P,) int64, where each frame ends in `packed`."""
    packed: np.ndarray
    """(B,) uint8, the PNG files one after another."""


def _in_parts(render: Callable[[int], np.ndarray], count: int, journal: Journal) -> Iterator[np.ndarray]:
    """Frames 0 to `count` - 1 (H, W, 3) uint8, rendered `PART` at a time, so that a journal can keep them."""

    def part(begin: int) -> _Part:
        fast = [cv2.IMWRITE_PNG_COMPRESSION, 1]
        files = [cv2.imencode(".png", render(t), fast)[1].ravel() for t in range(begin, min(begin + PART, count))]
        return _Part(np.cumsum([len(one) for one in files]), np.concatenate(files))

    for begin in range(0, count, PART):
        kept = journal.once("frames", _Part, partial(part, begin))
        for low, high in pairwise([0, *kept.ends.tolist()]):
            yield cv2.imdecode(kept.packed[low:high], cv2.IMREAD_COLOR)


def frames_measured(masks: Masks, recovery: Recovery) -> list[int]:
    """The frames of a large clip that `likeness` compares: frame 0 and at most `SAMPLED` later ones that show the object, evenly spread."""
    seen = 1 + np.flatnonzero(areas(masks[t] for t in range(1, len(recovery.x))) > 0)
    return ([0] if masks[0].any() else []) + over_clip.spread_over(seen, SAMPLED).tolist()


def likeness(footage: Footage, body: Body, recovery: Recovery, frames: list[int], progress: Progress = NoProgress()) -> dict[str, float]:
    """The figures of `write_resimulated` at the file's own size, from the given frames, which are rendered in the object's box only."""
    found = _Likeness()
    for number, t in enumerate(frames):
        progress.update(number / len(frames), "likeness to the clip")
        mask, filmed = footage.seen.masks[t], footage.straight(t)
        box = box_of(mask)
        part = rows_columns(box)
        found.add(t, filmed[part], resimulated(filmed, footage.seen, body, recovery, t, box), mask[part])
    return found.figures()


def look_over_clip(footage: Footage, body: Body, recovery: Recovery, progress: Progress = NoProgress()) -> Body:
    """The body with Gaussians whose look fits the whole clip along the simulated motion (`look.over_clip`)."""

    def background(t: int, image: np.ndarray, box: Box) -> np.ndarray:
        return behind(footage.seen, t, image, box)

    filmed = over_clip.Footage(footage.seen.camera, footage.straight, footage.seen.masks, background)
    return replace(body, gaussians=over_clip.fit_appearance(body, recovery, filmed, progress))


def resimulated(filmed: np.ndarray, observation: Observation, body: Body, recovery: Recovery, t: int, box: Box | None = None) -> np.ndarray:
    """Frame t (H, W, 3) uint8 RGB of the simulated body over the background, or only the part in `box`, (h, w, 3).

    Args:
        filmed: (H, W, 3) uint8 RGB, frame t of the clip without lens distortion; observation: at the same size.
    """
    camera, x, F = observation.camera, recovery.x[t], recovery.F[t]
    canvas = behind(observation, t, filmed, box)
    left, top, right, bottom = box or (0, 0, camera.width, camera.height)
    centres = body.gaussians.attachment.follow(x)
    xy, depth = camera.project(centres, t)
    seen = depth > 1e-3
    if not seen.any():
        return canvas
    size = np.sqrt(np.linalg.eigvalsh(covariances(body.gaussians, F))[:, -1])
    reach = REACH * (1.0 + size[seen] * max(camera.fx, camera.fy) / depth[seen])
    low, high = (xy[seen] - reach[:, None]).min(axis=0), (xy[seen] + reach[:, None]).max(axis=0)
    # Only the part of the frame that the body can cover is rendered.
    x0, y0 = (int(value) for value in np.maximum(np.floor(low), [left, top]))
    x1, y1 = (int(value) for value in np.minimum(np.ceil(high) + 1, [right, bottom]))
    if x1 <= x0 or y1 <= y0:
        return canvas
    part = replace(camera, width=x1 - x0, height=y1 - y0, cx=camera.cx - x0, cy=camera.cy - y0)
    part = replace(part, camera_to_world=camera.pose(t), distortion=())
    colour, alpha = render_gaussians(body.gaussians, part, 0, x, F)
    alpha = np.clip(alpha, 0.0, 1.0)[..., None]
    canvas = canvas.copy()
    under = canvas[y0 - top : y1 - top, x0 - left : x1 - left]
    under[:] = np.clip(np.round(255.0 * np.clip(colour, 0.0, 1.0) + (1.0 - alpha) * under), 0, 255).astype(np.uint8)
    return canvas


def psnr(want: np.ndarray, got: np.ndarray) -> float:
    """Peak signal to noise ratio [dB] of two uint8 arrays, at most 100."""
    error = float(((want.astype(np.float64) - got) ** 2).mean()) / 255.0**2
    return float(-10.0 * np.log10(max(error, 1e-10)))


def ssim(want: np.ndarray, got: np.ndarray) -> float:
    """Structural similarity (Wang et al. 2004) of two frames (H, W, 3) uint8, mean over pixels and channels."""
    a, b = want.astype(np.float64), got.astype(np.float64)

    def blur(values: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(values, (SSIM_SIZE, SSIM_SIZE), SSIM_SIGMA)

    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b, both = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2, blur(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    alike = (2 * mean_a * mean_b + c1) * (2 * both + c2) / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))
    return float(alike.mean())
