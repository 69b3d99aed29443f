"""A batch's job on another machine: its files laid out, its verbs run, its takes sent home. Runs in a worker process of Ray.

The asker's folders are copied below one temporary folder. Where a take names a file by its path, the path is put back to the asker's
before the take goes home, so that it reads as if it had been made there.
"""

from __future__ import annotations

import hashlib
import json
import socket
import time
from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__, systems
from ...errors import SeeingWindError, UsageError
from ...take import Take
from .. import lock
from .process import EngineDied, Message, messages_of

EVERY = 0.5
"""Seconds between two reports of one job."""
TEXTS = {".toml", ".json"}


@dataclass(frozen=True)
class Order:
    """One job as a node gets it."""

    calls: list[list[str]]
    takes: list[str]
    """Folders to send home, by the asker's paths."""
    paths: list[str]
    """The words of `calls` that are paths."""
    threads: int
    shared: bool
    """Whether the asker's paths are those of the node."""


def edition() -> str:
    """The version of this engine and a digest of its code: two nodes of one edition give the same results."""
    home = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for path in sorted([*home.rglob("*.py"), *home.glob("*.toml")], key=lambda path: path.relative_to(home).as_posix()):
        digest.update(path.relative_to(home).as_posix().encode() + path.read_bytes().replace(b"\r\n", b"\n"))
    return f"{__version__} ({digest.hexdigest()[:8]})"


def carry_out(order: Order, files: Mapping[str, bytes]) -> Generator[Message, None, None]:
    """Do a job and yield its messages: `started`, then the engine's, then every `file` of its takes, at last `delivered`; or, where it
    ends early, `failed` or `died` with a message.

    Args:
        order: what to do.
        files: content by the asker's path; none where the folder is shared.
    """
    yield {"type": "started", "host": socket.gethostname()}
    with systems.scratch() as root:
        yield from _carry_out(order, files, root)


def _carry_out(order: Order, files: Mapping[str, bytes], root: Path) -> Generator[Message, None, None]:
    away = {} if order.shared else {path: str(_below(root, path)) for path in {*order.paths, *order.takes, *files}}
    home = dict(sorted(((there, here) for here, there in away.items()), key=lambda pair: -len(pair[0])))
    try:
        for path, content in files.items():
            place = Path(away[path])
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
        if order.shared:
            _see(order)
        for call in order.calls:
            words = [away.get(word, word) if word in order.paths else word for word in call]
            yield from _sparse(messages_of(words, order.threads))
        if not order.shared:
            for take in order.takes:
                yield from _files(take, Path(away[take]), home)
        yield {"type": "delivered"}
    except EngineDied as error:
        yield {"type": "died", "message": _at_home(str(error), home)}
    except SeeingWindError as error:
        yield {"type": "failed", "message": _at_home(str(error), home)}


def _below(root: Path, path: str) -> Path:
    """Where a path of the asker's lies on this node."""
    whole = Path(path)
    return root.joinpath(whole.drive.replace(":", "").strip("\\/"), *whole.parts[1:])


def _see(order: Order) -> None:
    """Raises UsageError where the node does not have the asker's folders."""
    for path in order.paths:
        if not Path(path).parent.is_dir():
            raise UsageError(
                f"{socket.gethostname()} does not see {Path(path).parent}.",
                "Put the batch on a folder that every node has under this path, or leave --shared out.",
            )


def _sparse(batches: Iterable[list[Message]]) -> Generator[Message, None, None]:
    """Progress not oftener than `EVERY`, and warnings."""
    last = 0.0
    for batch in batches:
        for message in batch:
            if message.get("type") == "warning":
                yield message
            elif message.get("type") == "progress" and time.monotonic() - last >= EVERY:
                last = time.monotonic()
                yield message


def _at_home(text: str, home: Mapping[str, str]) -> str:
    """A text with the asker's paths in place of this node's, plain or as JSON and TOML write them."""
    for there, here in home.items():
        text = text.replace(there, here).replace(json.dumps(there)[1:-1], json.dumps(here)[1:-1])
    return text


def _files(take: str, folder: Path, home: Mapping[str, str]) -> Generator[Message, None, None]:
    """All files of a take, its own paths the asker's again."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name != lock.NAME:
            if path.suffix in TEXTS:
                path.write_text(_at_home(path.read_text(encoding="utf-8"), home), encoding="utf-8")
            elif path.suffix == ".npz":
                _rename_in(folder, path.relative_to(folder).as_posix(), home)
            yield {"type": "file", "take": take, "name": path.relative_to(folder).as_posix(), "content": path.read_bytes()}


def _rename_in(folder: Path, name: str, home: Mapping[str, str]) -> None:
    """The same in the texts of an archive; one without is left as it is."""
    take = Take(folder)
    arrays: dict[str, Any] = take.read_arrays(name)
    changed = False
    for key, array in arrays.items():
        if array.dtype.kind == "U" and array.ndim == 0:
            text = _at_home(str(array), home)
            changed = changed or text != str(array)
            arrays[key] = np.array(text)
    if changed:
        take.write_arrays(name, arrays)
