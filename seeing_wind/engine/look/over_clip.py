"""The look of the body over the whole clip: Gaussians for what later frames show, and colours that fit all of them.

Frame 0 shows one side of the body in one light. Once the motion is known, every frame says more: sides that turn into view, texture
that was foreshortened, and how the light on a surface changes as it turns. Light that stands still in the room falls on a matt surface
by second-degree harmonics of its normal, to within a percent (R. Ramamoorthi and P. Hanrahan, An efficient representation for irradiance
environment maps, 2001). Seen by a camera that stands still, too, a Gaussian's turn is told by the direction it is seen from in the body's
axes, so the harmonics of the Gaussians can hold that light. The motion is given and is not touched.

With shapes and opacities fixed a frame is linear in these harmonics: they are found by least squares, by conjugate gradients.
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
from .covering import joined, uncovered
from .finer import finer
from .gaussians import Crop, blended_gradients
from .harmonics import harmonics, polar_rotations

FITTED = 25
"""Frames of the clip that are fitted, spread evenly. Others come out 0.5 dB worse where the motion is right, and up to 3 dB where it is
some pixels off, as colours that depend on the direction take up a part of that."""

SIGHTS = 12
"""Of these, how many are searched for surface without Gaussians, spread evenly."""

FIT_PIXELS = 200_000
"""An object's box of more pixels is reduced by an integer factor for the fit. What is fitted to means of pixels has speckles finer than
them: a ball that swelled beyond 60 000 pixels had a structural similarity of 0.91 with that limit, and 0.95 without."""

MARGIN = 8
"""Pixels round the object's box that are fitted."""

BANDS = 9
"""Harmonics of a Gaussian: degree 2."""

STAY, PLAIN = 0.001, 0.001
"""Squared weights, in units of a pixel that a Gaussian fills, that hold its colour where it was and its higher harmonics at zero."""

OFF = 10.0
"""Residual of the motion [px] at which a frame counts half: where the body is not where it was filmed, it would only be blurred.
Smaller ones tell of tracks that went astray, on a sheet seen edge-on, as often as of a body that did."""

ITERATIONS = 40
"""Of the conjugate gradients: 60 more bring the fit 0.1 dB closer, and took half of the time of a report."""


Box = tuple[int, int, int, int]
"""x0, y0, x1, y1 [px], the end exclusive, inside the frame."""


@dataclass(frozen=True)
class Footage:
    """What one camera filmed."""

    camera: Camera
    frame: Callable[[int], np.ndarray]
    """Frame t (H, W, 3) uint8 RGB without lens distortion, for t in `frames_fitted`."""
    masks: Masks
    """(T+1, H, W) bool, the object."""
    behind: Callable[[int, np.ndarray, Box], np.ndarray]
    """The background (h, w, 3) uint8 RGB in a box of frame t, from t, that frame and the box."""


@dataclass(frozen=True)
class _Equations:
    """One frame: weights @ (sum of harmonics * coefficients) = colour."""

    trust: float
    weights: sparse.csr_matrix
    """(P, G)."""
    colour: np.ndarray
    """(P, 3) the frame without what is seen of the background and without the grey that colours are counted from."""
    harmonics: np.ndarray
    """(BANDS, G)."""


def frames_fitted(masks: Masks, recovery: Recovery) -> np.ndarray:
    """The frames that `fit_appearance` uses, possibly none: spread over those that show the object and have a residual."""
    usable = (areas(masks[: len(recovery.x)]) > 0) & np.isfinite(recovery.residual)
    return spread_over(np.flatnonzero(usable), FITTED)


def fit_appearance(body: Body, recovery: Recovery, footage: Footage, progress: Progress = NoProgress()) -> Gaussians:
    """The body's Gaussians with the look of the whole clip along the recovered motion.

    Returns:
        at least the body's own Gaussians, with degree-2 harmonics; `body.gaussians` unchanged where no frame can be used.
    """
    chosen = frames_fitted(footage.masks, recovery)
    if not len(chosen):
        return body.gaussians
    gaussians = body.gaussians
    with one_torch_thread():
        for t in spread_over(chosen, SIGHTS):
            progress.check()
            new = uncovered(body, gaussians, footage.camera, footage.masks[t], footage.frame(int(t)), int(t), recovery.x[t])
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
    """The frame's box round the object, reduced to at most about `FIT_PIXELS`."""
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
    """Harmonics (G, BANDS, 3) of least squares, drawn to the Gaussians' own colours and to no higher harmonics."""
    count = len(gaussians.x)
    # Gaussians last: loops over them are the long ones, and NumPy's innermost axis should be.
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
    # The iterations that there are do: what they leave is not seen.
    change = cg(normal, rest.ravel(), maxiter=ITERATIONS, M=rescaled)[0].reshape(start.shape)
    return np.ascontiguousarray((start + change).transpose(2, 0, 1), dtype=np.float64)
