"""Install Engine with real Pythons, environments and pip, on packages of a few bytes: offline wheels, a download that breaks, cancel."""

from __future__ import annotations

import functools
import hashlib
import http.server
import os
import re
import sys
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

import seeing_wind.ui as ui
from seeing_wind.engine.errors import MissingPackage, UsageError
from seeing_wind.ui.job import status, worker_command
from seeing_wind.ui.job import worker as job
from seeing_wind.ui.job.install import choices
from seeing_wind.ui.job.install import environment as engine_environment
from seeing_wind.ui.job.install import install as engine_install
from seeing_wind.ui.job.panel_pieces import draw_engine
from tests.ui.drawn import Drawn

DOCTOR = """
import json, one_package, torch
print(json.dumps({"type": "result", "outcome": "converged", "checks": [{"name": "packages", "ok": True, "detail": torch.BUILD}]}))
"""


def wheel(folder: Path, name: str, version: str, code: str, more: int = 0) -> Path:
    """A pure wheel with one module, and `more` empty files, which take pip a while."""
    info, tag = f"{name}-{version}.dist-info", "py3-none-any"
    path = folder / f"{name}-{version}-{tag}.whl"
    files = {
        f"{name}.py": code,
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n",
        f"{info}/WHEEL": f"Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: {tag}\n",
        **{f"{name}_files/{number}.txt": "" for number in range(more)},
    }
    record = "".join(f"{each},,\n" for each in (*files, f"{info}/RECORD"))
    with zipfile.ZipFile(path, "w") as archive:
        for each, text in {**files, f"{info}/RECORD": record}.items():
            archive.writestr(each, text)
    return path


@pytest.fixture
def place(tmp_path, monkeypatch) -> SimpleNamespace:
    """An installation of a tiny engine: its source, its wheels, and where its environment goes."""
    source, wheels = tmp_path / "source", tmp_path / "wheels ü"
    (source / "seeing_wind" / "engine").mkdir(parents=True)
    wheels.mkdir()
    for name in ("__init__.py", "engine/__init__.py"):
        (source / "seeing_wind" / name).write_text("")
    (source / "seeing_wind" / "engine" / "__main__.py").write_text(DOCTOR)
    locked = hashlib.sha256(wheel(wheels, "one_package", "1.0", "").read_bytes()).hexdigest()
    (source / "seeing_wind" / "engine" / "requirements.lock").write_text(f"one_package==1.0 --hash=sha256:{locked}\n")
    (source / "seeing_wind" / "engine" / "torch.lock").write_text("torch==2.5.0\n")
    wheel(wheels, "torch", "2.5.0", "BUILD = 'from PyPI'")
    for module in (engine_environment, engine_install, worker_command):
        monkeypatch.setattr(module, "ROOT", source)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    for name in [name for name in os.environ if name.startswith("PIP_") and name != "PIP_CONFIG_FILE"]:
        monkeypatch.delenv(name)
    environment = tmp_path / "user" / "engine"
    environment.mkdir(parents=True)
    return SimpleNamespace(environment=environment, wheels=wheels, base=quick_base(tmp_path))


def quick_base(folder: Path) -> str:
    """A Python whose `-m venv --clear FOLDER` copies this one's pip: ensurepip takes half a minute."""
    import pip

    home = Path(pip.__file__).parent
    copied = " ".join(f'"{each}"' for each in (home, *home.parent.glob("pip-*.dist-info")))
    packages = f'"$4"/lib/python{sys.version_info[0]}.{sys.version_info[1]}/site-packages/'
    script = folder / "base_python"
    script.write_text(f'#!/bin/sh\n"{sys.executable}" -m venv --clear --without-pip "$4" && cp -r {copied} {packages}\n')
    script.chmod(0o755)
    return str(script)


def outcome(messages: job.Messages) -> tuple[dict, list[dict]]:
    """The last message and all of them."""
    said: list[dict] = []
    return job.wait(messages, said.append), said


def test_from_a_folder_of_wheels_without_network(place) -> None:
    last, said = outcome(engine_install.run(place.base, place.environment, str(place.wheels)))
    assert last["outcome"] == "done", said[-4:]
    assert (place.environment / engine_environment.MARKER).is_file()
    fractions = [message["fraction"] for message in said if message["type"] == "progress"]
    assert fractions == sorted(fractions) and fractions[-1] >= 0.95
    # a second time nothing has to be made
    programs = engine_install.programs(place.base, place.environment, str(place.wheels))
    assert [program.title for program in programs] == ["Installing PyTorch", "Installing packages", "Trying the engine"]


class Index(http.server.SimpleHTTPRequestHandler):
    """A package index that sends half a file as long as `broken` names it."""

    broken = ""
    sent: list[str] = []

    def do_GET(self) -> None:
        name = self.path.rpartition("/")[2]
        if not name.endswith(".whl"):
            return super().do_GET()
        data = (Path(self.directory) / name).read_bytes()
        type(self).sent.append(name)
        self.send_response(200)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "max-age=3600")
        self.end_headers()
        self.wfile.write(data[: len(data) // 2] if type(self).broken in name and type(self).broken else data)

    def list_directory(self, path):
        return None

    def translate_path(self, path: str) -> str:
        """Every project's page is the same list of all files."""
        return str(Path(self.directory) / "index.html")

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def index(place, monkeypatch) -> Iterator[type[Index]]:
    links = "".join(f'<a href="/{each.name}">{each.name}</a>' for each in place.wheels.glob("*.whl"))
    (place.wheels / "index.html").write_text(f"<!DOCTYPE html><html><body>{links}</body></html>")
    Index.sent, Index.broken = [], ""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Index, directory=str(place.wheels)))
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    address = f"http://127.0.0.1:{server.server_address[1]}/simple"
    monkeypatch.setenv("PIP_INDEX_URL", address)
    monkeypatch.setenv("PIP_RESUME_RETRIES", "0")
    monkeypatch.setattr(engine_install, "CPU_INDEX", address)
    every = engine_install.programs
    monkeypatch.setattr(engine_install, "programs", lambda *given: [each for each in every(*given) if each.title != "Updating pip"])
    monkeypatch.setattr(engine_install, "RETRIES", ("--retries", "0", "--timeout", "5"))
    yield Index
    server.shutdown()


