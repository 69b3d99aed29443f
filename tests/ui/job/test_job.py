"""The generator of messages over a worker process: every way in which a worker can end."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from seeing_wind.engine.errors import DONE_WITH_WARNINGS
from seeing_wind.ui.job import worker as job

WORKER = Path(__file__).resolve().parents[1] / "fake_worker.py"
BASE = {key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "SEEING_WIND"))}


PATIENT = 60.0
"""Seconds of grace for a worker that does listen, also on a busy machine."""


def start(behaviour: str, grace: float = 0.4, **env: str) -> job.Messages:
    return job.run([sys.executable, str(WORKER), behaviour], cwd=str(WORKER.parent), env={**BASE, **env}, grace=grace)


def collect(messages: job.Messages) -> list[job.Message]:
    seen: list[job.Message] = []
    job.wait(messages, seen.append, pause=0.01)
    return seen


def kinds(messages: list[job.Message], kind: str) -> list[job.Message]:
    return [message for message in messages if message["type"] == kind]


def until_progress(messages: job.Messages) -> None:
    """Read until the worker is known to run."""
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        if any(message["type"] == "progress" for message in next(messages)):
            return
        time.sleep(0.01)
    pytest.fail("the worker never reported")


def test_messages_arrive_in_order_and_end_with_the_exit() -> None:
    seen = collect(start("done"))
    fractions = [message["fraction"] for message in kinds(seen, "progress") if message["stage"] == "recover"]
    assert fractions == sorted(fractions) and fractions[0] == 0.0 and fractions[-1] == 1.0
    assert kinds(seen, "warning") and kinds(seen, "result")[0]["outcome"] == "converged"
    assert seen[-1] == {"type": "exit", "code": 0, "outcome": "done", "log": "log line of the worker"}


def test_a_job_that_lacks_a_product_is_done() -> None:
    last = collect(start("warned"))[-1]
    assert last["outcome"] == "done" and last["code"] == DONE_WITH_WARNINGS


def test_an_empty_list_is_yielded_while_the_worker_is_silent() -> None:
    messages = start("stubborn")
    until_progress(messages)
    assert [next(messages) for _ in range(3)] == [[], [], []]
    messages.close()


def test_the_worker_s_own_error_is_passed_on_once() -> None:
    seen = collect(start("error"))
    assert [error["message"] for error in kinds(seen, "error")] == ["The box lies outside the frame of 480 x 270 pixels."]
    assert seen[-1]["outcome"] == "failed" and seen[-1]["code"] == 1


@pytest.mark.parametrize(("behaviour", "says"), [("crash", "RuntimeError: the grid is empty"), ("mute", "code 1"), ("die", "SIGKILL")])
def test_a_worker_that_dies_without_a_word_becomes_an_error(behaviour: str, says: str) -> None:
    seen = collect(start(behaviour))
    (error,) = kinds(seen, "error")
    assert says in error["message"] and error["hint"]
    assert seen[-1]["outcome"] == "failed"


def test_a_program_that_does_not_exist_is_an_error_with_the_button_that_mends_it() -> None:
    seen = collect(job.run(["/no/such/python"], cwd=str(WORKER.parent), env=BASE))
    assert kinds(seen, "error")[0]["mend"] == "install_engine" and seen[-1]["outcome"] == "failed"


def test_cancel_stops_at_a_safe_point() -> None:
    messages = start("hang", PATIENT)
    until_progress(messages)
    seen = list(messages.send(True))
    seen += collect(messages)
    assert kinds(seen, "result")[0]["outcome"] == "cancelled"
    assert seen[-1]["outcome"] == "cancelled" and seen[-1]["code"] == 130
    assert not kinds(seen, "error")


def test_cancel_ends_a_worker_that_does_not_listen() -> None:
    messages = start("stubborn")
    until_progress(messages)
    messages.send(True)
    seen = collect(messages)
    assert seen[-1]["outcome"] == "cancelled" and seen[-1]["code"] == -signal.SIGKILL


def test_closing_the_generator_kills_the_worker() -> None:
    messages = start("stubborn")
    until_progress(messages)
    process = messages.gi_frame.f_locals["process"]
    messages.close()
    assert process.poll() == -signal.SIGKILL


def test_lines_that_are_no_messages_are_logged() -> None:
    seen = collect(start("chatty"))
    assert [message["message"] for message in kinds(seen, "log")] == ["Collecting numpy", "[1, 2]", '{"kind": "no type"}']
    assert seen[-1]["outcome"] == "done"


def test_a_grandchild_that_holds_the_pipes_does_not_keep_the_job_running() -> None:
    seen = collect(start("offspring"))
    assert seen[-1]["outcome"] == "done"
    # it lives, and with it the pipes that it holds; this raises if it had been waited for
    os.kill(kinds(seen, "result")[0]["child"], signal.SIGKILL)


def test_ctrl_c_in_the_blocking_driver_cancels_and_returns() -> None:
    before = signal.getsignal(signal.SIGINT)
    timer = threading.Timer(0.8, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    last = job.wait(start("hang"), lambda message: None)
    timer.join()
    assert last["outcome"] == "cancelled"
    assert signal.getsignal(signal.SIGINT) is before
