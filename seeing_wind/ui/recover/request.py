"""What Recover is asked for, as one snapshot of a scene: the worker's options, a digest of them, and the files made from the scene."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ..clip.inputs.clips import files_of
from ..clip.object.options import object_options
from ..clip.options import clip_options, number_text
from ..job.status import digest_of
from ..job.takes import INPUTS, inputs_folder, take_folder
from ..scene_units import metres_per_unit

if TYPE_CHECKING:
    from ..clip.inputs.scene_inputs import SceneInput

OVERRIDES = ("density", "youngs_modulus", "poisson_ratio", "yield_stress", "viscosity", "thickness")
"""Numbers that replace the material's where their tick is set."""


@dataclass(frozen=True)
class RecoverRequest:
    """Everything that a recovery depends on, read from the scene once."""

    take: Path
    """Folder of the results."""
    clip: str
    """Path of the video, or the pattern of a sequence."""
    options: tuple[str, ...]
    """The words of `recover` after the verb, but for the take; `clip` first."""
    inputs: tuple[SceneInput, ...]
    """Files that `options` names in the take's folder `INPUTS`, to be made by `write_inputs`."""
    digest: str
    """Changes whenever the recovery would be another one."""

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> RecoverRequest:
        """The request of a scene as it stands.

        Raises:
            ClipError: when there is no such clip.
            ObjectError: when nothing says where the object is.
            UsageError: when a file, camera or proxy is named that is not there.
        """
        settings = scene.seeing_wind
        return cls.from_parts(scene, clip_options(settings), object_options(settings, inputs_folder(settings)))

    @classmethod
    def from_parts(
        cls, scene: bpy.types.Scene, clip: list[str], marked: tuple[list[str], tuple[SceneInput, ...]]
    ) -> RecoverRequest:
        """The request of a scene of which `clip_options` and `object_options` are known already."""
        options, inputs = clip + marked[0] + _gravity(scene) + _effort(scene.seeing_wind), marked[1]
        take = take_folder(scene.seeing_wind)
        return cls(take, clip[0], tuple(options), inputs, _digest(options, take / INPUTS, inputs))

    def write_inputs(self, scene: bpy.types.Scene) -> None:
        """Make the files that are made from the scene. Raises SeeingWindError where mask, tracks or proxy hold nothing."""
        for each in self.inputs:
            each.write(scene, self.take / INPUTS / each.name)


def _gravity(scene: bpy.types.Scene) -> list[str]:
    """The known acceleration [m/s²]; the scene's own is in its units, as Blender's solvers and its panels understand it."""
    settings = scene.seeing_wind
    if settings.gravity_mode == "NONE" or (settings.gravity_mode == "SCENE" and not scene.use_gravity):
        return ["--no-gravity"]
    gravity = scene.gravity * metres_per_unit(scene) if settings.gravity_mode == "SCENE" else settings.gravity
    return ["--gravity", *(number_text(value) for value in gravity)]


def _effort(settings: bpy.types.PropertyGroup) -> list[str]:
    """The material, and how hard the recovery tries."""
    options = ["--material", settings.material]
    for name in OVERRIDES:
        if getattr(settings, f"use_{name}"):
            options += [f"--{name.replace('_', '-')}", number_text(getattr(settings, name))]
    if settings.law != "PRESET":
        options += ["--law", settings.law.lower()]
    options += ["--iterations", str(settings.iterations), "--seed", str(settings.seed)]
    for name in ("particles", "refine"):  # 0 leaves them to the engine
        if getattr(settings, name):
            options += [f"--{name}", str(getattr(settings, name))]
    return options


def _digest(options: list[str], folder: Path, inputs: tuple[SceneInput, ...]) -> str:
    # files that are made from the scene count by what they are made of
    given = [option for option in options[1:] if os.path.isabs(option) and Path(option).parent != folder and os.path.isfile(option)]
    files = [os.stat(path) for path in (*files_of(options[0]), *given)]
    # by name only, so that a project can be moved
    named = [os.path.basename(option) if os.path.isabs(option) else option for option in options]
    return digest_of(named, [(entry.st_size, entry.st_mtime_ns) for entry in files], tuple(each.stamp for each in inputs))
