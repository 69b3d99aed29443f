"""The look of the body over the whole clip: Gaussians for what later frames show, and colours that fit all frames.

Frame 0 shows one side of the body in one light. Once the motion is known, every frame adds information: sides that turn into view, texture
that was foreshortened, and how the light on a surface changes as it turns. Under light that stands still, the irradiance of a matt surface
is a function of its normal that second-degree harmonics represent to within a percent (R. Ramamoorthi and P. Hanrahan, An efficient
representation for irradiance environment maps, 2001). If the camera stands still, too, the viewing direction in the body's axes determines
how a Gaussian has turned, so the Gaussians' harmonics can represent that light. The motion is given and is not changed.

With fixed shapes and opacities a frame is linear in these harmonics; they are found by least squares, with conjugate gradients.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from ..field.torch_threads import one_torch_thread
from ..masks import Masks, areas
from ..progress import NoProgress, Progress
from ..records import Body, Camera, Gaussians, Recovery
from .contributions import contributions
from .covering import cover_bare_surface, joined
from .finer import finer
from .gaussians import Crop, blended_gradients
from .harmonics import harmonics, polar_rotations

FITTED = 25
"""Frames of the clip that are fitted, evenly spread. The other frames are 0.5 dB worse where the motion is right, and up to 3 dB where it
is some pixels off, because colours that depend on the direction partly absorb such an error in the fitted frames."""

SIGHTS = 12
"""How many of these frames, evenly spread, are searched for surface without Gaussians."""

FIT_PIXELS = 200_000
"""An object's box with more pixels is reduced by an integer factor for the fit. A fit to means of pixels has speckles finer than these
means: a ball that grew beyond 60 000 pixels had a structural similarity of 0.91 with that limit, and 0.95 without."""

MARGIN = 8
"""Pixels around the object's box that are fitted, too."""

BANDS = 9
"""Harmonics of a Gaussian: up to degree 2."""

STAY, PLAIN = 0.001, 0.001
"""Squared weights, in units of a pixel that a Gaussian fills, that keep its colour near the former one and its higher harmonics near 0."""

OFF = 10.0
"""Residual of the motion [px] at which a frame has half the weight: where the simulated body is not where it was filmed, the fit would only
blur it. Smaller residuals come as often from lost tracks, as on a sheet seen edge-on, as from a body in the wrong place."""

ITERATIONS = 40
"""Iterations of conjugate gradients: 60 more improve the fit by 0.1 dB, but took half of the time of a report."""


Box = tuple[int, int, int, int]
"""x0, y0, x1, y1 [px], the end exclusive, inside the frame."""


@dataclass(frozen=True)
class Footage:
    """The frames of one camera, with masks and background."""

    camera: Camera
    frame: Callable[[int], np.ndarray]
    """Frame t (H, W, 3) uint8 RGB without lens distortion, for t in `frames_fitted`."""
    masks: Masks
    """(T+1, H, W) bool, the object."""
    behind: Callable[[int, np.ndarray, Box], np.ndarray]
    """(t, frame t, box) -> the background (h, w, 3) uint8 RGB in that box of frame t."""


@dataclass(frozen=True)
class _Equations:
    """One frame: weights @ (sum of harmonics * coefficients) = colour."""

    trust: float
    weights: sparse.csr_matrix
    """(P, G)."""
    colour: np.ndarray
    """(P, 3) the frame less the visible background and the blended constant 0.5, to which the harmonics are added."""
    harmonics: np.ndarray
    """(BANDS, G)."""


def frames_fitted(masks: Masks, recovery: Recovery) -> np.ndarray:
    """The frames that `fit_appearance` uses, possibly none: evenly spread over those that show the object and have a residual."""
    usable = (areas(masks[: len(recovery.x)]) > 0) & np.isfinite(recovery.residual)
    return spread_over(np.flatnonzero(usable), FITTED)


def fit_appearance(body: Body, recovery: Recovery, footage: Footage, progress: Progress = NoProgress()) -> Gaussians:
    """The body's Gaussians with a look fitted to the whole clip along the recovered motion.

    Returns:
        Gaussians with harmonics up to degree 2, among them ones for surface that the body's own did not cover; `body.gaussians`
        unchanged if no frame can be used.
    """
    chosen = frames_fitted(footage.masks, recovery)
    if not len(chosen):
        return body.gaussians
    gaussians = body.gaussians
    with one_torch_thread():
        for t in spread_over(chosen, SIGHTS):
            progress.check()
            new = cover_bare_surface(body, gaussians, footage.camera, footage.masks[t], footage.frame(int(t)), int(t), recovery.x[t])
            gaussians = joined(gaussians, new)
        motion = ((int(t), recovery.x[t], recovery.F[t]) for t in spread_over(chosen, SIGHTS))
        gaussians = finer(gaussians, body.particles.x, footage.camera, motion)
        equations = []
        for number, t in enumerate(chosen):
            progress.update(0.7 * number / len(chosen), "look over the clip")
            trust = 1.0 / (1.0 + (recovery.residual[t] / OFF) ** 2)
            equations.append(_equations(gaussians, footage, int(t), recovery.x[t], recovery.F[t], float(trust)))
        return dataclasses.replace(gaussians, sh=_fit_harmonics(gaussians, equations, progress))


