"""One writer per take: a lock that is released when the process that holds it ends, in whatever way. Reading needs no lock.

The operating system locks the file `take.lock`; its content only tells others who holds the lock, and means nothing once the lock is free.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import socket
import stat
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

from ..errors import NO_PATH, TakeError, WrongTake
from ..progress import Progress
from ..take import Take
from . import inputs

NAME = inputs.LOCK
LONGEST = 1000
"""Most bytes that are read of what the lock's holder has written."""
LOCKED_BYTE = 2**20
"""Position of the byte that is locked on Windows. It is beyond the content, as locked bytes cannot be read and others shall read who
holds the lock."""


class TakeInUse(TakeError):
    """Another process is writing to the take."""


@contextlib.contextmanager
def held(take: Take, verb: str, progress: Progress, reads: Iterable[tuple[str, Path]] = (), made: str = inputs.MADE) -> Iterator[Take]:
    """Check that a take can be written to, and hold it for writing; files that dead processes left unfinished are removed.

    Args:
        verb: the holder's verb, for the message to others.
        progress: gets a warning if the file system has no locks, so that nothing is held, or if the lock was removed meanwhile.
        reads, made: what the job reads and writes, see `inputs.check_place`.

    Raises:
        UsageError: an input, or a file in a folder that is not a take, would be overwritten; nothing is written then.
        TakeInUse: another process holds the take; the message says which, and since when.
        TakeError: the folder cannot be written to. WrongTake: the lock is not a file.
    """
    inputs.check_place(take, reads, made)
    before = _names_in(take)
    take.prepare()
    try:
        with _opened(take.file(NAME)) as file:
            try:
                _lock(file)
            except OSError as error:
                if error.errno in (errno.EAGAIN, errno.EACCES, errno.EDEADLK):
                    raise TakeInUse(
                        f"{take.path} is in use: {_holder(file)}.",
                        "Wait until it has finished, stop it, or choose another folder with --take.",
                    ) from error
                progress.warn(f"{take.path} cannot be locked ({error.strerror}): see that no other job writes to it.")
            _sign(file, {"verb": verb, "pid": os.getpid(), "host": socket.gethostname(), "since": time.strftime("%Y-%m-%d %H:%M:%S")})
            take.clear_leftovers()
            try:
                yield take
                if not _is_at(file, take.file(NAME)):
                    progress.warn(
                        f"{take.path} was removed or replaced while `{verb}` wrote to it: what it had held before is lost, and another "
                        f"job may have written to it. Run `{verb}` again if something is missing."
                    )
            finally:
                _sign(file, {})
    finally:
        _leave(take, before)


def _names_in(take: Take) -> set[str] | None:
    """Names of the files and folders in a take's folder; None if there is no such folder."""
    return {path.name for path in take.path.iterdir()} if take.path.is_dir() else None


def _leave(take: Take, before: set[str] | None) -> None:
    """After a job that has kept nothing, such as one that found no clip, remove the lock and the folder, as far as the job made them.

    `before`: as `_names_in` before the job. The lock, which alone makes a folder a take, would be left in a folder of the user's files.
    """
    with contextlib.suppress(OSError):
        now = _names_in(take)
        if now is not None and NAME in now and now <= {NAME, *(before or ())} and NAME not in (before or ()):
            take.file(NAME).unlink()
            if before is None:
                take.path.rmdir()


def _opened(path: Path) -> IO[bytes]:
    """Open the lock's file, creating it if necessary. A link is not followed, as we must not write to what it points to."""
    try:
        number = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o666)
    except OSError as error:
        kind = WrongTake if error.errno in (*NO_PATH, errno.EISDIR) else TakeError
        raise kind(f"{path} cannot be written: {error.strerror}.", "Remove it, or choose another folder with --take.") from error
    file = os.fdopen(number, "r+b", buffering=0)
    if not stat.S_ISREG(os.fstat(number).st_mode):
        file.close()
        raise WrongTake(f"{path} is not a regular file.", "Remove it, or choose another folder with --take.")
    return file


def _is_at(file: IO[bytes], path: Path) -> bool:
    """Whether an open file is still the one at `path`."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except OSError:
        return False


def _lock(file: IO[bytes]) -> None:
    """Lock the file until it is closed. Raises OSError at once if another process has locked it."""
    if sys.platform == "win32":
        import msvcrt

        file.seek(LOCKED_BYTE)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _sign(file: IO[bytes], holder: dict[str, str | int]) -> None:
    """Write into the file who holds the lock; a failure, as on a full disk, does not matter."""
    with contextlib.suppress(OSError):
        file.seek(0)
        file.truncate()
        file.write(json.dumps(holder).encode() if holder else b"")


def _holder(file: IO[bytes]) -> str:
    """A description of the lock's holder, from the file's content."""
    try:
        file.seek(0)
        told = json.loads(file.read(LONGEST))
        return f"`{told['verb']}` (process {told['pid']} on {told['host']}) has been writing to it since {told['since']}"
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return "another process is writing to it"
