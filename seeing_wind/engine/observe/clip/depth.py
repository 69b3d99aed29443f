"""Depth of the object in frame 0: from a depth map, or a plane facing the camera."""

from __future__ import annotations

import numpy as np

from ...conventions import in_units
from ...errors import UsageError
from ...progress import Progress
from ...reading import read_array

ROUGHEST = 0.1
"""Median difference between neighbouring pixels' depths, relative to the depth, from which the map cannot show a surface."""
LEAST_KNOWN = 0.8
"""Fraction of the object's pixels that a depth map must cover; the rest, mostly the silhouette's rim, takes the nearest known depth."""


def read_depth(path: str, height: int, width: int) -> np.ndarray:
    """A depth map (H, W) float32 [m] along the view axis from an NPY file; infinite or NaN where unknown.

    Raises:
        UsageError: unreadable, of another shape, or without a single positive value.
    """
    try:
        depth = read_array(path)
    except OSError as error:
        raise UsageError(f"The depth file {path} cannot be read ({error.strerror or error}).", "Check the path.") from error
    except ValueError as error:
        raise UsageError(
            f"The depth file {path} is not an NPY array ({error}).", "Save it with numpy.save, metres, shape (H, W)."
        ) from error
    if depth.dtype.kind not in "fiu":
        raise UsageError(f"The depth file {path} holds {depth.dtype}, no numbers.", "Give metres per pixel of the first frame.")
    if depth.shape != (height, width):
        raise UsageError(
            f"The depth file {path} has the shape {depth.shape}, the clip {(height, width)}.", "Give metres per pixel of the first frame."
        )
    depth = depth.astype(np.float32)
    if not (np.isfinite(depth) & (depth > 0)).any():
        raise UsageError(f"The depth file {path} has no positive, finite value.", "Give metres along the view axis.")
    return depth


def typical_depth(depth: np.ndarray | None, around: np.ndarray) -> float | None:
    """Median [m] of a depth map (H, W) over `around` (H, W) bool, or over the whole map if no depth is known there; None without a map."""
    if depth is None:
        return None
    known = np.isfinite(depth) & (depth > 0)
    return float(np.median(depth[known & around] if (known & around).any() else depth[known]))


def object_depth(depth: np.ndarray | None, name: str, mask: np.ndarray, distance: float, progress: Progress) -> np.ndarray:
    """Depth (H, W) float32 [m] of the object's visible surface in frame 0, infinite off `mask` (H, W).

    Args:
        depth: (H, W) [m], not positive or not finite where unknown; if None, the surface is the plane at `distance` [m] that faces the
            camera.
        name: where `depth` is from, for messages.

    Raises:
        UsageError: `depth` leaves more than a fifth of the object without depth, or is noise.
    """
    if depth is None:
        return np.where(mask, np.float32(distance), np.float32(np.inf)).astype(np.float32)
    known = np.isfinite(depth) & (depth > 0)
    part = float((known & mask).sum()) / float(mask.sum())
    if part < LEAST_KNOWN:
        raise UsageError(
            f"{name} gives a depth for only {100 * part:.0f} % of the object.",
            "Check that mask and depth are of the same frame.",
        )
    if part < 0.98:
        progress.warn(f"{100 * (1 - part):.0f} % of the object's pixels have no depth in {name}; they take the nearest known one.")
    # Only depths on the object itself may fill its rim: the nearest pixel outside could belong to the wall behind it.
    whole = np.where(mask, filled(depth, known & mask), np.float32(np.inf)).astype(np.float32)
    beside = mask[:, 1:] & mask[:, :-1]
    steps = np.abs(whole[:, 1:][beside] - whole[:, :-1][beside])
    if steps.size and np.median(steps) > ROUGHEST * np.median(whole[mask]):
        raise UsageError(
            f"{name} gives depths that differ by {in_units(np.median(steps), 'm', 2)} from pixel to pixel: no surface looks like that.",
            "Check the file: metres along the view axis, one per pixel of the first frame.",
        )
    return whole


def filled(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """`image` (H, W) with every pixel that is not `known` (H, W) bool replaced by the nearest known one."""
    return image[nearest_known(known)]


def nearest_known(known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row and column, (H, W) each, of the nearest pixel that is `known` (H, W) bool; an image indexed with them is filled where unknown."""
    from scipy.ndimage import distance_transform_edt  # slow to import, and most clips have no depth map

    rows, columns = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return rows, columns
