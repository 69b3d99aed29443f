"""Point tracks from CoTracker 3, the paper's tracker (section 3.4), with the noise of each track estimated from the track itself."""

from __future__ import annotations

import contextlib
import importlib
import sys

import numpy as np
import torch

from ...progress import Progress
from ..clip.stored import Frames
from .catalogue import known
from .folders import find, load_plain, package

AT_ONCE = 60
"""Number of frames in the window of the published offline model."""

LEAST_SIGMA = 0.3
"""Least standard deviation claimed [px]: the network works on frames of 512 x 384."""

UNKNOWN_SIGMA = 1.0
"""Standard deviation of tracks too short to measure it [px]."""


def follow_points(
    name: str, frames: Frames, points: np.ndarray, progress: Progress
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tracks of `points` (K, 2) [px] in frame 0 through `frames` (T+1, H, W, 3) uint8 RGB.

    Returns:
        xy (T+1, K, 2) [px], visible (T+1, K) bool, sigma (T+1, K) [px].

    Raises:
        WrongModel: no such model or wrong files. MissingPackage: the authors' package is not installed.
    """
    progress.begin("observe", f"tracks by {name}")
    entry = known("facebook/cotracker3")
    folder = find(name, "tracks")
    package("cotracker", entry.how if entry else "")
    # The output of the authors' code must not get among the engine's messages.
    with contextlib.redirect_stdout(sys.stderr), torch.inference_mode():
        predictor = importlib.import_module("cotracker.predictor").CoTrackerPredictor(checkpoint=None, window_len=AT_ONCE)
        load_plain(predictor.model, folder, "facebook/cotracker3 (scaled_offline)")
        progress.check()
        # The authors' predictor takes the whole clip at once: this is the only step whose memory grows with the clip's length.
        video = torch.from_numpy(np.ascontiguousarray(np.asarray(frames).transpose(0, 3, 1, 2)))[None].float()
        queries = torch.from_numpy(np.column_stack([np.zeros(len(points)), points]).astype(np.float32))[None]
        tracks, seen = predictor(video, queries=queries)
    progress.check()
    xy, visible = tracks[0].double().numpy(), seen[0].reshape(len(frames), len(points)).numpy().astype(bool)
    height, width = frames.shape[1:3]
    inside = (xy >= 0).all(axis=-1) & (xy[..., 0] <= width - 1) & (xy[..., 1] <= height - 1)
    visible &= inside & np.isfinite(xy).all(axis=-1)
    return np.where(visible[..., None], xy, 0.0), visible, np.broadcast_to(noise(xy, visible), visible.shape).copy()


def noise(xy: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """Standard deviation (K,) [px] of the noise of each track of xy (T+1, K, 2), from the third differences of its visible stretches."""
    third = np.diff(xy, 3, axis=0)
    whole = visible[:-3] & visible[1:-2] & visible[2:-1] & visible[3:]
    result = np.full(xy.shape[1], UNKNOWN_SIGMA)
    for k in np.flatnonzero(whole.sum(axis=0) >= 4):
        # Third differences of white noise have 1 + 9 + 9 + 1 = 20 times its variance; 1.4826 turns a median into a standard deviation.
        result[k] = max(LEAST_SIGMA, 1.4826 * float(np.median(np.abs(third[whole[:, k], k]))) / np.sqrt(20.0))
    return result
