"""Intermediate results of a long computation, kept on disk: after a crash it is run again, and reads them instead of computing them again.

Nothing is resumed in the middle of the code. The computation starts from its beginning and, being deterministic, takes the same course as
before. Its long parts (`once`) have places, such as `block 1/solve 3/trial 0`, and the result of a part is read at its place if an earlier
run got that far. When a part is finished, the entries of the parts inside it are removed. A long loop (`loop`) saves its state now and
then. So the result is that of a run without interruption, to the last bit, and no part needs to know of any other.

The files are `checkpoint.NUMBER.safetensors` in the take, each written completely or not at all. Each entry has a digest of the inputs from
which it follows and a checksum; an entry of other inputs, or a damaged one, is ignored.
"""

from __future__ import annotations

import contextlib
import time
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from ..errors import ClipError, ObjectError, SimulationError, TakeError, UsageError
from ..progress import Journal, Loop, Progress
from ..record_arrays import from_arrays, to_arrays
from ..take import Take, stamp_of

R = TypeVar("R")
Arrays = dict[str, np.ndarray]

SOONEST, LATEST = 2.0, 12.0
"""Least and greatest duration of work after which it is written [s]; short computations therefore write nothing."""
COST = 20.0
"""Between these two, work is written once it has taken this many times as long as writing."""
PATTERN = "checkpoint.*.safetensors"
TRANSPOSED = "transposed"
DONE = "done"
"""Key of a loop's progress in its state."""
DAMAGED = (OSError, SafetensorError, ValueError, TypeError, AttributeError, KeyError)
"""The exceptions of safetensors for a file that is empty, truncated, garbled or of another kind."""


@dataclass(frozen=True)
class _Single:
    values: np.ndarray


@dataclass
class _Entry:
    """The result at one place."""

    digest: str
    file: Path | None
    """None while the entry waits to be written."""
    arrays: Arrays
    """The result while it waits to be written, else empty: numbers, and JSON as text."""


class TakeJournal(Journal):
    """A journal in a take, for the computation with one stamp; entries of other stamps are removed.

    It is a context manager: on a cancel or a fault, entries that wait are written; on success, or an error that would occur again, all
    entries are removed.

    Args:
        take: take whose folder holds the journal. No other process may keep a journal there at the same time (`command.lock`).
        stamp: hash of everything on which the computation depends.
        progress: gets one warning if the journal cannot be written; the computation then continues without it.
    """

    def __init__(self, take: Take, stamp: str, progress: Progress) -> None:
        self._take, self._stamp, self._progress = take, stamp, progress
        self._entries: dict[str, _Entry] = {}
        self._live: Counter[Path] = Counter()
        """Files, with the number of entries that each still holds."""
        self._open: list[str] = []
        self._counts: Counter[str] = Counter()
        self._number = 0
        self._written, self._took, self._warned = time.monotonic(), 0.0, False
        for path in sorted(take.path.glob(PATTERN)):
            self._look_into(path)
        for place in [one for one in self._entries if any(_above(other, one) for other in self._entries)]:
            self._forget(place)  # a crash came between writing a part and removing the parts inside it
        self._sweep()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if kind is None or issubclass(kind, (UsageError, ClipError, ObjectError, SimulationError)):
            self.clear()
        else:
            self.write()

    def once(self, name: str, kind: type[R], work: Callable[[], R], *inputs: Any) -> R:
        """See `Journal.once`."""
        place, digest = self._place(name), stamp_of(*inputs)
        with contextlib.suppress(TakeError):
            kept = self.read(place, digest)
            if kept is not None:
                return from_arrays(kind, kept)
        self._open.append(place)
        try:
            record = work()
        finally:
            self._open.pop()
        arrays = {key: _plain(value) for key, value in to_arrays(record).items()}
        for inner in [one for one in self._entries if _above(place, one)]:
            self._forget(inner)
        for inner in [one for one in self._counts if _above(place, one)]:
            del self._counts[inner]
        self.keep(place, digest, arrays)
        if self.due():
            self.write()
        return from_arrays(kind, arrays)

    def array(self, name: str, work: Callable[[], np.ndarray], *inputs: Any) -> np.ndarray:
        """See `Journal.array`."""
        return self.once(name, _Single, lambda: _Single(work()), *inputs).values

    def loop(self, name: str, *inputs: Any) -> Loop:
        """See `Journal.loop`."""
        return _KeptLoop(self, self._place(name), stamp_of(*inputs))

    def due(self) -> bool:
        """Whether enough work has been done since the last writing."""
        return time.monotonic() - self._written >= min(max(SOONEST, COST * self._took), LATEST)

    def keep(self, place: str, digest: str, arrays: Arrays) -> None:
        """Put an entry at a place, replacing the one that is there."""
        self._forget(place)
        self._entries[place] = _Entry(digest, None, arrays)

    def write(self) -> None:
        """Write the entries that wait, and remove files without entries."""
        waiting = {place: entry for place, entry in self._entries.items() if entry.file is None}
        if not waiting:
            return
        began = time.monotonic()
        self._number += 1
        name = f"checkpoint.{self._number:06d}.safetensors"
        tensors: Arrays = {}
        words = {"stamp": self._stamp}
        for place, entry in waiting.items():
            words[place] = f"{entry.digest} {_check(entry.arrays):08x}"
            for key, array in entry.arrays.items():
                if array.dtype.kind == "U":
                    words[f"{place}:{key}"] = str(array)
                elif array.flags.c_contiguous:
                    tensors[f"{place}:{key}"] = array
                else:
                    tensors[f"{place}:{key}"], words[f"{place}:{key}"] = array.T, TRANSPOSED
        try:
            with self._take.writing(name) as path:
                path.write_bytes(save(tensors, words))
        except TakeError as error:
            if not self._warned:
                self._progress.warn(f"Intermediate results cannot be saved: {error.message} A crash would cost all of the work.")
            self._warned = True
            for place in waiting:
                self._forget(place)
        else:
            for entry in waiting.values():
                entry.file, entry.arrays = self._take.file(name), {}
            self._live[self._take.file(name)] = len(waiting)
            self._sweep()
        self._written = time.monotonic()
        self._took = self._written - began

    def clear(self) -> None:
        """Remove all entries, as the computation is finished."""
        for place in list(self._entries):
            self._forget(place)
        self._sweep()

    def read(self, place: str, digest: str) -> Arrays | None:
        """The result at a place; None if there is none for these inputs."""
        entry = self._entries.get(place)
        if entry is None:
            return None
        arrays = entry.arrays
        if entry.file is not None:
            arrays, digest_and_check = _read(entry.file, place)
            if digest_and_check != f"{digest} {_check(arrays):08x}":
                arrays = {}
        if entry.digest == digest and arrays:
            return arrays
        self._forget(place)
        return None

    def _place(self, name: str) -> str:
        """The place of the next part with this name inside the innermost open part."""
        whole = f"{self._open[-1]}/{name}" if self._open else name
        number = self._counts[whole]
        self._counts[whole] += 1
        return f"{whole} {number}"

    def _forget(self, place: str) -> None:
        entry = self._entries.pop(place, None)
        if entry is not None and entry.file is not None:
            self._live[entry.file] -= 1

    def _sweep(self) -> None:
        """Remove files that hold no entries any more."""
        for path in [path for path, count in self._live.items() if count <= 0]:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
            del self._live[path]

    def _look_into(self, path: Path) -> None:
        """Register the entries that an earlier run left in a file."""
        self._live[path] = 0
        number = path.name.split(".")[1]
        self._number = max(self._number, int(number) if number.isdecimal() else 0)
        try:
            with safe_open(path, framework="numpy") as file:
                words = file.metadata() or {}
            if words.pop("stamp", None) != self._stamp:
                return
            for place, word in words.items():
                if ":" not in place:
                    self._forget(place)
                    self._entries[place] = _Entry(word.split(" ")[0], path, {})
                    self._live[path] += 1
        except DAMAGED:
            return


