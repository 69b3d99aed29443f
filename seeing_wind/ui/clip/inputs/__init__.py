"""What the scene knows already, as the files that the engine reads: masks, tracks, plane tracks, camera, the depth of a proxy mesh.

`options` says which files there will be (it only looks), `write` makes them, `stamp` says when they would be others.
"""

from __future__ import annotations

from pathlib import Path

import bpy

from ....engine.errors import ObjectError, UsageError
from .camera import camera_source, write_camera
from .clips import clip_of
from .depth import write_depth
from .mask import mask_stamp, write_mask, write_plane_mask
from .tracks import tracks_stamp, write_tracks

INPUTS = "blender_inputs"
"""Folder of these files in the take."""

MASK, TRACKS, CAMERA, DEPTH = "mask.png", "tracks.npz", "camera.json", "depth.npy"


def options(scene: bpy.types.Scene, folder: Path) -> list[str]:
    """The worker's options for what comes from the scene; the files are in `folder`.

    Raises:
        ObjectError: an object mode whose datablock is missing.
        UsageError: a camera or proxy that is missing.
    """
    settings, found = scene.seeing_wind, []
    if settings.object_mode == "BLENDER_MASK":
        if settings.mask_data is None:
            raise ObjectError("No mask is chosen.", "Draw one in the Image or Movie Clip Editor (Mask mode) and choose it here.")
        found += ["--mask", str(folder / MASK)]
    elif settings.object_mode == "PLANE":
        clip = clip_of(settings)
        if clip is None or not len(clip.tracking.plane_tracks):
            raise ObjectError("The clip has no plane track.", "Make one in the Movie Clip Editor (Create Plane Track), or draw a box.")
        found += ["--mask", str(folder / MASK)]
    elif settings.object_mode == "PROXY" and settings.scale_mode != "PROXY":
        raise ObjectError("The proxy mesh marks the object but does not give its depth.", "Choose Proxy Mesh for the scale too.")
    if settings.use_tracks:
        clip = clip_of(settings)
        if clip is None or not (len(clip.tracking.tracks) or len(clip.tracking.plane_tracks)):
            raise ObjectError("The clip has no tracks.", "Track points on the object in the Movie Clip Editor, or switch Tracks off.")
        found += ["--tracks", str(folder / TRACKS)]
    if settings.scale_mode == "PROXY":
        if settings.proxy is None:
            raise UsageError("No proxy mesh is chosen.", "Place a mesh where the object is in the first picture, as the camera sees it.")
        if not camera_source(scene):
            raise UsageError("A proxy is seen through a camera, and there is none.", "Use the scene's camera or a camera solve.")
        found += ["--depth", str(folder / DEPTH)]
    if camera_source(scene):
        found += ["--camera", str(folder / CAMERA)]
    return found


def write(scene: bpy.types.Scene, folder: Path) -> None:
    """Make the files that `options` speaks of.

    Raises:
        SeeingWindError: as `options`, and where mask, tracks or proxy hold nothing at the first picture.
    """
    settings, wanted = scene.seeing_wind, options(scene, folder)
    if settings.object_mode == "BLENDER_MASK":
        write_mask(scene, folder / MASK)
    elif settings.object_mode == "PLANE":
        write_plane_mask(scene, folder / MASK)
    if settings.use_tracks:
        write_tracks(scene, folder / TRACKS)
    if "--camera" in wanted:
        write_camera(scene, folder / CAMERA)
    if settings.scale_mode == "PROXY":
        write_depth(scene, folder / DEPTH)


def stamp(scene: bpy.types.Scene) -> tuple:
    """Of what the files would hold; cheap enough to ask for at every change."""
    settings, parts = scene.seeing_wind, []
    clip = clip_of(settings)
    if settings.object_mode == "BLENDER_MASK" and settings.mask_data is not None:
        parts.append(mask_stamp(settings.mask_data))
    if clip is not None and (settings.use_tracks or settings.object_mode == "PLANE"):
        parts.append(tracks_stamp(clip))
    if camera_source(scene):
        parts.append(camera_source(scene))
    if settings.scale_mode == "PROXY" and settings.proxy is not None:
        parts.append([tuple(row) for row in settings.proxy.matrix_world])
    return tuple(parts)
