"""Transfer to and from a node: a job's files are sent by content; its takes are written to a folder aside and renamed when complete."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from ... import systems
from ...errors import SeeingWindError, TakeError, UsageError
from ...progress import Progress
from ...settings.tables import names_in
from ...take import Take
from .. import lock
from .jobs import FOLDERS, Job
from .node import Order

LEFT_HERE = {"report.png", "overlay.mp4"}
"""Files of a take that are not sent, as a re-simulation does not read them."""


def order_of(job: Job, threads: int, shared: bool) -> Order:
    """The order for a node to run `job`.

    Raises:
        UsageError: the job names files in a way that cannot be shipped.
    """
    named = [job.take, job.edit_take, job.source, job.edit]
    paths = [str(path) for path in (*named, *(file for _, file in job.named_files())) if path is not None]
    if not shared:
        _check_shippable(job)
    return Order(job.calls(), [str(take) for take in job.takes()], paths, threads, shared)


def _check_shippable(job: Job) -> None:
    for option in sorted({"objects", "view", *FOLDERS} & job.recover.keys()):
        raise UsageError(f'The files of {option} in "{job.name}" cannot be shipped.', "Put the batch on a shared folder and add --shared.")
    for name in names_in(job.edit):
        if Path(name).is_absolute():
            raise UsageError(
                f"{job.edit} names {name}, which a node does not have.",
                "Name it relative to the edit, or use a shared folder and --shared.",
            )


def files_of(job: Job) -> list[Path]:
    """All files that a node needs: those that the job reads, and those in its takes, so that finished stages are kept.

    A take's lock is among them: until the first stage is stamped, only the lock shows that the folder is a take.
    """
    files = [Path(os.path.abspath(path)) for path in job.reads()]
    for take in (job.take, job.edit_take):
        if take is not None and take.is_dir():
            leave = LEFT_HERE if take not in job.takes() else set()
            files += [path for path in sorted(take.rglob("*")) if path.is_file() and path.name not in leave]
    return list(dict.fromkeys(files))


class Incoming:
    """The takes of one attempt at a job, while they are being received."""

    def __init__(self, takes: list[str], progress: Progress) -> None:
        self._progress, self._refused = progress, False
        self._places = {take: Path(take).with_name(f".{Path(take).name}.incoming") for take in takes}
        self.discard()

    def write(self, take: str, name: str, content: bytes) -> None:
        """Write one file of a take.

        Raises:
            TakeError: it cannot be written, or its name leads out of the take.
        """
        place = self._places[take]
        path = place / name
        if not path.resolve().is_relative_to(place.resolve()):
            raise TakeError(f"A node sent a file named {name}.", "Nothing was written; see that node's engine.")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with open(path, "wb") as handle:
                handle.write(content)
                handle.flush()
                os.fsync(handle.fileno())
        except OSError as error:
            raise TakeError(f"{path} cannot be written: {error.strerror or error}.", "Free some space, or mend the folder.") from error

    def accept(self) -> None:
        """Move the takes to their places. A former take is removed once the new one is in place.

        Raises:
            TakeError: a take cannot be replaced, or another process writes to it; the new one then stays beside it.
        """
        for take, place in self._places.items():
            former = place.with_name(f".{Path(take).name}.former")
            try:
                if Path(take).exists():
                    if Take(take).file(lock.NAME).exists():
                        with lock.held(Take(take), "batch", self._progress):  # fails if another process writes there
                            pass
                    shutil.rmtree(former, ignore_errors=True)
                    systems.replace(take, former)
                systems.replace(place, take)
            except (OSError, TakeError, UsageError) as error:
                self._refused = True
                said = error.message if isinstance(error, SeeingWindError) else f"{take} cannot be replaced: {error.strerror or error}."
                raise TakeError(said, f"What the farm made is in {place}.") from error
            shutil.rmtree(former, ignore_errors=True)

    def discard(self) -> None:
        """Remove what a failed attempt has left, but not complete takes that only could not be moved to their places."""
        for place in () if self._refused else self._places.values():
            shutil.rmtree(place, ignore_errors=True)
