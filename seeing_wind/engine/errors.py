"""Errors that a user can act on: each says what happened, and `hint` what to do next.

Misuse and failure are exceptions; a recovery that merely stops early is not (see `records.Outcome`). The class of the exception alone
determines whether it was misuse or failure, and so which exit code the command line returns.
"""

from __future__ import annotations

import errno

FAILED = 1
"""Exit code of a job that could not do its work with what it was given: a full disk, a missing package, a simulation that breaks down."""
WRONG_INPUT = 2
"""Exit code where an input cannot be used, at whatever point this is found out: options, a file, a damaged take, the clip, or the object
in it."""
DONE_WITH_WARNINGS = 3
"""Exit code of a job that has a result, but some image or video of it is missing, or the result is not to be trusted: its `warnings` say
which."""
CANCELLED = 130
"""Exit code after a cancel, as a shell reports SIGINT."""
NO_PATH = (errno.ENOTDIR, errno.EEXIST, errno.ENAMETOOLONG, errno.ELOOP)
"""Codes of system errors that mean that a path is invalid: it leads through a file or in a circle, or is too long."""


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
    """Options or files that cannot be used: they contradict each other, are out of range, or have the wrong content."""

    exit_code = WRONG_INPUT


class ClipError(SeeingWindError):
    """The clip cannot be opened, is no video, or has too few frames."""

    exit_code = WRONG_INPUT


class ObjectError(SeeingWindError):
    """The object cannot be used: there is none at the mask or box, it is too small to follow, or its mesh or points are unsuitable."""

    exit_code = WRONG_INPUT


class MaterialError(SeeingWindError):
    """A material that is not in the library or whose numbers are not physical.

    `quantity` is the property that is out of its range, or "" if the error is of another kind.
    """

    exit_code = WRONG_INPUT

    def __init__(self, message: str, hint: str = "", *, quantity: str = "") -> None:
        super().__init__(message, hint)
        self.quantity = quantity


class ModelError(SeeingWindError):
    """An optional model failed: it cannot be used (`WrongModel`), or its endpoint does not answer or answers nonsense."""


class WrongModel(ModelError):
    """A given model cannot be used: there is none of that name, or its folder lacks files or holds the wrong ones."""

    exit_code = WRONG_INPUT


class SimulationError(SeeingWindError):
    """The simulation stopped: a substep was too long, a particle left the grid, or a value was not finite.

    `frame`, `substep` and `particle` say where it stopped (-1 where this does not apply), `quantity` which value was at fault.
    """

    def __init__(self, message: str, hint: str = "", *, frame: int = -1, substep: int = -1, particle: int = -1, quantity: str = "") -> None:
        super().__init__(message, hint)
        self.frame, self.substep, self.particle, self.quantity = frame, substep, particle, quantity


class TakeError(SeeingWindError):
    """A take that cannot be read or written, or is in use."""


class WrongTake(TakeError):
    """A given take or path cannot be used: it is damaged, of another version, or has something else in the place of a file."""

    exit_code = WRONG_INPUT


def clause(error: Exception) -> str:
    """The text of another error for the inside of a sentence: without a full stop, and a missing key as such."""
    if isinstance(error, KeyError) and error.args:
        return f"it lacks {error.args[0]}"
    return (error.message if isinstance(error, SeeingWindError) else str(error)).rstrip(".")


def extra(name: str) -> str:
    """The command that installs an optional part of the engine, as in the guides: from the project's folder, as no package index has it."""
    return f'pip install "PROJECT[{name}]", PROJECT being the folder of this project'


class MissingPackage(SeeingWindError):
    """A Python package that this job needs is not installed in the engine's environment."""

    mend = "install_engine"


def unloaded(error: ImportError) -> MissingPackage:
    """What to say of a package of the engine that is missing, or that is installed and cannot be loaded."""
    package = (error.name or "").partition(".")[0]
    said = f"The engine's Python lacks the package {package}."
    if not isinstance(error, ModuleNotFoundError):
        said = f"{f'The package {package}' if package else 'A package'} of the engine cannot be loaded: {clause(error)}."
    return MissingPackage(said, "Run Install Engine, or `make setup`.")
