"""What the panel shows, as plain state: `draw` reads it and computes nothing. No bpy here.

One `SceneStatus` per scene, found by the scene's session id, which survives renaming and undo. Only transient facts live here (running,
failed); what is done or stale follows from digests kept in the scene (see `ui/freshness.py`), so undo and save keep them right.
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
    """Of one step of the work."""

    IDLE = "idle"
    DONE = "done"
    STALE = "stale"
    RUNNING = "running"
    FAILED = "failed"


STEPS = ("clip", "object", "recover", "edit", "resimulate", "bake")
"""In the order of the work."""

PREVIEW = "preview"
"""A part of the step *object* with a state of its own."""

EDIT_PREVIEW = "edit_preview"
"""The same of the step *resimulate*."""

LINKED = ("This scene is linked from another file and cannot be changed here.", "Work in a scene of this file.")

SPANS = {
    "observe": (0.0, 0.15), "build": (0.15, 0.25), "recover": (0.25, 0.85), "distill": (0.85, 0.95), "refine": (0.85, 0.95),
    "report": (0.95, 1.0),
}  # fmt: skip
"""Which part of the whole bar a stage of `recover` fills; other stages fill it all."""

PREVIEW_SPANS = {"observe": (0.0, 0.85), "preview": (0.85, 1.0)}
"""The same of a preview, which is over where a recovery goes on."""


@dataclass
class Step:
    """How one step stands."""

    state: State = State.IDLE
    fraction: float = 0.0
    """0..1 while running."""
    message: str = ""
    hint: str = ""
    """What to do about a failure."""
    mend: str = ""
    """Name of the control that mends it (see `panel_pieces.MENDS`), or "" for none."""
    log: str = ""
    digest: str | None = None
    """While failed: the settings that failed. Others make the failure a thing of the past, unless this is None."""
    started: float = 0.0
    """While running: when it began, or when it was through with what an earlier run had finished [s of the monotonic clock]."""
    inherited: float = 0.0
    """While running: the part of `fraction` that an earlier run had finished."""
    residual: str = ""
    """While running: how far the recovery's latest simulation is from what was seen."""
    expected: float | None = None
    """While running: what the solve takes on this machine, as it was foreseen [s]."""


@dataclass
class SceneStatus:
    """All steps of one scene."""

    steps: dict[str, Step] = field(default_factory=lambda: {name: Step() for name in (*STEPS, PREVIEW, EDIT_PREVIEW)})
    running: str = ""
    """The step that runs now, or ""."""
    cancelling: bool = False
    title: str = ""
    """What runs, for jobs that are no step (installing the engine)."""
    warnings: list[str] = field(default_factory=list)
    """Of the last job, which belonged to the step `warned`; empty once they are kept with its result (see `notes`)."""
    warned: str = ""
    asked: dict[str, str] = field(default_factory=dict)
    """Digest of each step's present settings, as `derive` was told it last."""
    foreseen: bool = False
    """Whether what *Preview* said of the solve still holds."""
    previewed: list[str] = field(default_factory=list)
    """Bodies whose objects carry the motion of a preview."""
    overtaken: str = ""
    """Stamp of the scene's re-simulation, when the file was loaded and another one lay in its folder by then; else ""."""


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
    """The engine is another one: why it could not be installed or checked before is a thing of the past."""
    for each in _scenes.values():
        if "engine" in each.steps and each.steps["engine"].state == State.FAILED:
            del each.steps["engine"]


def forget_all() -> None:
    """After a file was loaded: its scenes are others."""
    _scenes.clear()


refreshers: list[Callable[[Any], None]] = []
"""Who brings the status of a scene up to date: `ui/freshness.py`, which knows all features and stands above them."""


def refresh(scene: Any) -> None:
    """Settings or data of a scene have changed: which steps are done or stale is found out anew."""
    for each in refreshers:
        each(scene)


def begin(status: SceneStatus, step: str, title: str) -> None:
    """A job has started on `step` (a step's name, or "engine"). What failed later in the work for want of it is a thing of the past."""
    if step in STEPS:
        for later in STEPS[STEPS.index(step) + 1 :]:
            if status.steps[later].state == State.FAILED:
                status.steps[later] = Step()
    status.running, status.cancelling, status.title = step, False, title
    status.warnings, status.warned = [], step
    status.steps.setdefault(step, Step())
    status.steps[step] = Step(State.RUNNING, message="Starting", started=time.monotonic())


def receive(status: SceneStatus, step: str, message: dict[str, Any]) -> bool:
    """Take in one message of a job. Returns whether there is anything new to draw."""
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
"""What the engine says of a stage that an earlier run has finished."""

EARLY = 0.03
"""Share of a job under which nothing is said of the time it still takes."""


def remaining(step: Step, now: float | None = None) -> float | None:
    """Seconds that a running step still takes if it goes on as so far in this run; None while that cannot be said."""
    done = step.fraction - step.inherited
    if step.state != State.RUNNING or done < EARLY or step.fraction >= 1.0:
        return None
    passed = (time.monotonic() if now is None else now) - step.started
    return passed * (1.0 - step.fraction) / done


def fail(status: SceneStatus, step: str, message: str, hint: str = "", mend: str = "", *, digest: str = "", log: str = "") -> None:
    """`step` could not be done, with the settings of `digest`; with the present ones, where it got no job."""
    asked = digest or status.asked.get(step)
    status.steps[step] = Step(State.FAILED, message=message, hint=hint, mend=mend, log=log, digest=asked)


def end(status: SceneStatus) -> None:
    """The job is over, whatever came of it: nothing is ever left running."""
    for step in status.steps.values():
        if step.state == State.RUNNING:
            step.state, step.fraction, step.message = State.IDLE, 0.0, ""
    status.running, status.cancelling, status.title = "", False, ""


def derive(status: SceneStatus, step: str, now: str, done: str, message: str = "") -> None:
    """Idle, done or stale, from the digest of the present settings and of those that the result was made with ("" for no result).

    A running step stays running; a failed one stays failed as long as its settings are those that failed.
    """
    entry, status.asked[step] = status.steps[step], now
    if entry.state == State.RUNNING or (entry.state == State.FAILED and entry.digest in (None, now)):
        return
    state = State.IDLE if not done else State.DONE if done == now else State.STALE
    kept = entry.message if state == entry.state else ""
    status.steps[step] = Step(state, message=message or kept)


def digest_of(*parts: object) -> str:
    """A short digest of settings, for `derive`: equal for equal values, whatever session or machine they are in."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]
