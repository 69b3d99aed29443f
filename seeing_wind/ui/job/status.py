"""What the panel shows, as plain state: `draw` reads it and computes nothing. No bpy here.

One `SceneStatus` per scene, found by the scene's session id, which survives renaming and undo. Only transient facts are stored here
(running, failed); what is done or stale follows from digests in the scene (see `ui/freshness.py`), and so stays right after undo and save.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from .panel_words import in_panel_words, residual_told


class State(StrEnum):
    """The state of one step."""

    IDLE = "idle"
    DONE = "done"
    STALE = "stale"
    RUNNING = "running"
    FAILED = "failed"


STEPS = ("clip", "object", "recover", "edit", "resimulate", "bake")
"""The steps in the order of the work."""

PREVIEW = "preview"
"""The preview of the step *object*, with a state of its own."""

EDIT_PREVIEW = "edit_preview"
"""The preview of the step *resimulate*, likewise."""

LINKED = ("This scene is linked from another file and cannot be changed here.", "Work in a scene of this file.")

SPANS = {
    "observe": (0.0, 0.15), "build": (0.15, 0.25), "recover": (0.25, 0.85), "distill": (0.85, 0.95), "refine": (0.85, 0.95),
    "report": (0.95, 1.0),
}  # fmt: skip
"""The part of the whole bar that each stage of `recover` fills; any other stage fills the whole bar."""

PREVIEW_SPANS = {"observe": (0.0, 0.85), "preview": (0.85, 1.0)}
"""The same for a preview, which ends before the solve."""


@dataclass
class Step:
    """The state of one step, with its messages."""

    state: State = State.IDLE
    fraction: float = 0.0
    """0..1 while running."""
    message: str = ""
    hint: str = ""
    """What to do about a failure."""
    mend: str = ""
    """Name of the control that mends the failure (see `panel_pieces.MENDS`), or "" for none."""
    log: str = ""
    digest: str | None = None
    """While failed: digest of the settings that failed. Other settings clear the failure, unless this is None."""
    started: float = 0.0
    """While running: when it began, or when it had skipped what an earlier run had finished [s of the monotonic clock]."""
    inherited: float = 0.0
    """While running: the part of `fraction` that an earlier run had finished."""
    residual: str = ""
    """While running: residual of the recovery's latest simulation, as text."""
    expected: float | None = None
    """While running: predicted duration of the solve on this machine [s]."""


@dataclass
class SceneStatus:
    """All steps of one scene."""

    steps: dict[str, Step] = field(default_factory=lambda: {name: Step() for name in (*STEPS, PREVIEW, EDIT_PREVIEW)})
    running: str = ""
    """The step that runs now, or ""."""
    cancelling: bool = False
    title: str = ""
    """What is running, for jobs that are not a step (installing the engine)."""
    warnings: list[str] = field(default_factory=list)
    """Warnings of the last job, which belonged to the step `warned`; empty once they are stored with its result (see `notes`)."""
    warned: str = ""
    asked: dict[str, str] = field(default_factory=dict)
    """Digest of each step's present settings, as last given to `derive`."""
    foreseen: bool = False
    """Whether the prediction of the solve by *Preview* still holds."""
    previewed: list[str] = field(default_factory=list)
    """Bodies whose objects carry the motion of a preview."""
    overtaken: str = ""
    """Stamp of the scene's re-simulation if, when the file was loaded, its folder held another one by then; else ""."""


@dataclass
class EngineStatus:
    """Whether there is an engine to run, the same for all scenes."""

    python: str = ""
    problem: Step | None = None


_scenes: dict[int, SceneStatus] = {}
engine = EngineStatus()


def of(scene_id: int) -> SceneStatus:
    """The status of the scene with this session id, made on first use."""
    return _scenes.setdefault(scene_id, SceneStatus())


def forget_engine_failures() -> None:
    """Clear failures to install or check the engine, after another engine was found."""
    for each in _scenes.values():
        if "engine" in each.steps and each.steps["engine"].state == State.FAILED:
            del each.steps["engine"]


def forget_all() -> None:
    """Forget the status of all scenes, after another file was loaded."""
    _scenes.clear()


