"""What a composite is put together from; and what of it is missing, all at once: who mends one thing shall not be told of the next."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from ...engine.errors import SeeingWindError, TakeError, UsageError
from ...engine.take import Take
from ..clip.inputs.clips import check_film
from ..job import takes
from ..job.take_reading import field_summary, read_seen
from .film import check_depths
from .hdri import panorama


def refuse(*checks: Callable[[], object]) -> None:
    """Make all checks, each of which may raise SeeingWindError.

    Raises:
        SeeingWindError: of a check, where it is the only one that fails.
        UsageError: what all of them say, where several do.
    """
    found = []
    for check in checks:
        try:
            check()
        except SeeingWindError as error:
            found.append(error)
    if len(found) > 1:
        raise UsageError(" ".join([*map(str, found[:-1]), found[-1].message]), found[-1].hint)
    for error in found:
        raise error


def check_parts(scene: bpy.types.Scene, use_plate: bool, fstop: float) -> None:
    """See that a composite can be set up, before anything of the scene is changed. Arguments as of `composite.set_up`.

    Raises:
        UsageError: without camera and clip, when the file of clip or panorama is gone, or without a plate or an object that is asked for.
        TakeError: when the folder of the take is gone.
    """
    refuse(
        lambda: _check_camera(scene), lambda: check_film(scene.active_clip), lambda: _check_take(scene, use_plate, fstop),
        lambda: panorama(scene.seeing_wind) if scene.seeing_wind.hdri else None,
    )  # fmt: skip


def _check_camera(scene: bpy.types.Scene) -> None:
    if scene.camera is None or scene.active_clip is None:
        raise UsageError("The scene has no camera with a clip.", "Run Recover on a clip, or load the results of one.")
    if scene.camera.type != "CAMERA":
        raise UsageError(f"The scene looks through {scene.camera.name}, which is no camera.", "Make the clip's camera the active one.")


def _check_take(scene: bpy.types.Scene, use_plate: bool, fstop: float) -> None:
    take = take_of(scene.seeing_wind)
    refuse(lambda: plate_of(take) if use_plate else None, lambda: check_depths(depths_of(take)) if fstop else None)


def take_of(settings: bpy.types.PropertyGroup) -> Take | None:
    """What the scene knows of its clip; None for a scene without a recovery, of which a lone wind is none.

    Raises:
        TakeError: when its folder is gone: outlines, grain, softness and lens of the clip would be missing.
    """
    if not settings.recovered_take or takes.shows_lone(settings):
        return None
    folder = takes.shown(settings)
    if not folder.is_dir():
        raise TakeError(*takes.gone(folder))
    return Take(folder)


def depths_of(take: Take | None) -> np.ndarray | None:
    """Distance of the object's middle along the camera's axis in every frame (T+1,) [m]; None without an object, or its outlines."""
    if take is None or not take.file("observation.npz").is_file() or "masks.windows" not in take.read_arrays("observation.npz"):
        return None
    seen = read_seen(take, field_summary(take))
    if seen is None or seen.surface is None:
        return None
    poses = np.broadcast_to(seen.camera.camera_to_world, (len(seen.motion), 4, 4))
    return np.einsum("ti,ti->t", seen.motion.mean(axis=1) - poses[:, :3, 3], poses[:, :3, 2])


def plate_of(take: Take | None) -> np.ndarray:
    """As `background_of`. Raises UsageError where there is none."""
    if take is None or not take.file("observation.npz").is_file():
        raise UsageError("There is no clean plate.", "It comes from recovering a clip; use the clip itself as background.")
    plate = background_of(take)
    if plate is None:
        raise UsageError(f"{take.path} holds no clean plate.", "Run Recover again, or use the clip itself as background.")
    return plate


def background_of(take: Take | None) -> np.ndarray | None:
    """What is behind the clip's object (H, W, 3) uint8 sRGB, where the take has it."""
    if take is None or not take.file("observation.npz").is_file():
        return None
    plate = take.read_arrays("observation.npz").get("background")
    return plate if plate is not None and plate.ndim == 3 else None