class _KeptLoop(Loop):
    """A loop whose state is kept at a place in the journal."""

    def __init__(self, journal: TakeJournal, place: str, digest: str) -> None:
        self._journal, self._place, self._digest = journal, place, digest

    def resume(self) -> tuple[int, Arrays]:
        state = dict(self._journal.read(self._place, self._digest) or {})
        return int(state.pop(DONE, np.array(0))), state

    def reached(self, done: int, state: Callable[[], Arrays]) -> None:
        if self._journal.due():
            arrays = {key: _plain(np.array(value)) for key, value in state().items()}
            self._journal.keep(self._place, self._digest, {DONE: np.array(done), **arrays})
            self._journal.write()


def _above(place: str, other: str) -> bool:
    """Whether the place `other` is inside `place`."""
    return other.startswith(place + "/")


def _plain(array: np.ndarray) -> np.ndarray:
    """The array as contiguous memory: its order affects the last bits of products, so it must be the same after reading."""
    return array if array.flags.c_contiguous or array.flags.f_contiguous else np.ascontiguousarray(array)


def _check(arrays: Arrays) -> int:
    """Checksum of names, shapes, types and values."""
    total = 0
    for key in sorted(arrays):
        array = arrays[key]
        kind = "text" if array.dtype.kind == "U" else str((array.shape, array.dtype.str, array.flags.c_contiguous))
        content = str(array).encode() if array.dtype.kind == "U" else array.tobytes()
        total = zlib.crc32(content, zlib.crc32(f"{key} {kind}".encode(), total))
    return total


def _read(path: Path, place: str) -> tuple[Arrays, str]:
    """The arrays of an entry, with their order in memory, and its digest and checksum; nothing if the file has been damaged since."""
    arrays: Arrays = {}
    try:
        with safe_open(path, framework="numpy") as file:
            words = file.metadata() or {}
            tensors = [key for key in file.keys() if key.startswith(place + ":")]
            for key in tensors:
                array = np.array(file.get_tensor(key))
                arrays[key.removeprefix(place + ":")] = array.T if words.get(key) == TRANSPOSED else array
            for key, word in words.items():
                if key.startswith(place + ":") and key not in tensors:
                    arrays[key.removeprefix(place + ":")] = np.array(word)
        return arrays, words.get(place, "")
    except DAMAGED:
        return {}, ""
