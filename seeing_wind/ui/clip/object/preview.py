"""Preview the engine's observations of the object in the clip, with verdicts on them, before the solve."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ....engine.conventions import PANEL_INPUTS
from ....engine.settings import BuildSettings, ObserveSettings, RecoverSettings, options_of, words_of
from ...job import takes, worker
from ...job.install.choices import outline_model
from ...job.install.environment import engine_python
from ...job.operator import JobOperator
from ...job.panel_words import in_panel_words, in_scene_frames
from ...job.status import digest_of
from ...job.worker_command import ROOT, command, environment
from ...option_properties import part_of, values_of
from ..inputs.clip_files import content_of, files_of
from ..inputs.clips import clip_of, first_clip_frame
from ..inputs.pace import pace_of_scene
from ..options import View, clip_options
from .options import object_options

if TYPE_CHECKING:
    from ..inputs.scene_inputs import SceneInput

    Clip = tuple[str, dict[str, Any], tuple[View, ...]]
    Marked = tuple[dict[str, Any], tuple[SceneInput, ...]]

IMAGE, FILM, HELD = "preview.png", "preview.mp4", "held.png"
"""Files of the preview that the engine writes into the take."""
ICON = 640
"""Largest width of the preview's icon in pixels."""


class SEEING_WIND_OT_preview(JobOperator, bpy.types.Operator):
    """Show outline, tracks, held place and scale as they are seen in the clip, and what can be trusted. Recover goes on from it"""

    bl_idname = "seeing_wind.preview"
    bl_label = "Preview"
    bl_options = {"UNDO"}
    step = "preview"

    def start(self, scene):
        """Start observing the clip with the same options as Recover."""
        settings = scene.seeing_wind
        self.folder, python, self.first = takes.take_folder(settings), engine_python(), first_clip_frame(settings)
        values = values_of(settings, ObserveSettings, BuildSettings, RecoverSettings)
        clip = clip_options(settings, values)
        takes.refuse_of_another(self.folder, clip[0])
        marked = object_options(settings, values, self.folder / PANEL_INPUTS)
        self.digest, self.foreseen = preview_digest(clip, marked), foreseen_digest(values, clip, marked)
        takes.bring_along(settings, self.folder)
        for each in marked[1]:
            each.write(self.folder / PANEL_INPUTS / each.name)
        words = [*words_of(_asked(clip, marked), *_solved(values)), *(word for view in clip[2] for word in ("--view", *view))]
        call = command(python, "observe", clip[0], *words, "--take", str(self.folder))
        return worker.run(call, cwd=str(ROOT), env=environment(outline_model=outline_model()))

    def finish(self, scene, result):
        """Store the verdicts, worst first, and load the preview image."""
        settings, frame_of = scene.seeing_wind, pace_of_scene(scene).frame_of
        settings.verdicts.clear()
        for each in result.get("verdicts", []):
            verdict, said = settings.verdicts.add(), [in_scene_frames(each[key], frame_of, self.first) for key in ("item", "because", "do")]
            verdict.name, verdict.because, verdict.advice = map(in_panel_words, said)
            verdict.doubtful = each["severity"] > 0.0
        settings.previewed_take, settings.previewed_digest, settings.foreseen_digest = str(self.folder), self.digest, self.foreseen
        settings.proposed_pin = str(self.folder / HELD) if HELD in result.get("files", []) else ""
        settings.preview_image = _loaded(self.folder / IMAGE, clip_of(settings))
        doubtful = [verdict.name for verdict in settings.verdicts if verdict.doubtful]
        return f"Doubtful: {', '.join(doubtful)}" if doubtful else "All that is seen looks good"


def preview_digest(clip: Clip, marked: Marked) -> str:
    """Digest of everything that the observations depend on, from the results of `clip_options` and `object_options`.

    The held place is left out, since it is marked after the clip is observed.
    """
    asked = dataclasses.replace(_asked(clip, marked), pin=None)
    named = {one.name: getattr(asked, one.name) for one in options_of(ObserveSettings).values() if one.file}
    # files made from the scene count by their source data
    made = {each.option: each.stamp for each in marked[1] if each.option != "pin"}
    given = [path for name, path in named.items() if path is not None and name not in made]
    files = (*files_of(clip[0]), *given, *(path for view in clip[2] for path in view))
    names = {name: os.path.basename(path) if path is not None else None for name, path in named.items()}
    views = [os.path.basename(path) for view in clip[2] for path in view]
    return digest_of(
        os.path.basename(clip[0]), dataclasses.replace(asked, **names), views,
        [content_of(path) for path in files], tuple(made.values()),
    )  # fmt: skip


def foreseen_digest(values: dict[str, Any], clip: Clip, marked: Marked) -> str:
    """Digest of everything that the forecast of the solve depends on, from `values_of`, `clip_options` and `object_options`."""
    pins, pin = [each.stamp for each in marked[1] if each.option == "pin"], marked[0].get("pin")
    held = pins or (content_of(pin) if pin is not None else None)
    return digest_of(preview_digest(clip, marked), _solved(values), held)


def _solved(values: dict[str, Any]) -> tuple[BuildSettings, RecoverSettings]:
    """The settings, besides the observations, on which the solve's duration depends."""
    return BuildSettings(**part_of(values, BuildSettings)), RecoverSettings(iterations=values["iterations"])


def _asked(clip: Clip, marked: Marked) -> ObserveSettings:
    return ObserveSettings(**marked[0] | clip[1])


def _loaded(path: Path, clip: bpy.types.MovieClip | None) -> bpy.types.Image:
    """Load or reload the preview as an image of this .blend file. Its icon is cropped to the clip's frame, without the text below it,
    which the panel shows anyway."""
    import numpy as np

    image = bpy.data.images.load(str(path), check_existing=True)
    image.reload()
    icon, (width, height) = image.preview_ensure(), image.size
    if icon is None or clip is None or not width or not clip.size[0]:
        return image
    pixels = np.empty(4 * width * height, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    # rows start at the bottom
    frame = pixels.reshape(height, width, 4)[max(height - round(width * clip.size[1] / clip.size[0]), 0) :]
    step = -(-width // ICON)
    small = np.ascontiguousarray(frame[::step, ::step])
    icon.image_size = small.shape[1::-1]
    icon.image_pixels_float.foreach_set(small.ravel())
    return image


CLASSES = (SEEING_WIND_OT_preview,)
