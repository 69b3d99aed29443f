"""Tracks and plane tracks of the Movie Clip Editor as the engine's NPZ of tracks."""

from __future__ import annotations

import hashlib
from pathlib import Path

import bpy
import numpy as np

from ....engine.errors import ObjectError
from ....engine.take import Take
from .camera import SPARE
from .clips import first_clip_frame, loaded_clip, marker_frame

GRID = 6
"""Number of points along each side of a plane track; all 36 move with its four corners."""

SIGMA, SIGMA_PLANE = 0.3, 1.0
"""Standard deviation [px] of tracks and plane tracks: Blender tracks patterns to subpixel accuracy; a tracked plane may not be flat."""


def write_tracks(scene: bpy.types.Scene, path: Path) -> int:
    """Write all tracks and a grid of points on each plane track as an NPZ. Returns the number of tracks K.

    Arrays: xy (rows, K, 2) [px], visible (rows, K) bool, sigma (rows, K) [px], one row per frame of the clip's file. Pixel centres are at
    integers, the origin is at the top left.

    Raises:
        ObjectError: when no track has a marker in the first frame used.
    """
    clip = loaded_clip(scene.seeing_wind)
    rows = clip.frame_duration + clip.frame_offset + SPARE
    columns = [_track(clip, track, rows) for track in clip.tracking.tracks]
    columns += [_plane(clip, plane, rows) for plane in clip.tracking.plane_tracks]
    if not columns:
        raise ObjectError("The clip has no tracks.", "Track points on the object in the Movie Clip Editor.")
    xy = np.concatenate([xy for xy, _, _ in columns], axis=1)
    visible = np.concatenate([visible for _, visible, _ in columns], axis=1)
    sigma = np.concatenate([np.full(visible.shape, value) for _, visible, value in columns], axis=1)
    first = first_clip_frame(scene.seeing_wind)
    if not visible[first].any():
        raise ObjectError(f"No track has a marker in frame {first} of the file.", "Track from the first frame that is used.")
    Take(path.parent).write_arrays(path.name, {"xy": xy, "visible": visible, "sigma": sigma})
    return xy.shape[1]


def tracks_stamp(clip: bpy.types.MovieClip) -> tuple:
    """Stamp of all tracks and plane tracks: names, offsets, and all markers, with those that are muted; and which plane is active."""
    planes = clip.tracking.plane_tracks
    points = [(track.name, tuple(track.offset), _markers(track.markers, "co", 2)) for track in clip.tracking.tracks]
    corners = [(plane.name, _markers(plane.markers, "corners", 8)) for plane in planes]
    return (clip.frame_offset, *points, *corners, planes.active.name if planes.active is not None else "")


def _markers(markers: bpy.types.bpy_prop_collection, place: str, count: int) -> str:
    """Digest of frame, mute and place (`count` numbers) of all markers of a track; quick, as it is needed after every change."""
    total, found = len(markers), hashlib.sha256()
    for name, kind, numbers in (("frame", np.int32, 1), ("mute", np.bool_, 1), (place, np.float32, count)):
        values = np.empty(numbers * total, dtype=kind)
        markers.foreach_get(name, values)
        found.update(values.tobytes())
    return found.hexdigest()[:16]


def plane_corners(clip: bpy.types.MovieClip, plane: bpy.types.MovieTrackingPlaneTrack, clip_frame: int) -> np.ndarray | None:
    """Corners (4, 2) [px] of a plane track in a frame of the clip's file; None if it has no active marker there."""
    marker = plane.markers.find_frame(marker_frame(clip, clip_frame))
    return None if marker is None or marker.mute else pixels(clip, np.array([tuple(corner) for corner in marker.corners]))


def pixels(clip: bpy.types.MovieClip, points: np.ndarray) -> np.ndarray:
    """Blender's coordinates (..., 2) in 0..1 from the lower left -> pixels from the top left, with centres at integers."""
    width, height = clip.size
    return np.stack([points[..., 0] * width - 0.5, (1.0 - points[..., 1]) * height - 0.5], axis=-1)


def _track(clip: bpy.types.MovieClip, track: bpy.types.MovieTrackingTrack, rows: int) -> tuple[np.ndarray, np.ndarray, float]:
    xy, visible = np.zeros((rows, 1, 2)), np.zeros((rows, 1), dtype=bool)
    shift = marker_frame(clip, 0)
    for marker in track.markers:
        clip_frame = marker.frame - shift
        if 0 <= clip_frame < rows and not marker.mute:
            xy[clip_frame, 0], visible[clip_frame, 0] = pixels(clip, np.array(marker.co) + np.array(track.offset)), True
    return xy, visible, SIGMA


def _plane(clip: bpy.types.MovieClip, plane: bpy.types.MovieTrackingPlaneTrack, rows: int) -> tuple[np.ndarray, np.ndarray, float]:
    """A grid of points on a plane track, moved by the homography from the unit square to its corners: xy, visible and sigma [px]."""
    side = (np.arange(GRID) + 0.5) / GRID
    u, v = (part.ravel() for part in np.meshgrid(side, side))
    xy, visible = np.zeros((rows, GRID**2, 2)), np.zeros((rows, GRID**2), dtype=bool)
    for clip_frame in range(rows):
        corners = plane_corners(clip, plane, clip_frame)
        if corners is not None:
            xy[clip_frame], visible[clip_frame] = through_homography(corners, u, v), True
    return xy, visible, SIGMA_PLANE


def through_homography(corners: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Image (K, 2) of points (u, v) under the homography that maps (0, 0), (1, 0), (1, 1), (0, 1) to `corners` (4, 2), in this order.

    P. Heckbert, Fundamentals of texture mapping and image warping, 1989, section 2.2.3.
    """
    p0, p1, p2, p3 = corners
    d1, d2, s = p1 - p2, p3 - p2, p0 - p1 + p2 - p3
    g, h = np.linalg.solve(np.stack([d1, d2], axis=1), s)
    across, up = p1 - p0 + g * p1, p3 - p0 + h * p3
    return (np.outer(u, across) + np.outer(v, up) + p0) / (g * u + h * v + 1.0)[:, None]
