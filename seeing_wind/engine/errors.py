"""Errors that a user can act on: each says what happened, and `hint` what to do next.

Misuse and failure are exceptions; a recovery that merely stops early is not (see `records.Outcome`). Their classes alone say which of the
two it was, and so which exit code the command line returns.
"""

from __future__ import annotations

import errno

FAILED = 1
"""Exit code of a job that could not do its work with what it was given: a full disk, a missing package, a simulation that breaks down."""
WRONG_INPUT = 2
"""Exit code where what was given cannot be used, whenever that is found: options, a file, a damaged take, the clip, or the object
in it."""
DONE_WITH_WARNINGS = 3
"""Exit code of a job whose result is there, but not every image or video of it, or is not to be trusted: its `warnings` say which."""
CANCELLED = 130
"""Exit code after a cancel, as a shell reports SIGINT."""
NO_PATH = (errno.ENOTDIR, errno.EEXIST, errno.ENAMETOOLONG, errno.ELOOP)
"""Errors of the system for a path that can be none: it leads through a file or in a circle, or is too long."""


class SeeingWindError(Exception):
    """Base of everything the engine raises on purpose.

    Args:
        message: one sentence, what happened.
        hint: one sentence, what to do about it; may be empty.

    `exit_code` is what the command line returns; `mend` names the control that the panel offers beside the message, or "".
    """

    exit_code = FAILED
    mend = ""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint

    def __str__(self) -> str:
        return f"{self.message} {self.hint}".strip()


class UsageError(SeeingWindError):
    """Options or files that cannot be used: they contradict each other, are out of range, or hold something else."""

    exit_code = WRONG_INPUT


class ClipError(SeeingWindError):
    """The clip cannot be opened, is no video, or has too few frames."""

    exit_code = WRONG_INPUT


class ObjectError(SeeingWindError):
    """No object where the mask or box says, or one too small to follow."""

    exit_code = WRONG_INPUT


class MaterialError(SeeingWindError):
    """A material that is not in the library or whose numbers are not physical.

    `quantity` is the property of the material that is out of its range, "" where it is none.
    """

    exit_code = WRONG_INPUT

    def __init__(self, message: str, hint: str = "", *, quantity: str = "") -> None:
        super().__init__(message, hint)
        self.quantity = quantity


class ModelError(SeeingWindError):
    """An optional model: see `WrongModel`, or its endpoint does not answer or answers nonsense."""


class WrongModel(ModelError):
    """A model that was given and cannot be used: there is none of that name, its folder lacks files, or holds others."""

    exit_code = WRONG_INPUT


class SimulationError(SeeingWindError):
    """The simulation stopped: a substep too long, a particle out of the grid, or a value that is not finite.

    `frame`, `substep` and `particle` say where (-1 where it does not apply); `quantity` which number.
    """

    def __init__(self, message: str, hint: str = "", *, frame: int = -1, substep: int = -1, particle: int = -1, quantity: str = "") -> None:
        super().__init__(message, hint)
        self.frame, self.substep, self.particle, self.quantity = frame, substep, particle, quantity


class TakeError(SeeingWindError):
    """A take that cannot be read or written, or is in use."""


class WrongTake(TakeError):
    """A take or a path that was given and cannot be used: damaged, of another version, or with something else in the place of a file."""

    exit_code = WRONG_INPUT


def extra(name: str) -> str:
    """How an optional part of the engine is installed, as the guides say it: no index of packages has this project."""
    return f'pip install "PROJECT[{name}]", PROJECT being the folder of this project'


class MissingPackage(SeeingWindError):
    """A Python package that this job needs is not installed in the engine's environment."""

    mend = "install_engine"
