"""Data that the scene already has, as files that the engine reads: masks, held place, tracks, depth of a proxy mesh, camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import bpy

from ....engine.errors import ObjectError, UsageError
from ...bake.animation import lineage
from ...edit.resimulate.geometry import geometry
from .camera import camera_source, write_camera
from .clips import clip_of, first_clip_frame
from .depth import write_depth
from .held import write_held_box
from .mask import mask_stamp, write_mask, write_plane_mask
from .tracks import tracks_stamp, write_tracks


@dataclass(frozen=True)
class SceneInput:
    """A file to be made from the scene."""

    option: str
    """Name of the option in `ObserveSettings` that takes the file's path."""
    name: str
    """File name."""
    stamp: tuple
    """Stamp of the file's source data; cheap enough to compute at every change."""
    write: Callable[[Path], object] = field(compare=False)
    """Writes the file. Raises SeeingWindError when mask, tracks or proxy are empty in the first frame."""


def scene_inputs(scene: bpy.types.Scene) -> tuple[SceneInput, ...]:
    """The files that the settings of `scene` require; nothing is written.

    Raises:
        ObjectError: when the datablock or box of the chosen object or held mode, or a track, is missing.
        UsageError: when the camera or proxy is missing.
    """
    settings, found = scene.seeing_wind, _held(scene)
    if settings.object_mode in ("BLENDER_MASK", "PLANE", "PROXY"):
        found += _object(scene)
    if settings.outline_data is not None:
        clip_frame = settings.outline_frame
        stamp = (clip_frame, *mask_stamp(scene, settings.outline_data, clip_frame))
        found.append(SceneInput("outline", "outline.png", stamp, partial(write_mask, scene, settings.outline_data, clip_frame=clip_frame)))
    if settings.use_tracks:
        clip = clip_of(settings)
        if clip is None or not (len(clip.tracking.tracks) or len(clip.tracking.plane_tracks)):
            raise ObjectError("The clip has no tracks.", "Track points on the object in the Movie Clip Editor, or switch Tracks off.")
        found.append(SceneInput("tracks", "tracks.npz", tracks_stamp(clip), partial(write_tracks, scene)))
    if settings.scale_mode == "PROXY" and settings.proxy is None:
        raise UsageError("No proxy mesh is chosen.", "Place a mesh where the object is in the first frame, as the camera sees it.")
    camera = camera_source(scene)
    if settings.scale_mode == "PROXY":
        if not camera:
            raise UsageError("A proxy is seen through a camera, and there is none.", "Use the scene's camera or a camera solve.")
        stamp = (geometry(settings.proxy)[:2], lineage(settings.proxy))
        found.append(SceneInput("depth", "depth.npy", stamp, partial(write_depth, scene)))
    if camera:
        found.append(SceneInput("camera", "camera.json", camera, partial(write_camera, scene)))
    return tuple(found)


def _object(scene: bpy.types.Scene) -> list[SceneInput]:
    """The object's outline, if a datablock of the scene defines it. A proxy needs no file here: its depth map gives the outline."""
    settings = scene.seeing_wind
    if settings.object_mode == "BLENDER_MASK":
        if settings.mask_data is None:
            raise ObjectError("No mask is chosen.", "Draw one in the Image or Movie Clip Editor (Mask mode) and choose it here.")
        return [SceneInput("mask", "mask.png", *_of_mask(scene, settings.mask_data))]
    if settings.object_mode == "PLANE":
        clip = clip_of(settings)
        if clip is None or not len(clip.tracking.plane_tracks):
            raise ObjectError("The clip has no plane track.", "Make one in the Movie Clip Editor (Create Plane Track), or draw a box.")
        return [SceneInput("mask", "mask.png", tracks_stamp(clip), partial(write_plane_mask, scene))]
    if settings.scale_mode != "PROXY":
        raise ObjectError("The proxy mesh marks the object but does not give its depth.", "Choose Proxy Mesh for the scale too.")
    return []


def _of_mask(scene: bpy.types.Scene, mask: bpy.types.Mask) -> tuple[tuple, Callable[[Path], object]]:
    """Stamp and writer of a mask in the first frame used."""
    return mask_stamp(scene, mask, first_clip_frame(scene.seeing_wind)), partial(write_mask, scene, mask)


def _held(scene: bpy.types.Scene) -> list[SceneInput]:
    """The held place, if a box or a datablock of the scene defines it."""
    settings = scene.seeing_wind
    if settings.held_mode == "BOX":
        box = tuple(settings.held_box)
        if box[2] <= box[0] or box[3] <= box[1]:
            raise ObjectError("No box is drawn round the held part.", "Use Draw Held Box, or give left, top, right and bottom in pixels.")
        return [SceneInput("pin", "pin.png", box, partial(write_held_box, scene))]
    if settings.held_mode == "BLENDER_MASK":
        if settings.held_mask is None:
            raise ObjectError("No mask of the held part is chosen.", "Draw one in the Image or Movie Clip Editor and choose it here.")
        return [SceneInput("pin", "pin.png", *_of_mask(scene, settings.held_mask))]
    return []
