"""The panel's side under Windows' rules, put in place of ours: how a worker is started and ended, and where its Python is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from seeing_wind.engine import systems
from seeing_wind.engine.errors import SeeingWindError
from seeing_wind.engine.progress import CANCEL_BY_STDIN
from seeing_wind.ui.job import worker as job
from seeing_wind.ui.job.install import choices
from seeing_wind.ui.job.install import environment as engine_environment
from seeing_wind.ui.job.install import install as engine_install
from seeing_wind.ui.job.worker_command import environment

WORKER = Path(__file__).resolve().parents[1] / "fake_worker.py"


@pytest.fixture
def on_windows(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    monkeypatch.setattr(systems, "windows", lambda: True)
    monkeypatch.setattr(systems, "long_paths", lambda: False)
    return monkeypatch


@pytest.fixture
def calls(on_windows: pytest.MonkeyPatch) -> list[tuple[list[str], dict]]:
    """What `subprocess` was asked for. The processes are real, without the options that only Windows takes."""
    asked: list[tuple[list[str], dict]] = []
    start, run = subprocess.Popen, subprocess.run

    def started(command, **options):
        asked.append((command, dict(options)))
        return start(command, **{key: value for key, value in options.items() if key != "creationflags"})

    def ran(command, **options):
        asked.append((command, dict(options)))
        if command[0] == "taskkill":
            raise FileNotFoundError(command[0])  # and so `kill` ends the worker
        return run(command, **{key: value for key, value in options.items() if key != "creationflags"})

    on_windows.setattr(job.subprocess, "Popen", started)
    on_windows.setattr(job.subprocess, "run", ran)
    return asked


def ended_by_cancel(behaviour: str, grace: float = 0.4) -> list[dict]:
    messages = job.run([sys.executable, str(WORKER), behaviour], cwd=str(WORKER.parent), env=environment(), grace=grace)
    seen: list[dict] = []
    while not any(message["type"] == "progress" for message in seen):
        seen += next(messages)
    seen += messages.send(True)
    job.wait(messages, seen.append, pause=0.01)
    return seen


def test_a_worker_opens_no_console_and_stops_when_the_pipe_says_so(calls) -> None:
    seen = ended_by_cancel("hang", grace=60.0)
    assert seen[-1]["outcome"] == "cancelled" and seen[-1]["code"] == 130
    ((_, options),) = calls
    assert options["creationflags"] == systems.NO_WINDOW | systems.NEW_GROUP and "start_new_session" not in options
    assert options["stdin"] == subprocess.PIPE and options["encoding"] == "utf-8" and options["env"][CANCEL_BY_STDIN] == "1"
    assert options["env"]["PYTHONUTF8"] == "1", "what a Windows program prints is in an old code page otherwise"


def test_a_worker_that_does_not_listen_is_ended_with_all_that_it_started(calls) -> None:
    seen = ended_by_cancel("stubborn")
    assert seen[-1]["outcome"] == "cancelled"
    command, options = next(call for call in calls if call[0][0] == "taskkill")
    assert {"/F", "/T", "/PID"} <= set(command) and command[-1].isdigit() and options["creationflags"] == systems.NO_WINDOW


def test_where_the_environment_s_python_is(on_windows, tmp_path) -> None:
    assert engine_environment.executable(tmp_path) == tmp_path / "Scripts" / "python.exe"
    programs = engine_install.programs("python", tmp_path, "")
    assert programs[-1].command[0] == str(tmp_path / "Scripts" / "python.exe")


def test_a_question_to_a_python_opens_no_console_and_is_read_as_utf8(calls) -> None:
    assert engine_environment.said_by([sys.executable], "print('Müller 风')").strip() == "Müller 风"
    _, options = calls[0]
    assert options["creationflags"] == systems.NO_WINDOW and options["stdin"] == subprocess.DEVNULL


def test_the_launcher_is_asked_for_pythons_that_are_not_on_the_path(on_windows, tmp_path) -> None:
    launcher = tmp_path / "py"
    launcher.write_text(f'#!/bin/sh\n[ "$1" = -3.12 ] && shift && exec "{sys.executable}" "$@"\nexit 103\n')
    launcher.chmod(0o755)
    on_windows.setattr(engine_environment.shutil, "which", lambda name: str(launcher) if name == "py" else None)
    # the processes run here, where an option of Windows is refused
    on_windows.setattr(systems, "quiet", lambda: {})
    assert list(engine_environment.candidates()) == [sys.executable, sys.executable]
    on_windows.setattr(systems, "windows", lambda: False)
    assert list(engine_environment.candidates()) == [sys.executable]


def test_a_folder_too_deep_for_pytorch_is_left_for_a_shorter_one(on_windows, tmp_path, monkeypatch) -> None:
    deep = tmp_path / ("Blender Foundation" * 4)
    monkeypatch.setattr(engine_environment, "EXTENSION", "bl_ext.user_default.seeing_wind")
    monkeypatch.setattr(engine_environment.bpy.utils, "extension_path_user", lambda *_, **__: str(deep))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path / "Local"))
    folder = engine_environment.user_environment(create=True)
    assert folder is not None and folder.is_dir() and (tmp_path / "Local") in folder.parents
    on_windows.setattr(systems, "long_paths", lambda: True)
    assert engine_environment.user_environment(create=False) == deep
    on_windows.setattr(systems, "windows", lambda: False)
    assert engine_environment.user_environment(create=False) == deep


def test_a_folder_that_is_too_deep_whatever_we_do_is_told_before_the_download(on_windows, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(choices, "preferences", lambda: SimpleNamespace(python="", wheels=str(tmp_path)))
    monkeypatch.setattr(engine_install, "user_environment", lambda create: tmp_path / ("d" * 120))
    with pytest.raises(SeeingWindError, match="too long for this Windows") as caught:
        engine_install.install()
    assert "long paths" in caught.value.hint and not os.path.exists(tmp_path / ("d" * 120))
