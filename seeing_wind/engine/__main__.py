"""`python -m seeing_wind.engine VERB ...`: the worker.

JSON lines on stdout and nothing else: progress, warning, error, and one result at the end. Logs go to stderr. Ctrl-C in a terminal
(SIGINT) stops the worker at the next safe point, and so can the parent process through stdin (`command.cancelling`). Exit codes: 0 done,
130 cancelled, and those of `errors`.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import signal
import sys
import time
import traceback
from collections.abc import Sequence
from typing import Any, TextIO

# Otherwise torch's threads spin while they wait, and beside a busy Blender the solve hardly makes progress. NumPy's threads spin between
# small tasks, too: with two of them a recovery took twice the processor time, and was no faster. Read when the libraries load.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")

from .conventions import LARGEST_IMAGE  # noqa: E402

# Larger images are refused because of their header, before anything is allocated. Read when OpenCV loads.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(LARGEST_IMAGE))
# FFmpeg reports on stderr every encoder that this machine lacks; the engine has its own messages for what went wrong.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

from .command import cancelling  # noqa: E402
from .command.arguments import parser  # noqa: E402
from .errors import CANCELLED, DONE_WITH_WARNINGS, FAILED, NO_PATH, SeeingWindError, UsageError, unloaded  # noqa: E402
from .progress import Cancelled, Progress  # noqa: E402
from .records import Outcome  # noqa: E402

OPENCV_NO_MEMORY = -4
"""`code` of OpenCV's out-of-memory error."""

OUTSIDE = frozenset(
    getattr(errno, name)
    for name in "ENOSPC EDQUOT EFBIG ENAMETOOLONG ENOTDIR EISDIR EACCES EPERM EROFS ELOOP ENOENT EIO ESTALE EINVAL".split()
    if hasattr(errno, name)
)
"""Errors of a disk or a path, which are not defects of the program and need no traceback."""


class Protocol:
    """Writes messages as JSON lines on the real stdout; anything else that a library prints goes to stderr."""

    def __init__(self) -> None:
        self._out: TextIO = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        self.cancelled = False

    def send(self, message: dict[str, Any]) -> None:
        """Write one message. A reader that has gone away cancels the job; a log on a full disk does not stop it."""
        try:
            self._out.write(json.dumps(message, allow_nan=False) + "\n")
            self._out.flush()
        except BrokenPipeError:
            self.cancelled = True
        except OSError as error:
            if error.errno not in OUTSIDE:
                raise
            print(f"A message could not be written: {error.strerror}.", file=sys.stderr)

    def cancel(self) -> None:
        """Stop at the next safe point."""
        self.cancelled = True

    def interrupt(self, *_: Any) -> None:
        """Signal handler: stop at the next safe point; a second signal ends the process at once."""
        self.cancel()
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; returns the exit code."""
    options = list(sys.argv[1:] if argv is None else argv)
    if not {"-h", "--help", "--version"}.isdisjoint(options):
        with contextlib.suppress(SeeingWindError):  # raised again below, and sent as a message
            parser().parse_args(options)  # help and version go to the real stdout, and the process ends
    protocol = Protocol()
    signal.signal(signal.SIGINT, protocol.interrupt)
    cancelling.listen(protocol.cancel)
    started = time.perf_counter()
    try:
        arguments = parser().parse_args(options)
        # The heavy floors are imported only once the options are known to make sense.
        from .command.verbs import VERBS

        result = VERBS[arguments.verb](arguments, Progress(protocol.send, lambda: protocol.cancelled))
    except Cancelled:
        protocol.send({"type": "result", "outcome": Outcome.CANCELLED.value, "seconds": round(time.perf_counter() - started, 2)})
        return CANCELLED
    except SeeingWindError as error:
        return _failed(protocol, error)
    except ImportError as error:
        if not isinstance(error, ModuleNotFoundError):
            traceback.print_exc()
        ours = (error.name or "").partition(".")[0] == (__package__ or "").partition(".")[0]
        return _failed(protocol, _defect(error) if ours else unloaded(error))
    except OSError as error:
        if error.errno not in OUTSIDE:
            traceback.print_exc()
        kind = UsageError if error.errno in NO_PATH else SeeingWindError
        said = f"{error.strerror or error}: {error.filename or ''}".rstrip(": ")
        return _failed(protocol, kind(f"{said}.", "Check the path and the disk."))
    except Exception as error:  # the last resort: the log has the traceback, the user a sentence
        if out_of_memory(error):
            return _failed(protocol, SeeingWindError("Out of memory.", "Use fewer particles or fewer frames."))
        traceback.print_exc()
        return _failed(protocol, _defect(error))
    protocol.send({"type": "result", **result, "seconds": round(time.perf_counter() - started, 2)})
    if result["outcome"] == Outcome.DIVERGED:
        return FAILED
    return DONE_WITH_WARNINGS if result.get("warnings") else 0


def out_of_memory(error: Exception) -> bool:
    """Whether the machine or its graphics card has run out of memory.

    torch has no error class for the machine's memory, and OpenCV only has an error code, so these are recognised by text and number; only
    here.
    """
    if isinstance(error, MemoryError) or type(error).__name__ == "OutOfMemoryError" or getattr(error, "code", None) == OPENCV_NO_MEMORY:
        return True
    return isinstance(error, RuntimeError) and "allocate memory" in str(error)


def _defect(error: Exception) -> SeeingWindError:
    return SeeingWindError(f"Unexpected {type(error).__name__}: {error}.", "This is a defect: please report it with the log.")


def _failed(protocol: Protocol, error: SeeingWindError) -> int:
    protocol.send({"type": "error", "message": error.message, "hint": error.hint, "mend": error.mend})
    protocol.send({"type": "result", "outcome": "failed", "message": str(error)})
    return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
