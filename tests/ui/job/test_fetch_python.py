"""A Python is fetched, checked and unpacked by a program of its own; here from a server of this machine, and only some bytes large."""

from __future__ import annotations

import functools
import hashlib
import http.server
import io
import os
import sys
import tarfile
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from seeing_wind.engine.errors import SeeingWindError
from seeing_wind.ui.job import worker as job
from seeing_wind.ui.job.install import choices, fetch_python, standalone
from seeing_wind.ui.job.install import environment as engine_environment
from seeing_wind.ui.job.install import install as engine_install
from seeing_wind.ui.job.panel_pieces import MENDS

PYTHON = f'#!/bin/sh\nexec "{sys.executable}" "$@"\n'


def entry(name: str, text: str = "", **more: object) -> tuple[tarfile.TarInfo, bytes]:
    """A member of an archive."""
    info = tarfile.TarInfo(name)
    info.size, info.mode = len(text.encode()), 0o755
    for key, value in more.items():
        setattr(info, key, value)
    return info, text.encode()


def archive(path: Path, *entries: tuple[tarfile.TarInfo, bytes]) -> str:
    """Write an archive; returns its hash."""
    with tarfile.open(path, "w:gz") as content:
        for info, data in entries:
            content.addfile(info, io.BytesIO(data))
    return hashlib.sha256(path.read_bytes()).hexdigest()