def test_a_broken_download_is_told_and_the_next_try_goes_on(place, index) -> None:
    index.broken = "one_package"
    last, said = outcome(engine_install.run(place.base, place.environment, ""))
    errors = [message for message in said if message["type"] == "error"]
    assert last["outcome"] == "failed" and "Downloading packages stopped" in errors[0]["message"] and "again" in errors[0]["hint"]
    assert not (place.environment / engine_environment.MARKER).is_file() and index.sent.count("torch-2.5.0-py3-none-any.whl") == 1
    index.broken = ""
    last, said = outcome(engine_install.run(place.base, place.environment, ""))
    assert last["outcome"] == "done", said[-4:]
    assert not any("Making the environment" in str(message.get("message")) for message in said)
    assert index.sent.count("torch-2.5.0-py3-none-any.whl") == 1, "what was there already is not fetched again"
    assert (place.environment / engine_environment.MARKER).is_file() and not (place.environment / engine_install.CACHE).exists()


def test_cancel_leaves_what_the_next_try_uses(place) -> None:
    wheel(place.wheels, "torch", "2.5.0", "BUILD = 'from PyPI'", more=40_000)  # or pip would be through before it is told
    messages = engine_install.run(place.base, place.environment, str(place.wheels))
    next(messages)
    said: list[dict] = []
    try:
        while True:
            asked = any("Installing PyTorch" in str(message.get("message")) for message in said)
            said += messages.send(asked)
    except StopIteration as end:
        assert end.value["outcome"] == "cancelled", said
    assert not (place.environment / engine_environment.MARKER).is_file()
    assert outcome(engine_install.run(place.base, place.environment, str(place.wheels)))[0]["outcome"] == "done"


@pytest.mark.parametrize(
    ("platform", "options"),
    [("linux", ["--index-url", engine_install.CPU_INDEX]), ("win32", ["--index-url", engine_install.CPU_INDEX]), ("darwin", [])],
)
def test_no_system_downloads_what_only_graphics_cards_need(platform, options) -> None:
    assert engine_install.CPU_INDEX.endswith("/cpu") and engine_install.torch_index(platform) == options


def test_a_package_that_is_not_the_locked_one_is_refused(place) -> None:
    wheel(place.wheels, "one_package", "1.0", "OTHER = True")
    last, said = outcome(engine_install.run(place.base, place.environment, str(place.wheels)))
    assert last["outcome"] == "failed" and not (place.environment / engine_environment.MARKER).is_file()


def test_the_lock_pins_every_requirement() -> None:
    engine = Path(ui.__file__).parents[1] / "engine"
    names = {re.split(r"[<>=]", line)[0] for line in (engine / "requirements.txt").read_text().split()}
    locked = re.findall(r"^([a-z0-9-]+)==", (engine / "requirements.lock").read_text() + (engine / "torch.lock").read_text(), re.MULTILINE)
    assert names <= set(locked) and not any(name.startswith("nvidia") for name in locked)


def test_wheels_need_no_online_access_and_a_wrong_folder_is_told(place, monkeypatch) -> None:
    chosen = SimpleNamespace(python="", wheels=str(place.wheels))
    monkeypatch.setattr(choices, "preferences", lambda: chosen)
    monkeypatch.setattr(engine_install, "user_environment", lambda create: place.environment)
    assert not bpy.app.online_access
    engine_install.install().close()
    chosen.wheels = "/no/such/folder"
    with pytest.raises(UsageError, match="no folder of wheels"):
        engine_install.install()
    chosen.wheels = ""
    with pytest.raises(engine_environment.NoOnlineAccess):
        engine_install.install()


def test_use_this_python(monkeypatch, tmp_path) -> None:
    chosen = SimpleNamespace(python=sys.executable, wheels="")
    monkeypatch.setattr(choices, "preferences", lambda: chosen)
    monkeypatch.setenv("SEEING_WIND_PYTHON", "/somewhere/else")
    assert engine_environment.engine_python() == sys.executable
    chosen.python = str(tmp_path / "none")
    engine_environment.refresh()
    assert status.engine.problem.mend == "open_preferences" and "preferences" in status.engine.problem.message


def test_what_kept_the_engine_away_is_said_once_and_forgotten_when_there_is_one(monkeypatch) -> None:
    monkeypatch.delenv("SEEING_WIND_PYTHON", raising=False)
    missing = MissingPackage("The engine is not installed yet.", "Install it once.")

    def gone() -> str:
        raise missing

    monkeypatch.setattr(engine_environment, "engine_python", gone)
    engine_environment.refresh()
    scene = bpy.context.scene
    now = status.of(scene.session_uid)
    status.begin(now, "engine", "Install Engine")
    status.fail(now, "engine", missing.message, missing.hint)
    status.end(now)
    layout = Drawn()
    draw_engine(layout, bpy.context)
    assert sum("not installed" in text for text in layout.labels) == 1
    monkeypatch.setattr(engine_environment, "engine_python", lambda: sys.executable)
    engine_environment.refresh()
    assert "engine" not in now.steps and status.engine.problem is None
