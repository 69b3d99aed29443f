"""Tracks from another program (Blender's tracker, a network), in an NPZ file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import UsageError
from ...progress import Progress
from ...reading import read_arrays

SIGMA = 0.3
"""Standard deviation [px] of tracks that come without one."""

FARTHEST = 1e5
"""Largest coordinate of a visible point [px], larger than any image."""

FEW = 3
"""Least number of tracks that determine how a body turns."""

SHAPES = "It needs xy (T+1, K, 2) pixels and visible (T+1, K) bool; sigma (T+1, K) pixels is optional."


def read_tracks(
    path: str, frames: int, first_frame: int, mask: np.ndarray, progress: Progress
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """xy (T+1, K, 2) [px], visible (T+1, K) bool and sigma (T+1, K) [px] of the tracks that start on the object.

    Args:
        mask: (H, W) bool, the object in frame 0; the others as of `checked_tracks`.

    Raises:
        UsageError: as `checked_tracks` and `starting_on`.
    """
    xy, visible, sigma = checked_tracks(path, frames, first_frame)
    on = starting_on(mask, xy[0], visible[0], path)
    tell_left_out(on, progress)
    # An invisible point's place is never used; zero keeps arithmetic on whole arrays finite.
    held = np.where(visible[..., None], xy, 0.0)
    return held[:, on], visible[:, on], np.where(visible, sigma, SIGMA)[:, on]


def starting_on(area: np.ndarray, xy: np.ndarray, visible: np.ndarray, path: str) -> np.ndarray:
    """(K,) bool: which tracks are in frame 0 visible (K,) at xy (K, 2) [px] in the area (H, W) bool, which contains the object.

    Raises:
        UsageError: none is.
    """
    height, width = area.shape
    far = float(max(width, height))
    nearest = np.round(np.clip(np.nan_to_num(xy, nan=-1.0, posinf=-1.0, neginf=-1.0), -1.0, far)).astype(int)
    inside = (nearest >= 0).all(axis=1) & (nearest[:, 0] < width) & (nearest[:, 1] < height)
    on = visible & inside & area[np.clip(nearest[:, 1], 0, height - 1), np.clip(nearest[:, 0], 0, width - 1)]
    if not on.any():
        raise UsageError(
            f"No track of {Path(path).name} is visible on the object in the first frame.",
            "Check the mask, and that pixels count from the top left.",
        )
    return np.asarray(on)


def tell_left_out(on: np.ndarray, progress: Progress) -> None:
    """Warn of tracks that are not on the object in frame 0, and of too few that are; on: (K,) bool, which are."""
    if not on.all():
        progress.warn(f"{int((~on).sum())} of {len(on)} tracks do not start on the object in the first frame and are left out.")
    if on.sum() < FEW:
        few = "One track shows" if on.sum() == 1 else f"{int(on.sum())} tracks show"
        progress.warn(f"{few} where the object is, but not how it turns or bends. Give three or more that start on it.")


def checked_tracks(
    path: str, frames: int, first_frame: int, beyond: Progress | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """xy (T+1, K, 2) [px], visible (T+1, K) bool and sigma (T+1, K) [px] of all tracks of a file: what can be told before the object is.

    Args:
        path: NPZ; one row per frame of the chosen range, or of the whole file.
        frames: T + 1, the frames of the range, which begins at `first_frame`.
        beyond: told of rows beyond the last frame; None if the clip has further frames, to which they may belong.

    Raises:
        UsageError: unreadable, keys or shapes wrong or transposed, or values of visible points not finite.
    """
    xy, visible, sigma = load_tracks(path)
    if xy.ndim != 3 or xy.shape[2] != 2 or visible.shape != xy.shape[:2] or sigma.shape not in ((), xy.shape[:2]):
        raise UsageError(f"The tracks {path} have xy {xy.shape} and visible {visible.shape}.", SHAPES)
    sigma, skipped = np.broadcast_to(sigma, visible.shape), 0
    if len(xy) != frames:
        needed = first_frame + frames
        if (beyond is not None and xy.shape[1] == frames) or (len(xy) < needed and xy.shape[1] in (frames, needed)):
            more = f" If its rows are frames, cut it to {frames} rows." if len(xy) > needed else ""
            said = f"The tracks {path} look transposed: xy is {xy.shape}, with a row for each track in place of each frame."
            raise UsageError(said, SHAPES + more)
        if len(xy) < needed:
            raise UsageError(f"The tracks {path} have {len(xy)} rows, the clip {frames} frames.", SHAPES)
        if beyond is not None:
            beyond.warn(f"The tracks {path} have {len(xy)} rows, the clip {frames} frames: the last {len(xy) - frames} are not used.")
        part, skipped = slice(first_frame, first_frame + frames), first_frame
        xy, visible, sigma = xy[part], visible[part], sigma[part]
    lost = visible & ~((np.abs(xy) <= FARTHEST).all(axis=2) & np.isfinite(sigma) & (sigma > 0.0))
    if lost.any():
        row, track = np.argwhere(lost)[0]
        raise UsageError(
            f"The tracks {path}: track {track} is visible in row {row + skipped}, at {xy[row, track].tolist()} with sigma "
            f"{sigma[row, track]:g}.",
            f"A visible point lies within {FARTHEST:g} pixels and has a sigma above 0: set `visible` to false where there is none.",
        )
    return xy, visible, sigma


def load_tracks(path: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """xy, visible and sigma as they are in a track file, not checked against a clip; sigma is a single number if the file has none.

    Raises:
        UsageError: unreadable, or without xy and visible.
    """
    try:
        file = read_arrays(path, ("xy", "visible", "sigma"))
        missing = [key for key in ("xy", "visible") if key not in file]
        if missing:
            raise UsageError(f"The tracks {path} lack {' and '.join(missing)}.", SHAPES)
        sigma = np.asarray(file["sigma"], dtype=np.float64) if "sigma" in file else np.array(SIGMA)
        visible = np.asarray(file["visible"])
        if visible.dtype.kind not in "biuf":
            raise UsageError(f"The tracks {path} have a `visible` of {visible.dtype}, not of true and false.", SHAPES)
        neither = visible[(visible != 0) & (visible != 1)]
        if neither.size:
            hint = "Write true or false, or 1 or 0. If it is a confidence, compare it with a threshold first."
            raise UsageError(f"The tracks {path} have {neither[0]:g} in `visible`.", hint)
        return np.asarray(file["xy"], dtype=np.float64), visible.astype(bool), sigma
    except OSError as error:
        raise UsageError(f"The tracks {path} cannot be read ({error.strerror or error}).", "Check the path.") from error
    except ValueError as error:
        raise UsageError(f"The tracks {path} are not an NPZ of plain arrays ({error}).", SHAPES) from error
