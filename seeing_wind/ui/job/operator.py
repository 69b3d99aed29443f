"""The base of operators that run long jobs. One job, two drivers: a modal timer with a window, a blocking loop without.

An operator supplies `start` (gather inputs, return the generator of messages) and `finish` (take over the results); the rest is here.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass

import bpy
from bpy.app.handlers import persistent

from ...engine.errors import WRONG_INPUT, SeeingWindError
from ..clip.inputs.clips import first_clip_frame
from ..clip.inputs.pace import pace_of_scene
from . import console, notes, status, worker
from .panel_words import in_scene_frames
from .steps_shown import fold_past

TICK = 0.1
"""Seconds between two polls of the worker: often enough for a smooth bar, rare enough to cost nothing."""

PANELS = {"VIEW_3D", "CLIP_EDITOR", "PREFERENCES"}


@dataclass
class Running:
    """A running job of one scene."""

    messages: worker.Messages
    started: bool = False
    cancel: bool = False
    result: worker.Message | None = None
    exit: worker.Message | None = None

    def poll(self) -> list[worker.Message]:
        """Messages of the worker since the last poll; empty once `exit` is set."""
        if self.exit is not None:
            return []
        try:
            batch = self.messages.send(self.cancel) if self.started else next(self.messages)
            self.started = True
        except StopIteration as end:
            self.exit = end.value
            return []
        for message in batch:
            if message["type"] == "result":
                self.result = message
        return batch


jobs: dict[int, Running] = {}
"""Running jobs by the scene's session id: one per scene at a time."""


def kill_all() -> None:
    """End all workers at once, when the file is closed, the extension is switched off, or Blender quits."""
    for key, running in list(jobs.items()):
        del jobs[key]
        running.messages.close()
        status.end(status.of(key))


class JobOperator:
    """Mix-in for every operator that starts a worker."""

    step = ""
    """The step of the panel that the job belongs to, or "engine"."""

    def start(self, scene: bpy.types.Scene) -> worker.Messages:
        """Gather the inputs and return the job. May raise SeeingWindError, and may set `digest` to that of the job's settings."""
        raise NotImplementedError

    def finish(self, scene: bpy.types.Scene, result: worker.Message) -> str:
        """Take over the results of a job that was neither cancelled nor failed; returns the message for the user."""
        raise NotImplementedError

    def withdraw(self, scene: bpy.types.Scene) -> None:
        """Restore the settings that `start` has changed; called when `start` or the worker found that the job's input cannot be used."""

    def owner(self, scene: bpy.types.Scene) -> bpy.types.PropertyGroup | None:
        """The property group that stores the notes of a finished job; None if it is gone. Called only for steps in `notes.KEPT`."""
        return scene.seeing_wind

    def execute(self, context):
        """Start the job: with a window, return at once; without one, wait for it to end."""
        scene, self.digest = context.scene, ""
        self.key = scene.session_uid
        if scene.library is not None:
            self.report({"ERROR"}, " ".join(status.LINKED))
            return {"CANCELLED"}
        if self.key in jobs:
            self.report({"ERROR"}, "A job of this scene is running. Cancel it first.")
            return {"CANCELLED"}
        self.console = console.ReportsBesides() if bpy.app.background else None
        # registered before anything is started, so that a second click finds it
        try:
            jobs[self.key] = Running(self.start(scene))
        except (SeeingWindError, OSError) as error:
            self.withdraw(scene)
            return self._fail(scene, *worker.told(error))
        status.begin(status.of(self.key), self.step, self.bl_label)
        scene.seeing_wind.unfinished = self.step
        if blocks(context):
            return self._block(scene)
        self.timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Poll the worker at every tick; all other events are left to Blender."""
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        running = jobs.get(self.key)
        scene = next((scene for scene in bpy.data.scenes if scene.session_uid == self.key), None)
        if running is None or scene is None:  # the job was ended from outside, or its scene was deleted
            self._stop(context)
            return {"CANCELLED"}
        if scene.seeing_wind.unfinished != self.step:  # an undo has reset it
            scene.seeing_wind.unfinished = self.step
        try:
            self._take_in(running, scene)
            if running.exit is None:
                return {"PASS_THROUGH"}
            self._remove_timer(context)
            return self._conclude(scene, running)
        except (SeeingWindError, OSError) as error:
            self._stop(context)
            return self._fail(scene, *worker.told(error))
        except Exception as error:  # after a defect in this extension, the panel must not show a running job
            traceback.print_exc()
            self._stop(context)
            return self._fail(scene, f"Unexpected {type(error).__name__}: {error}.", "This is a defect: please report it with the log.")

    def cancel(self, context):
        """Called when Blender ends the operator: its window was closed, or another file is loaded."""
        self._stop(context)

    def _block(self, scene: bpy.types.Scene) -> set[str]:
        running = jobs[self.key]
        try:
            running.exit = worker.wait(self._relay(running, scene), lambda message: None)
            return self._conclude(scene, running)
        except (SeeingWindError, OSError) as error:
            return self._fail(scene, *worker.told(error))
        finally:
            # also after a defect in this extension, which Blender reports with its traceback
            scene.seeing_wind.unfinished = ""
            jobs.pop(self.key, None)
            status.end(status.of(self.key))

    def _relay(self, running: Running, scene: bpy.types.Scene) -> worker.Messages:
        """Pass the job's messages through this operator to the blocking driver."""
        while running.exit is None:
            batch = self._take_in(running, scene)
            if running.exit is None:
                running.cancel = bool((yield batch)) or running.cancel
        return running.exit

    def _take_in(self, running: Running, scene: bpy.types.Scene) -> list[worker.Message]:
        frame_of, first = pace_of_scene(scene).frame_of, first_clip_frame(scene.seeing_wind)
        batch = [_in_scene_frames(message, frame_of, first) for message in running.poll()]
        news = [status.receive(status.of(self.key), self.step, message) for message in batch]
        if self.console is not None:
            for message in batch:
                self.console.show(message)
        if any(news):
            redraw()
        return batch

    def _conclude(self, scene: bpy.types.Scene, running: Running) -> set[str]:
        """After the job has ended: take over its results, or report what went wrong."""
        entry, now = status.of(self.key).steps[self.step], status.of(self.key)
        jobs.pop(self.key, None)
        scene.seeing_wind.unfinished = ""
        if running.exit["outcome"] == "cancelled":
            status.end(now)
            status.refresh(scene)
            now.steps[self.step].message = f"Cancelled. {self.bl_label} goes on from what was finished"
            redraw()
            self.report({"WARNING"}, f"{self.bl_label} was cancelled.")
            return {"CANCELLED"}
        if running.exit["outcome"] == "failed":
            if running.exit["code"] == WRONG_INPUT:  # after any other failure, the job can be continued with the same settings
                self.withdraw(scene)
            if running.result is not None and running.result.get("outcome") == "diverged":
                return self._fail(scene, "The recovery diverged.", "Check scale, material and frame rate; see the notes in the log.")
            return self._fail(scene, entry.message, entry.hint, entry.mend, entry.log)
        try:
            said = self.finish(scene, running.result or {})
        except (SeeingWindError, OSError) as error:
            return self._fail(scene, *worker.told(error))
        status.end(now)
        status.refresh(scene)
        now.steps[self.step].message = said
        fold_past(scene.seeing_wind, self.step)
        redraw()
        self.report({"INFO"}, said)
        for warning in now.warnings:
            self.report({"WARNING"}, warning)
        if self.step in notes.KEPT:
            owner, said = self.owner(scene), now.warnings
            now.warnings = []
            if owner is not None:
                notes.keep(owner, self.step, said)
        return {"FINISHED"}

    def _fail(self, scene: bpy.types.Scene, message: str, hint: str, mend: str = "", log: str = "") -> set[str]:
        jobs.pop(scene.session_uid, None)
        scene.seeing_wind.unfinished = ""
        now = status.of(scene.session_uid)
        status.fail(now, self.step, message, hint, mend, digest=self.digest, log=log)
        status.end(now)
        redraw()
        self.report({"ERROR"}, f"{message} {hint}".strip())
        return {"CANCELLED"}

    def _stop(self, context) -> None:
        self._remove_timer(context)
        running = jobs.pop(self.key, None)
        if running is not None:
            running.messages.close()
        status.end(status.of(self.key))
        redraw()

    def _remove_timer(self, context) -> None:
        timer, self.timer = getattr(self, "timer", None), None
        if timer is not None:
            context.window_manager.event_timer_remove(timer)