refreshers: list[Callable[[Any], None]] = []
"""Functions that bring the status of a scene up to date: that of `ui/freshness.py`, which imports all features."""


def refresh(scene: Any) -> None:
    """Determine anew which steps are done or stale, after settings or data of a scene have changed."""
    for each in refreshers:
        each(scene)


def begin(status: SceneStatus, step: str, title: str) -> None:
    """Note that a job has started on `step` (a step's name, or "engine"). Failures of later steps, which may lack it, are cleared."""
    if step in STEPS:
        for later in STEPS[STEPS.index(step) + 1 :]:
            if status.steps[later].state == State.FAILED:
                status.steps[later] = Step()
    status.running, status.cancelling, status.title = step, False, title
    status.warnings, status.warned = [], step
    status.steps.setdefault(step, Step())
    status.steps[step] = Step(State.RUNNING, message="Starting", started=time.monotonic())


def receive(status: SceneStatus, step: str, message: dict[str, Any]) -> bool:
    """Process one message of a job. Returns whether there is anything new to draw."""
    entry = status.steps[step]
    kind = message["type"]
    if kind == "progress":
        first, last = (PREVIEW_SPANS if step == PREVIEW else SPANS).get(message.get("stage", ""), (0.0, 1.0))
        entry.fraction = first + (last - first) * min(max(float(message.get("fraction", 0.0)), 0.0), 1.0)
        entry.message = str(message.get("message", "")) or str(message.get("stage", ""))
        if entry.message == KEPT:
            entry.fraction = entry.inherited = last
            entry.started = time.monotonic()
        if "residual" in message:
            entry.residual = residual_told(message)
        if "expected_seconds" in message:
            entry.expected = float(message["expected_seconds"])
    elif kind == "warning":
        status.warnings.append(in_panel_words(str(message.get("message", ""))))
    elif kind == "error":
        entry.message, entry.hint = (in_panel_words(str(message.get(key, ""))) for key in ("message", "hint"))
        entry.mend = str(message.get("mend", ""))
        entry.log = str(message.get("log", ""))
        entry.state = State.FAILED
    else:
        return False
    return True


KEPT = "already done"
"""The engine's message for a stage that an earlier run has finished."""

EARLY = 0.03
"""Share of a job below which no remaining time is estimated."""


def remaining(step: Step, now: float | None = None) -> float | None:
    """Estimated remaining time [s] of a running step, at the rate of this run so far; None while it cannot be estimated."""
    done = step.fraction - step.inherited
    if step.state != State.RUNNING or done < EARLY or step.fraction >= 1.0:
        return None
    passed = (time.monotonic() if now is None else now) - step.started
    return passed * (1.0 - step.fraction) / done


def fail(status: SceneStatus, step: str, message: str, hint: str = "", mend: str = "", *, digest: str = "", log: str = "") -> None:
    """Note that `step` failed, with the settings of `digest`; if that is "" because no job was started, with the present ones."""
    asked = digest or status.asked.get(step)
    status.steps[step] = Step(State.FAILED, message=message, hint=hint, mend=mend, log=log, digest=asked)


def end(status: SceneStatus) -> None:
    """Note that the job is over, whatever its outcome, so that no step is left in the state running."""
    for step in status.steps.values():
        if step.state == State.RUNNING:
            step.state, step.fraction, step.message = State.IDLE, 0.0, ""
    status.running, status.cancelling, status.title = "", False, ""


def derive(status: SceneStatus, step: str, now: str, done: str, message: str = "") -> None:
    """Set a step to idle, done or stale, from the digests of the present settings and of those its result was made with ("" for no result).

    A running step stays running; a failed one stays failed as long as its settings are those that failed.
    """
    entry, status.asked[step] = status.steps[step], now
    if entry.state == State.RUNNING or (entry.state == State.FAILED and entry.digest in (None, now)):
        return
    state = State.IDLE if not done else State.DONE if done == now else State.STALE
    kept = entry.message if state == entry.state else ""
    status.steps[step] = Step(state, message=message or kept)


def digest_of(*parts: object) -> str:
    """A short digest of settings, for `derive`: equal for equal values, in any session and on any machine."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]
