"""From the settings of a scene to the worker's command lines: the same options that a user would type."""

from __future__ import annotations

import os
from pathlib import Path

import bpy

from ...engine.errors import ClipError, ObjectError, UsageError
from ..clip import inputs as native
from ..units import metres_per_unit
from .takes import take_folder

ROOT = Path(__file__).resolve().parents[2]
"""The folder that holds the package `seeing_wind`: there the worker finds it under its plain name."""


def command(python: str, verb: str, *options: str) -> list[str]:
    """The worker's command line."""
    return [python, "-m", "seeing_wind.engine", verb, *options]


KEY_VARIABLE = "SEEING_WIND_MATERIAL_KEY"
"""Where the engine looks for the key of the model that is asked about materials."""


def environment(key: str = "") -> dict[str, str]:
    """This process's environment without Blender's Python settings, which would break another Python. `key` is for one that asks."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    # Bytecode stays out of the extension's folder, which Blender owns and may not be writable.
    if key:
        kept[KEY_VARIABLE] = key
    return kept | {"PYTHONPATH": str(ROOT), "PYTHONUTF8": "1", "PYTHONNOUSERSITE": "1", "PYTHONDONTWRITEBYTECODE": "1"}


def clip_options(settings: bpy.types.PropertyGroup) -> list[str]:
    """The clip and which part of it.

    Raises:
        ClipError: when there is no such file.
    """
    if not settings.clip:
        raise ClipError("No clip is chosen.", "Choose a video of something that is moved by forces.")
    path = native.clips.absolute(settings.clip)
    if not os.path.isfile(path):
        raise ClipError(f"There is no file {path}.", "Choose the clip again; it may have been moved.")
    options = [native.clips.as_pattern(path)]
    if settings.fps > 0.0:
        options += ["--fps", _number(settings.fps)]
    elif options[0] != path:  # pictures carry no rate: they play at the scene's
        render = settings.id_data.render
        options += ["--fps", _number(render.fps / render.fps_base)]
    if settings.use_frames:
        first, last = settings.frames
        if last <= first:
            raise ClipError(f"Pictures {first} to {last} are none.", "The last picture must come after the first.")
        options += ["--frames", f"{first}:{last}"]
    return options


def object_options(settings: bpy.types.PropertyGroup) -> list[str]:
    """Which object, at what scale, through which camera. What the scene knows itself is named as files that `native.write` makes.

    Raises:
        ObjectError: when nothing says where the object is.
        UsageError: when a file is named that is not there.
    """
    marked = _marked(settings)  # first: while nothing is marked, nothing of `native` is needed
    options = native.options(settings.id_data, inputs_folder(settings)) + marked
    if settings.pin:
        options += ["--pin", _existing(settings.pin, "picture of the held places")]
    if settings.scale_mode == "PIXELS":
        options += ["--pixels-per-metre", _number(settings.pixels_per_metre)]
    elif settings.scale_mode == "DISTANCE" or (settings.scale_mode == "AUTO" and "--camera" not in options):
        # without either the engine takes the distance of the world's origin from the camera
        options += ["--distance", _number(settings.distance)]
    if "--camera" in options:
        return options
    if settings.camera_mode == "JSON":
        if not settings.camera:
            raise UsageError("No camera file is chosen.", "Choose one, or use a field of view.")
        return [*options, "--camera", _existing(settings.camera, "camera file")]
    return [*options, "--fov", _number(settings.fov)]


def _marked(settings: bpy.types.PropertyGroup) -> list[str]:
    """Where the object is, as a file or numbers of the user's say it; what the scene knows itself is `native`'s."""
    if settings.object_mode == "MASK":
        if not settings.mask:
            raise ObjectError("No mask is chosen.", "Choose a PNG of the first picture, non-zero where the object is, or draw a box.")
        return ["--mask", _existing(settings.mask, "mask")]
    if settings.object_mode == "BOX":
        x0, y0, x1, y1 = settings.box
        if x1 <= x0 or y1 <= y0:
            raise ObjectError("No box is drawn round the object.", "Use Draw Box, or give left, top, right and bottom in pixels.")
        return ["--box", *(_number(value) for value in (x0, y0, x1, y1))]
    return []


def inputs_folder(settings: bpy.types.PropertyGroup) -> Path:
    """Where the masks, tracks, camera and depth of the scene are written for the engine."""
    return take_folder(settings) / native.INPUTS


def gravity_options(scene: bpy.types.Scene) -> list[str]:
    """The known acceleration [m/s²]; the scene's own is in its units, as Blender's solvers and its panels understand it."""
    settings = scene.seeing_wind
    if settings.gravity_mode == "NONE" or (settings.gravity_mode == "SCENE" and not scene.use_gravity):
        return ["--no-gravity"]
    gravity = scene.gravity * metres_per_unit(scene) if settings.gravity_mode == "SCENE" else settings.gravity
    return ["--gravity", *(_number(value) for value in gravity)]


def recover_options(scene: bpy.types.Scene) -> list[str]:
    """All options of `recover` but the take. Raises as `clip_options` and `object_options` do."""
    settings = scene.seeing_wind
    options = clip_options(settings) + object_options(settings) + gravity_options(scene) + ["--material", settings.material]
    for name in ("density", "youngs_modulus", "poisson_ratio", "yield_stress", "viscosity", "thickness"):
        if getattr(settings, f"use_{name}"):
            options += [f"--{name.replace('_', '-')}", _number(getattr(settings, name))]
    if settings.law != "PRESET":
        options += ["--law", settings.law.lower()]
    options += ["--iterations", str(settings.iterations), "--seed", str(settings.seed)]
    for name in ("particles", "refine"):  # 0 leaves them to the engine
        if getattr(settings, name):
            options += [f"--{name}", str(getattr(settings, name))]
    return options


def _existing(path: str, what: str) -> str:
    found = native.clips.absolute(path)
    if not os.path.isfile(found):
        raise UsageError(f"There is no {what} {found}.", "Choose it again; it may have been moved.")
    return found


def _number(value: float) -> str:
    """Blender keeps single precision: seven digits say all of it, and 30.19 stays 30.19. Never an exponent's minus sign alone."""
    return f"{value:.7g}"
