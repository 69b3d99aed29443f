"""What the tests of the operators share: the add-on switched on, a stand-in for the engine, a small clip."""

from __future__ import annotations

import atexit
import contextlib
import functools
import os
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).resolve().parent


def fake_python(folder: Path, warm: bool = False) -> Path:
    """An executable that stands for the engine's Python. `warm`: its jobs are forks of one process, as long as this one lives."""
    path, program = folder / "fake_python", f'"{HERE / "fake_engine.py"}"'
    if warm:
        program = f'-I -S "{HERE / "fake_client.py"}" "{warm_engine()}" {program}'
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" {program} "$@"\n')
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@functools.cache
def warm_engine() -> Path:
    """The socket of a stand-in that is warm. It ends with this process."""
    home = tempfile.TemporaryDirectory(prefix="sw")  # a socket's path is short
    atexit.register(home.cleanup)
    address = Path(home.name) / "engine"
    server = [sys.executable, HERE / "fake_server.py", address]
    process = subprocess.Popen(server, stdin=subprocess.PIPE, env={**os.environ, "PYTHONPATH": str(HERE.parents[1])})
    atexit.register(process.communicate)
    while not address.exists():
        assert process.poll() is None, "the warm stand-in ended"
        time.sleep(0.01)
    return address


def make_clip(path: Path, frames: int = 13, size: tuple[int, int] = (96, 64)) -> Path:
    """A short video of a white square that moves."""
    import cv2
    import numpy as np

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 24.0, size)
    for frame in range(frames):
        image = np.full((size[1], size[0], 3), 60, np.uint8)
        image[20:44, 20 + 2 * frame : 44 + 2 * frame] = 230
        writer.write(image)
    writer.release()
    assert os.path.getsize(path) > 0
    return path


@contextlib.contextmanager
def switched_on(patch, folder: Path, seconds: float = 0.05) -> Iterator[None]:
    """The add-on, with the stand-in of `folder` in the engine's place; its jobs take `seconds`."""
    import seeing_wind.ui as ui

    patch.setenv("SEEING_WIND_PYTHON", str(fake_python(folder, warm=True)))
    patch.setenv("SEEING_WIND_FAKE_SECONDS", str(seconds))
    ui.register()
    ui.look_round()
    try:
        yield
    finally:
        ui.unregister()
