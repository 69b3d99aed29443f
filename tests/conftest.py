"""Fixtures shared by all tests, and what lets several processes run them side by side."""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
LONG = ("tests/engine/recovery/", "tests/engine/mpm/", "tests/faults/", "tests/engine/test_command_line.py", "tests/test_sample_scene.py")
"""Where the tests are that take longest, in this order."""

# Where a network is installed that helps to outline objects, it would take part in every job; its own tests name one.
os.environ["SEEING_WIND_OUTLINE_MODEL"] = "none"

if "PYTEST_XDIST_WORKER" in os.environ:
    # One of several processes (pytest-xdist): threads that outnumber the cores would wait for each other on the spot, and everything would
    # take four times as long. What needs several, the Makefile runs by itself.
    for variable in ("SEEING_WIND_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(variable, "1")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes long comes first, so that no process is left alone with one at the end."""

    def rank(item: pytest.Item) -> int:
        return next((rank for rank, place in enumerate(LONG) if item.nodeid.startswith(place)), len(LONG))

    items.sort(key=rank)


def pytest_sessionfinish() -> None:
    """Keep the kernels that were compiled here: the compiler does so when it ends, which a process of pytest-xdist does not wait for."""
    compiler = sys.modules.get("seeing_wind.engine.mpm.compiler")
    if compiler is not None:
        compiler.ti.reset()


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of development data beside the repository; the test is skipped where there is none."""
    folder = ROOT.parent / "shared"
    if not (folder / "truth").is_dir():
        pytest.skip("no development data beside the repository")
    return folder


class Server:
    """A vision-language model on the loopback address. Gives prepared answers in order, the last one for ever; one that is a function gets
    the question's text. `asked` holds the bodies and `headers` the headers of all requests."""

    def __init__(self) -> None:
        self.answers: list[Any] = []
        self.asked: list[dict] = []
        self.headers: list[dict] = []
        self.status = 200
        self.location = ""
        self.delay = threading.Event()
        self.slow = False
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                outer.asked.append(json.loads(body))
                outer.headers.append(dict(self.headers))
                if outer.slow:
                    outer.delay.wait(20.0)
                answer = outer.answers.pop(0) if len(outer.answers) > 1 else outer.answers[0]
                answer = answer(outer.question(-1)) if callable(answer) else answer
                data = answer
                if not isinstance(answer, bytes):
                    text = answer if isinstance(answer, str) else json.dumps(answer)
                    data = json.dumps({"choices": [{"message": {"content": text}}]}).encode()
                self.send_response(outer.status)
                if outer.location:
                    self.send_header("Location", outer.location)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, *_: Any) -> None:
                pass

        self._http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._http.server_address[1]}/v1"
        self._thread = threading.Thread(target=self._http.serve_forever, args=(0.05,), daemon=True)
        self._thread.start()

    def question(self, index: int) -> str:
        return self.asked[index]["messages"][0]["content"][0]["text"]

    def images(self, index: int) -> list[str]:
        return [part["image_url"]["url"] for part in self.asked[index]["messages"][0]["content"][1:]]

    def close(self) -> None:
        self.delay.set()
        self._http.shutdown()
        self._http.server_close()


@pytest.fixture
def server() -> Iterator[Server]:
    """A model that can be asked; the test prepares its answers."""
    running = Server()
    yield running
    running.close()