GOOD = (
    entry("python/bin/python3.13", PYTHON),
    entry("python/bin/python3", type=tarfile.SYMTYPE, linkname="python3.13"),
    entry("python/bin/python", type=tarfile.LNKTYPE, linkname="python/bin/python3.13"),
)


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Breaks off in the middle of a file while `broken`."""

    broken = 0

    def do_GET(self) -> None:
        if type(self).broken:
            type(self).broken -= 1
            self.send_response(200)
            self.send_header("Content-Length", "1000000")
            self.end_headers()
            self.wfile.write(b"half")
            return None
        return super().do_GET()

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def site(tmp_path: Path) -> Iterator[SimpleNamespace]:
    """A server with a folder, and where Python shall go."""
    (tmp_path / "site").mkdir()
    Quiet.broken = 0
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(tmp_path / "site")))
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    file = tmp_path / "site" / "python.tar.gz"
    url = f"http://127.0.0.1:{server.server_address[1]}/{file.name}"
    yield SimpleNamespace(file=file, url=url, folder=tmp_path / "für Wind" / "standalone")
    server.shutdown()


def fetched(site: SimpleNamespace, sha256: str) -> tuple[dict, list[dict]]:
    """The program run as a job: its last message and all of them."""
    command = [sys.executable, "-I", fetch_python.__file__, site.url, sha256, str(site.folder)]
    said: list[dict] = []
    return job.wait(job.run(command, cwd=str(site.file.parent), env=dict(os.environ), grace=0.0), said.append), said


def test_it_is_unpacked_whole_and_leaves_nothing_beside(site) -> None:
    last, said = fetched(site, archive(site.file, *GOOD))
    assert last["outcome"] == "done", said
    for name in ("python3.13", "python3", "python"):
        assert (site.folder / "bin" / name).read_text() == PYTHON
    assert [path.name for path in site.folder.parent.iterdir()] == ["standalone"]
    fractions = [message["fraction"] for message in said if message["type"] == "progress"]
    assert fractions == sorted(fractions) and fractions


def test_another_file_than_the_known_one_is_refused(site) -> None:
    archive(site.file, *GOOD)
    last, said = fetched(site, "0" * 64)
    (error,) = [message for message in said if message["type"] == "error"]
    assert last["outcome"] == "failed" and "SHA-256" in error["message"] and error["hint"]
    assert not list(site.folder.parent.iterdir())


@pytest.mark.parametrize(
    "bad",
    [
        entry("../outside", "x"),
        entry("/outside", "x"),
        entry("other/file", "x"),
        entry("python/../../outside", "x"),
        entry("python/link", type=tarfile.SYMTYPE, linkname="../../../outside"),
        entry("python/link", type=tarfile.SYMTYPE, linkname="/etc/passwd"),
        entry("python/link", type=tarfile.LNKTYPE, linkname="python/../../outside"),
        entry("python/device", type=tarfile.CHRTYPE),
    ],
    ids=lambda bad: f"{bad[0].name} {bad[0].linkname}".strip(),
)
def test_nothing_is_unpacked_outside(site, bad) -> None:
    (site.file.parent.parent / "outside").write_text("untouched")
    last, said = fetched(site, archive(site.file, *GOOD, bad))
    assert last["outcome"] == "failed" and any("refused" in message["message"] for message in said if message["type"] == "error"), said
    assert not site.folder.exists() and not list(site.folder.parent.iterdir())
    assert (site.file.parent.parent / "outside").read_text() == "untouched"


def test_a_connection_that_breaks_is_tried_again_and_at_last_told(site, monkeypatch, capsys) -> None:
    monkeypatch.setattr(fetch_python, "WAIT_SECONDS", 0.0)
    sha256 = archive(site.file, *GOOD)
    Quiet.broken = 2
    assert fetch_python.main([site.url, sha256, str(site.folder)]) == 0 and (site.folder / "bin" / "python3").exists()
    Quiet.broken = 99
    assert fetch_python.main([site.url, sha256, str(site.folder)]) == 1
    assert "cannot be fetched" in capsys.readouterr().out and (site.folder / "bin" / "python3").exists(), "the former one stays"


def test_every_build_is_pinned_by_a_whole_hash(monkeypatch) -> None:
    for (system, machine), name in standalone.SYSTEMS.items():
        monkeypatch.setattr(standalone.platform, "system", lambda system=system: system)
        monkeypatch.setattr(standalone.platform, "machine", lambda machine=machine: machine)
        url, sha256 = standalone.build()
        assert url.startswith("https://") and name in url and len(bytes.fromhex(sha256)) == 32
    monkeypatch.setattr(standalone.platform, "machine", lambda: "riscv64")
    assert standalone.build() is None


@pytest.fixture
def bare(monkeypatch, tmp_path) -> SimpleNamespace:
    """An installed extension in a Blender whose Python is too new, on a system without another."""
    home = tmp_path / "user" / "python" / "standalone"
    monkeypatch.setattr(standalone, "place", lambda create: (home.parent.mkdir(parents=True, exist_ok=True) if create else None) or home)
    monkeypatch.setattr(engine_install, "user_environment", lambda create: tmp_path / "user" / "engine")
    monkeypatch.setattr(choices, "preferences", lambda: SimpleNamespace(python="", wheels=str(tmp_path)))
    monkeypatch.setattr(engine_environment.shutil, "which", lambda name: None)
    monkeypatch.setattr(engine_environment, "version_of", lambda python: (3, 14) if python == sys.executable else (3, 13))
    return SimpleNamespace(home=home)


def test_where_no_python_fits_one_is_offered_with_its_size(bare, monkeypatch) -> None:
    with pytest.raises(engine_environment.FetchablePython, match="3.14") as caught:
        engine_install.install()
    assert "MB" in caught.value.hint and MENDS[caught.value.mend][0] == "seeing_wind.fetch_python"
    with pytest.raises(engine_environment.NoOnlineAccess):
        engine_install.install(fetch_python=True)
    monkeypatch.setattr(standalone, "build", lambda: None)
    with pytest.raises(engine_environment.NoPython) as caught:
        engine_install.install(fetch_python=True)
    assert not caught.value.mend and "python.org" in caught.value.hint


def test_a_fetched_python_is_what_the_installation_goes_on_with(bare, site, monkeypatch) -> None:
    monkeypatch.setattr(engine_install.bpy, "app", SimpleNamespace(online_access=True, version=bpy.app.version))
    sha256, went_on = archive(site.file, *GOOD), []

    def run(base: str, *_: object) -> job.Messages:
        went_on.append(base)
        yield [{"type": "exit", "outcome": "done"}]
        return {"type": "exit", "outcome": "done"}

    monkeypatch.setattr(engine_install, "run", run)
    monkeypatch.setattr(standalone, "build", lambda: (site.url, "0" * 64))
    said: list[dict] = []
    assert job.wait(engine_install.install(fetch_python=True), said.append)["outcome"] == "failed" and not went_on
    monkeypatch.setattr(standalone, "build", lambda: (site.url, sha256))
    assert job.wait(engine_install.install(fetch_python=True), said.append)["outcome"] == "done"
    assert went_on == [str(bare.home / "bin" / "python3")]
    engine_install.install().close()  # the next time it is found without being fetched
    assert engine_environment.base_python() == went_on[0]


def test_from_source_nothing_is_offered(monkeypatch) -> None:
    monkeypatch.setattr(engine_environment.shutil, "which", lambda name: None)
    monkeypatch.setattr(engine_environment, "version_of", lambda python: None)
    with pytest.raises(SeeingWindError, match="No Python") as caught:
        engine_environment.base_python()
    assert not caught.value.mend
