"""The parts of a composite, and checks that report all missing ones at once, so that the user does not meet them one by one."""

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
    """Run all checks, each of which may raise SeeingWindError.

    Raises:
        SeeingWindError: the error of the only failing check.
        UsageError: the errors of several failing checks together.
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
    """Check that a composite can be set up, before the scene is changed. Arguments as in `composite.set_up`.

    Raises:
        UsageError: when the scene has no camera or clip, the file of clip or panorama is missing, or a required plate or object is missing.
        TakeError: when the take's folder is missing.
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
    """The take that the scene shows; None for a scene without a recovery (a wind without a clip is none).

    Raises:
        TakeError: when its folder, with the clip's outlines, grain, softness and lens, is missing.
    """
    if not settings.recovered_take or takes.shows_lone(settings):
        return None
    folder = takes.shown(settings)
    if not folder.is_dir():
        raise TakeError(*takes.gone(folder))
    return Take(folder)


def depths_of(take: Take | None) -> np.ndarray | None:
    """Depth (T+1,) of the object's centroid along the camera's axis in every frame [m]; None without an object or its outlines."""
    if take is None or not take.file("observation.npz").is_file() or "masks.windows" not in take.read_arrays("observation.npz"):
        return None
    seen = read_seen(take, field_summary(take))
    if seen is None or seen.surface is None:
        return None
    poses = np.broadcast_to(seen.camera.camera_to_world, (len(seen.motion), 4, 4))
    return np.einsum("ti,ti->t", seen.motion.mean(axis=1) - poses[:, :3, 3], poses[:, :3, 2])


def plate_of(take: Take | None) -> np.ndarray:
    """As `background_of`, but raises UsageError if there is no clean plate."""
    if take is None or not take.file("observation.npz").is_file():
        raise UsageError("There is no clean plate.", "It comes from recovering a clip; use the clip itself as background.")
    plate = background_of(take)
    if plate is None:
        raise UsageError(f"{take.path} holds no clean plate.", "Run Recover again, or use the clip itself as background.")
    return plate


def background_of(take: Take | None) -> np.ndarray | None:
    """The clean plate (H, W, 3) uint8 sRGB, without the clip's object; None if the take has none."""
    if take is None or not take.file("observation.npz").is_file():
        return None
    plate = take.read_arrays("observation.npz").get("background")
    return plate if plate is not None and plate.ndim == 3 else None