class SEEING_WIND_OT_cancel(bpy.types.Operator):
    """Stop the running job at its next safe point; finished stages are kept"""

    bl_idname = "seeing_wind.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context):
        """Only while a job runs."""
        return context.scene is not None and context.scene.session_uid in jobs

    def execute(self, context):
        """Request the cancel; the job's own driver carries it out."""
        jobs[context.scene.session_uid].cancel = True
        status.of(context.scene.session_uid).cancelling = True
        redraw()
        return {"FINISHED"}


def _in_scene_frames(message: worker.Message, frame_of: Callable[[int], int], first_frame: int) -> worker.Message:
    """A warning or error with the scene's frame numbers; other messages, such as progress, keep those of the clip."""
    if message["type"] not in ("warning", "error"):
        return message
    return message | {key: in_scene_frames(str(message[key]), frame_of, first_frame) for key in ("message", "hint") if key in message}


def blocks(context) -> bool:
    """Whether there is no window with a timer to drive a job, so that the operator must wait for it."""
    return bpy.app.background or context.window is None


def redraw() -> None:
    """Redraw the panels in all windows."""
    for manager in bpy.data.window_managers:
        for window in manager.windows:
            for area in window.screen.areas:
                if area.type in PANELS:
                    area.tag_redraw()


@persistent
def _before_load(*_: object) -> None:
    kill_all()


def register() -> None:
    """Attach the handler that ends the workers when another file is loaded."""
    unregister()
    bpy.app.handlers.load_pre.append(_before_load)


def unregister() -> None:
    """End the workers now, and detach the handler."""
    kill_all()
    if _before_load in bpy.app.handlers.load_pre:
        bpy.app.handlers.load_pre.remove(_before_load)


CLASSES = (SEEING_WIND_OT_cancel,)