def spread_over(frames: np.ndarray, count: int) -> np.ndarray:
    """At most `count` of the frames, evenly spread, the first and the last among them."""
    if not len(frames):
        return frames
    return frames[np.unique(np.linspace(0, len(frames) - 1, count).round().astype(int))]


def _equations(gaussians: Gaussians, footage: Footage, t: int, x: np.ndarray, F: np.ndarray, trust: float) -> _Equations:
    """The equations of frame t, for the box around the object, reduced to at most about `FIT_PIXELS`."""
    crop = Crop.around(footage.masks[t], footage.camera, t, MARGIN, FIT_PIXELS)

    def reduced(part: np.ndarray) -> np.ndarray:
        return crop.reduced(part.astype(np.float32) / 255.0).reshape(-1, 3)

    weights, passed = contributions(gaussians, crop.camera, x, F)
    image = footage.frame(t)
    behind = reduced(footage.behind(t, image, crop.box))
    colour = reduced(crop.cut(image)) - passed * behind - 0.5 * np.asarray(weights.sum(axis=1))
    toward = gaussians.attachment.follow(x) - crop.camera.pose(0)[:3, 3]
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    toward = np.einsum("gba,gb->ga", polar_rotations(blended_gradients(gaussians, F)), toward)
    return _Equations(trust, weights, colour.astype(np.float32), np.ascontiguousarray(harmonics(toward, BANDS).T, dtype=np.float32))


def _fit_harmonics(gaussians: Gaussians, equations: list[_Equations], progress: Progress) -> np.ndarray:
    """Least-squares harmonics (G, BANDS, 3), regularised towards the Gaussians' own colours and towards zero higher harmonics."""
    count = len(gaussians.x)
    # The axis of the Gaussians comes last, because NumPy's innermost axis should be the longest.
    start = np.zeros((max(BANDS, gaussians.sh.shape[1]), 3, count), np.float32)
    start[: gaussians.sh.shape[1]] = gaussians.sh.transpose(1, 2, 0)
    start = np.ascontiguousarray(start[:BANDS])
    hold = np.full((BANDS, 1, 1), PLAIN, np.float32)
    hold[0] = STAY

    def seen(one: _Equations, sh: np.ndarray) -> np.ndarray:
        return one.weights @ np.ascontiguousarray(sum(band * values for band, values in zip(one.harmonics, sh)).T)

    def gather(one: _Equations, pixels: np.ndarray, total: np.ndarray) -> None:
        back = one.trust * np.ascontiguousarray((one.weights.T @ pixels).T)
        for band, values in zip(one.harmonics, total):
            values += band * back

    rest = -hold * start
    rest[0] = 0.0
    size = np.broadcast_to(hold, (BANDS, 1, count)).copy()
    for one in equations:
        gather(one, one.colour - seen(one, start), rest)
        filled = np.asarray(one.weights.multiply(one.weights).sum(axis=0))
        size += (one.trust * filled * one.harmonics**2)[:, None]
    done = itertools.count()

    def product(flat: np.ndarray) -> np.ndarray:
        progress.update(0.7 + 0.3 * min(next(done) / ITERATIONS, 1.0), "look over the clip")
        sh = flat.reshape(start.shape)
        total = hold * sh
        for one in equations:
            gather(one, seen(one, sh), total)
        return total.ravel()

    shape = (start.size, start.size)
    normal = LinearOperator(shape, product, dtype=np.float32)
    scale = np.broadcast_to(1.0 / size, start.shape).ravel()
    rescaled = LinearOperator(shape, lambda flat: scale * flat.ravel(), dtype=np.float32)
    # Convergence is not checked: what these iterations leave is not visible.
    change = cg(normal, rest.ravel(), maxiter=ITERATIONS, M=rescaled)[0].reshape(start.shape)
    return np.ascontiguousarray((start + change).transpose(2, 0, 1), dtype=np.float64)
