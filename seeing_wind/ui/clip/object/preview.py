"""Looking first: what the engine sees of the object in the clip, drawn and judged, before anything is solved."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ....engine.errors import UsageError
from ...direct_operator import DirectOperator
from ...job import takes, worker
from ...job.install.environment import engine_python
from ...job.operator import JobOperator
from ...job.status import digest_of
from ...job.worker_command import ROOT, command, environment
from ..inputs.clips import files_of
from ..options import clip_options
from .options import object_options

if TYPE_CHECKING:
    from ..inputs.scene_inputs import SceneInput

PICTURE, FILM, HELD = "preview.png", "preview.mp4", "held.png"
"""What the engine leaves in the take."""


class SEEING_WIND_OT_preview(JobOperator, bpy.types.Operator):
    """Show outline, tracks, held place and scale as they are seen in the clip, and what can be trusted. Recover goes on from it"""

    bl_idname = "seeing_wind.preview"
    bl_label = "Preview"
    bl_options = {"UNDO"}
    step = "preview"

    def start(self, scene):
        """The clip and the object, as Recover is asked for them."""
        settings = scene.seeing_wind
        clip, inputs = clip_options(settings), takes.inputs_folder(settings)
        marked, python = object_options(settings, inputs), engine_python()
        self.folder, self.digest = takes.take_folder(settings), preview_digest(clip, marked)
        takes.bring_along(settings, self.folder)
        for each in marked[1]:
            each.write(scene, inputs / each.name)
        return worker.run(
            command(python, "observe", *clip, *marked[0], "--take", str(self.folder)), cwd=str(ROOT), env=environment()
        )

    def finish(self, scene, result):
        """The verdicts, the worst first, and the picture."""
        settings = scene.seeing_wind
        settings.verdicts.clear()
        for each in result.get("verdicts", []):
            verdict = settings.verdicts.add()
            verdict.name, verdict.because, verdict.advice = (each[key] for key in ("item", "because", "do"))
            verdict.doubtful = each["severity"] > 0.0
        settings.previewed_take, settings.previewed_digest = str(self.folder), self.digest
        settings.proposed_pin = str(self.folder / HELD) if HELD in result.get("files", []) else ""
        settings.previewed_picture = _loaded(self.folder / PICTURE)
        doubtful = [verdict.name for verdict in settings.verdicts if verdict.doubtful]
        return f"Doubtful: {', '.join(doubtful)}" if doubtful else "All that is seen looks good"


class SEEING_WIND_OT_use_held(DirectOperator, bpy.types.Operator):
    """Take the proposed place as the one at which the object is held; nothing is looked at again for it"""

    bl_idname = "seeing_wind.use_held"
    bl_label = "Use as Held Place"

    def act(self, context):
        """The proposed picture becomes the setting."""
        settings = context.scene.seeing_wind
        if not settings.proposed_pin or not os.path.isfile(settings.proposed_pin):
            raise UsageError("No held place is proposed.", "Run Preview first.")
        settings.pin = settings.proposed_pin
        return "The object is held at the proposed place"


def preview_digest(clip: list[str], marked: tuple[list[str], tuple[SceneInput, ...]]) -> str:
    """Changes whenever something else would be seen: of the words and files of `clip_options` and `object_options`.

    A held place is none of it: it is marked in what was seen.
    """
    words = [*clip[1:], *marked[0]]
    if "--pin" in words:
        del words[words.index("--pin") : words.index("--pin") + 2]
    # files that are made from the scene count by what they are made of
    given = [word for word in words if os.path.isabs(word) and Path(word).parent.name != takes.INPUTS and os.path.isfile(word)]
    files = [os.stat(path) for path in (*files_of(clip[0]), *given)]
    named = [os.path.basename(word) if os.path.isabs(word) else word for word in (clip[0], *words)]
    return digest_of(named, [(entry.st_size, entry.st_mtime_ns) for entry in files], tuple(each.stamp for each in marked[1]))


def _loaded(path: Path) -> bpy.types.Image:
    """The picture as an image of this file, read anew where an earlier preview is there already."""
    image = bpy.data.images.load(str(path), check_existing=True)
    image.reload()
    image.preview_ensure()
    return image


CLASSES = (SEEING_WIND_OT_preview, SEEING_WIND_OT_use_held)
