"""A batch's job on another machine: writes its files, runs its verbs and sends its takes back. Runs in a worker process of Ray.

The files of the machine that asked for the job are copied below one temporary folder, under the same paths. Before a take is sent back, the
paths in it are changed to those of the asking machine, so that it looks as if it had been made there.
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
"""Least seconds between two progress messages of one job."""
TEXTS = {".toml", ".json"}


@dataclass(frozen=True)
class Order:
    """One job, as it is sent to a node."""

    calls: list[list[str]]
    takes: list[str]
    """Folders to send back, as paths on the asking machine."""
    paths: list[str]
    """The words of `calls` that are paths."""
    threads: int
    shared: bool
    """Whether the node sees the same files under the same paths as the asking machine."""


def edition() -> str:
    """The version of this engine and a digest of its code: nodes with the same edition give the same results."""
    home = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for path in sorted([*home.rglob("*.py"), *home.glob("*.toml")], key=lambda path: path.relative_to(home).as_posix()):
        digest.update(path.relative_to(home).as_posix().encode() + path.read_bytes().replace(b"\r\n", b"\n"))
    return f"{__version__} ({digest.hexdigest()[:8]})"


def carry_out(order: Order, files: Mapping[str, bytes]) -> Generator[Message, None, None]:
    """Run a job and yield messages: `started`, the engine's messages, a `file` for every file of the takes, and at last `delivered`.

    A job that ends early yields `failed` or `died` with a message in place of what would follow.

    Args:
        order: the job.
        files: the files' contents, by their paths on the asking machine; empty if the folder is shared.
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
    """The place on this node, below the folder `root`, for a path of the asking machine."""
    whole = Path(path)
    return root.joinpath(whole.drive.replace(":", "").strip("\\/"), *whole.parts[1:])


def _see(order: Order) -> None:
    """Raises UsageError if the node does not see the shared folders."""
    for path in order.paths:
        if not Path(path).parent.is_dir():
            raise UsageError(
                f"{socket.gethostname()} does not see {Path(path).parent}.",
                "Put the batch on a folder that every node has under this path, or leave --shared out.",
            )


def _sparse(batches: Iterable[list[Message]]) -> Generator[Message, None, None]:
    """Pass on all warnings, and progress messages at least `EVERY` seconds apart."""
    last = 0.0
    for batch in batches:
        for message in batch:
            if message.get("type") == "warning":
                yield message
            elif message.get("type") == "progress" and time.monotonic() - last >= EVERY:
                last = time.monotonic()
                yield message


def _at_home(text: str, home: Mapping[str, str]) -> str:
    """A text in which this node's paths, plain or escaped as in JSON and TOML, are replaced by the asking machine's."""
    for there, here in home.items():
        text = text.replace(there, here).replace(json.dumps(there)[1:-1], json.dumps(here)[1:-1])
    return text


def _files(take: str, folder: Path, home: Mapping[str, str]) -> Generator[Message, None, None]:
    """A `file` message for every file of a take except its lock, with paths changed to the asking machine's."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name != lock.NAME:
            if path.suffix in TEXTS:
                path.write_text(_at_home(path.read_text(encoding="utf-8"), home), encoding="utf-8")
            elif path.suffix == ".npz":
                _rename_in(folder, path.relative_to(folder).as_posix(), home)
            yield {"type": "file", "take": take, "name": path.relative_to(folder).as_posix(), "content": path.read_bytes()}


def _rename_in(folder: Path, name: str, home: Mapping[str, str]) -> None:
    """Replace the paths in the texts of a take's NPZ, as `_at_home` does; the file is written only if that changes anything."""
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
