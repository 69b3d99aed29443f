"""The request of Recover as a snapshot of a scene. All later steps work from the snapshot, not from the scene."""

from __future__ import annotations

import dataclasses
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ...engine.conventions import PANEL_INPUTS
from ...engine.errors import UsageError
from ...engine.settings import BuildSettings, ObserveSettings, RecoverSettings, WindSettings, options_of, words_of
from ..clip.inputs.clip_files import content_of, files_of
from ..clip.object.options import object_options
from ..clip.options import View, clip_options
from ..job.status import digest_of
from ..job.takes import take_folder
from ..option_properties import part_of, single, values_of
from ..scene_units import metres_per_unit

if TYPE_CHECKING:
    from ..clip.inputs.scene_inputs import SceneInput



@dataclass(frozen=True)
class RecoverRequest:
    """Everything that a recovery depends on, read from the scene once."""

    take: Path
    """Folder of the results."""
    clip: str
    """Path of the video, or the pattern of a sequence."""
    observe: ObserveSettings
    build: BuildSettings
    recover: RecoverSettings
    wind: WindSettings = WindSettings()
    views: tuple[View, ...] = ()
    inputs: tuple[SceneInput, ...] = ()
    """Files that `observe` names in the take's folder `PANEL_INPUTS`, to be made by `write_inputs`."""

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> RecoverRequest:
        """The request of a scene as it stands.

        Raises:
            ClipError: when there is no such clip.
            ObjectError: when the object is not marked.
            UsageError: when a file, camera or proxy that the settings name does not exist.
        """
        settings, take = scene.seeing_wind, take_folder(scene.seeing_wind)
        values = scene_values(settings)
        clip, marked = clip_options(settings, values), object_options(settings, values, take / PANEL_INPUTS)
        return cls.from_parts(scene, values, take, clip, marked)

    @classmethod
    def from_parts(
        cls, scene: bpy.types.Scene, values: dict[str, Any], take: Path, clip: tuple[str, dict[str, Any], tuple[View, ...]],
        marked: tuple[dict[str, Any], tuple[SceneInput, ...]],
    ) -> RecoverRequest:  # fmt: skip
        """The request of a scene from the results of `scene_values`, `take_folder`, `clip_options` and `object_options`."""
        existing_take(values["body"])
        return cls(
            take, clip[0], ObserveSettings(**marked[0] | clip[1]), BuildSettings(**part_of(values, BuildSettings)),
            RecoverSettings(**part_of(values, RecoverSettings, gravity=_gravity(scene, values))),
            WindSettings(**part_of(values, WindSettings)), clip[2], marked[1],
        )  # fmt: skip

    def arguments(self) -> list[str]:
        """Command-line arguments of `recover`, after the verb."""
        views = [word for view in self.views for word in ("--view", *view)]
        return [self.clip, *words_of(self.observe, self.build, self.recover, self.wind), *views, "--take", str(self.take)]

    def files(self) -> list[Path]:
        """All files that the recovery reads, except those made from the scene."""
        named = [getattr(self.observe, name) for name in FILES]
        given = [Path(path) for path in named if path is not None and Path(path).parent != self.take / PANEL_INPUTS]
        if self.recover.body is not None:
            given.append(Path(self.recover.body, "trajectory.npz"))
        return [*files_of(self.clip), *given, *(Path(path) for view in self.views for path in view)]

    def digest(self) -> str:
        """Digest of all that the result depends on. Files count by name and content, so that a project can be moved or copied."""
        names = {name: os.path.basename(getattr(self.observe, name) or "") or None for name in FILES}
        body = os.path.basename(self.recover.body or "") or None
        views = [os.path.basename(path) for view in self.views for path in view]
        return digest_of(
            os.path.basename(self.clip), dataclasses.replace(self.observe, **names), self.build,
            dataclasses.replace(self.recover, body=body), views,
            [content_of(path) for path in self.files()],
            tuple(each.stamp for each in self.inputs),  # a file made from the scene counts by its source data
            *([self.wind] if self.wind != WindSettings() else []),  # so that digests from before this option existed stay valid
        )  # fmt: skip

    def write_inputs(self) -> None:
        """Write the files made from the scene. Raises SeeingWindError when mask, tracks or proxy are empty."""
        for each in self.inputs:
            each.write(self.take / PANEL_INPUTS / each.name)


def existing_take(folder: str | None) -> None:
    """Raise UsageError when `folder` is given and is no take with a recovered field."""
    if folder is not None and not all(Path(folder, name).is_file() for name in ("field.safetensors", "trajectory.npz")):
        raise UsageError(f"{folder} holds no recovered field.", "Choose the take of another recovery, or clear Same Body As.")


FILES = [one.name for one in options_of(ObserveSettings).values() if one.file]


def scene_values(settings: bpy.types.PropertyGroup) -> dict[str, Any]:
    """The values of all options of a recovery, as the panel has them."""
    return values_of(settings, ObserveSettings, BuildSettings, RecoverSettings, WindSettings)


def _gravity(scene: bpy.types.Scene, values: dict[str, Any]) -> tuple[float, ...]:
    """(3,) the gravity [m/s²] that the settings choose."""
    settings = scene.seeing_wind
    if settings.gravity_mode == "NONE" or (settings.gravity_mode == "SCENE" and not scene.use_gravity):
        return (0.0, 0.0, 0.0)
    if settings.gravity_mode == "CUSTOM":
        return values["gravity"]
    return gravity_of(scene)


def gravity_of(scene: bpy.types.Scene) -> tuple[float, ...]:
    """(3,) the scene's gravity [m/s²], enabled or not; Blender stores it in units of the scene."""
    return tuple(single(value) for value in scene.gravity * metres_per_unit(scene))
