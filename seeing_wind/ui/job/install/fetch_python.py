"""Fetches a standalone Python: `python fetch_python.py URL SHA256 FOLDER`, a separate program that needs only the standard library.

It uses the worker's protocol on stdout (see `job.worker`). FOLDER appears once everything is unpacked; an interrupted attempt leaves a
folder beside it that the next attempt removes.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import ssl
import sys
import tarfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import IO

TRIES = 3
WAIT_SECONDS = 2.0
"""Pause between two attempts to download."""
STALL_SECONDS = 60.0
CHUNK = 1 << 18
MOST = 300_000_000
"""Largest size of an archive [bytes]; a server that sends more has sent something else."""
OR_ELSE = "or install Python 3.11 to 3.13 from your system or python.org."


class Refused(Exception):
    """The fetched file is not the expected one; the text says why."""


def say(**message: object) -> None:
    """Print one message of the protocol."""
    print(json.dumps(message), flush=True)


def main(argv: list[str]) -> int:
    """Download, check, unpack; returns the exit code."""
    url, sha256, folder = argv[0], argv[1], Path(argv[2])
    aside = folder.with_name(f"{folder.name}.part")
    archive = folder.with_name(f"{folder.name}.tar.gz.part")
    try:
        shutil.rmtree(aside, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        fetch(url, sha256, archive)
        say(type="progress", fraction=0.8, message="Unpacking Python")
        unpack(archive, aside)
        shutil.rmtree(folder, ignore_errors=True)
        settle(aside, folder)
    except (urllib.error.URLError, TimeoutError, ConnectionError) as error:
        return failed(f"{url} cannot be fetched: {getattr(error, 'reason', None) or error}.", f"Check the network and try again, {OR_ELSE}")
    except (Refused, tarfile.TarError) as error:
        return failed(f"The Python from {url} was refused: {error}.", f"Try again, {OR_ELSE}")
    except OSError as error:
        return failed(f"Python cannot be unpacked to {folder}: {error.strerror or error}.", "See that the disk has 200 MB free.")
    finally:
        archive.unlink(missing_ok=True)
        shutil.rmtree(aside, ignore_errors=True)
    say(type="result", outcome="converged", python=str(folder))
    return 0


def failed(message: str, hint: str) -> int:
    """Print what happened and what to do; returns the exit code."""
    say(type="error", message=message, hint=hint)
    return 1


def fetch(url: str, sha256: str, archive: Path) -> None:
    """Download to `archive`, with further attempts if the connection breaks.

    Raises:
        Refused: when the hash is not the expected one. OSError: when the file cannot be downloaded or written.
    """
    for left in reversed(range(TRIES)):
        digest = hashlib.sha256()
        try:
            with open(archive, "wb") as file:
                for piece in download(url):
                    digest.update(piece)
                    file.write(piece)
            break
        except (urllib.error.URLError, TimeoutError, ConnectionError):
            if not left:
                raise
            time.sleep(WAIT_SECONDS)
    if digest.hexdigest() != sha256:
        raise Refused(f"its SHA-256 is {digest.hexdigest()}, not {sha256}")


def download(url: str) -> Iterator[bytes]:
    """The content of a file in pieces; prints progress.

    Raises:
        ConnectionError: when it ends early. Refused: when it is too large. URLError: when it is not available.
    """
    with opened(url) as answer:
        whole, here, told = int(answer.headers.get("Content-Length") or 0), 0, -1
        while piece := answer.read(CHUNK):
            here += len(piece)
            if here > MOST:
                raise Refused(f"it is larger than {MOST // 1_000_000} MB")
            if here // 1_000_000 > told:
                told = here // 1_000_000
                of = f" of {whole // 1_000_000}" if whole else ""
                say(type="progress", fraction=0.8 * (here / whole) if whole else 0.0, message=f"Downloading Python: {told}{of} MB")
            yield piece
        if here < whole:
            raise ConnectionError(f"{here} of {whole} bytes came")


def opened(url: str) -> IO[bytes]:
    """The server's response. Its certificate is checked against the system's, else against those of certifi, which comes with Blender."""
    try:
        return urllib.request.urlopen(url, timeout=STALL_SECONDS)
    except urllib.error.URLError as error:
        if not isinstance(error.reason, ssl.SSLCertVerificationError):
            raise
        try:
            import certifi
        except ImportError:
            raise error from None
    return urllib.request.urlopen(url, timeout=STALL_SECONDS, context=ssl.create_default_context(cafile=certifi.where()))


def unpack(archive: Path, folder: Path) -> None:
    """Unpack the contents of the archive's folder `python` into `folder`.

    Raises:
        Refused: when a member lies outside that folder. TarError, OSError: when something cannot be read or written.
    """
    with tarfile.open(archive, "r:gz") as content:
        members = []
        for member in content:
            top, _, inside = member.name.partition("/")
            if top != "python":
                raise Refused(f"it holds {member.name}")
            if not inside:
                continue
            if member.islnk():  # a hard link names its target by the full path in the archive
                member.linkname = member.linkname.removeprefix("python/")
            member.name = inside
            members.append(member)
        folder.mkdir()
        # "data": no absolute path, no way out of the folder, no device, no link that leads out
        content.extractall(folder, members, filter="data")
    if not members:
        raise Refused("it is empty")


def settle(aside: Path, folder: Path) -> None:
    """Rename `aside` to `folder`, with retries: on Windows, a virus scanner may hold new files open for a while.

    Raises:
        OSError: when renaming fails.
    """
    for pause in (0.2, 0.5, 1.0, 2.0):
        try:
            return os.replace(aside, folder)
        except PermissionError:
            time.sleep(pause)
    os.replace(aside, folder)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
