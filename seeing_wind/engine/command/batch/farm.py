"""A batch on a Ray cluster: each job runs on some node, and its takes are sent back; if the node dies, it is tried again on another one."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from ...errors import SeeingWindError
from ...progress import Progress
from .delivery import Incoming, files_of, order_of
from .jobs import Job
from .needs import needs_of
from .process import CANCEL_GRACE, Message
from .ray_cluster import Cluster, Lost, Running
from .summary import Summary

ATTEMPTS = 3
"""Most times that a job is started if its worker or node dies."""
BEAT = 0.3
"""Most seconds between two checks for a cancel."""
SHOWN = 4
"""Most jobs that the progress line names."""
PART = {"observe": (0.0, 0.15), "build": (0.15, 0.05), "recover": (0.2, 0.6), "report": (0.8, 0.1), "resimulate": (0.9, 0.1)}
"""Stage -> the fraction of a job's progress at which it begins, and the fraction that it takes."""


@dataclass
class Flight:
    """A job that is on the cluster."""

    job: Job
    running: Running
    incoming: Incoming
    attempt: int
    started: float
    tried: list[str] = field(default_factory=list)
    """Nodes on which the job died."""
    node: str = ""
    """The node on which the job runs; empty while it waits for one."""
    stage: str = "waits"
    fraction: float = 0.0


class Farm:
    """The jobs of `summary` on `cluster`.

    Args:
        shared: whether all nodes see this machine's folders under the same paths; otherwise files are shipped.
        attempts: most times that a job is started.
    """

    def __init__(self, cluster: Cluster, summary: Summary, progress: Progress, *, shared: bool, attempts: int) -> None:
        self.cluster, self.summary, self.progress = cluster, summary, progress
        self.shared, self.attempts = shared, attempts
        self.flights: list[Flight] = []
        self.waiting: list[Job] = []
        self._jobs = 0
        """Number of jobs that are to be done."""
        self._line = ""

    def run(self) -> None:
        """Run all jobs that are not done yet, and write the summary whenever one ends.

        Raises:
            SeeingWindError: a node lacks this engine; nothing was started.
            Cancelled: the batch was cancelled, and all jobs were stopped.
        """
        self.progress.begin("batch", "looks at the nodes")
        self.cluster.check(self.progress.check)
        for job in self.summary.jobs:
            if self.summary.is_done(job):
                self.summary.skip(job)
            else:
                self.waiting.append(job)
        self._jobs = len(self.waiting)
        try:
            while self.waiting or self.flights:
                self._start_ready()
                self._listen()
                self._tell()
        except BaseException:  # after a cancel or a defect, too, nothing must be left running on other machines
            self._stop_all()
            raise
        self._tell()

    def _start_ready(self) -> None:
        """Start all jobs that need not wait for a take that another job makes. Ray assigns them to nodes."""
        for job in list(self.waiting):
            before = self.summary.jobs[: self.summary.jobs.index(job)]
            if any(other.take == job.take and other.name not in self.summary.outcomes for other in before):
                continue
            self.waiting.remove(job)
            try:
                self.summary.check_take(job)
                job.check_edit_take()
                self.flights.append(self._start(job, 1, []))
            except SeeingWindError as error:
                self.summary.end(job, "failed", 0.0, str(error))

    def _start(self, job: Job, attempt: int, tried: list[str]) -> Flight:
        needs = self.cluster.fitting(needs_of(job), self._jobs)
        order = order_of(job, needs.cpus, self.shared)
        files = {} if self.shared else {str(path): self.cluster.put(path) for path in files_of(job)}
        other = next((node for node in self.cluster.nodes() if node not in tried), None) if tried else None
        running = self.cluster.start(order, files, needs, other)
        return Flight(job, running, Incoming([] if self.shared else order.takes, self.progress), attempt, time.monotonic(), tried)

    def _listen(self) -> None:
        if not self.flights:
            return
        ready = self.cluster.ready([flight.running for flight in self.flights], BEAT)
        for flight in [flight for flight in self.flights if flight.running in ready]:
            try:
                message = self.cluster.next(flight.running)
                if message is None:
                    raise Lost("it ended without a word")
                self._hear(flight, message)
            except Lost as error:
                self._try_again(flight, str(error))
            except SeeingWindError as error:
                self._end(flight, "failed", str(error))

    def _hear(self, flight: Flight, message: Message) -> None:
        kind = message["type"]
        if kind == "placed":
            flight.node, flight.stage = message["node"], "starts"
        elif kind == "progress":
            begin, share = PART.get(message["stage"], (flight.fraction, 0.0))
            flight.stage, flight.fraction = message["stage"], max(flight.fraction, begin + share * message["fraction"])
        elif kind == "warning":
            self.progress.warn(f"{flight.job.name}: {message['message']}")
        elif kind == "file":
            flight.stage = "comes home"
            flight.incoming.write(message["take"], message["name"], message["content"])
        elif kind == "delivered":
            flight.incoming.accept()
            self._end(flight, "done", f"attempt {flight.attempt}" if flight.attempt > 1 else "")
        elif kind == "failed":
            self._end(flight, "failed", message["message"])
        elif kind == "died":
            self._try_again(flight, message["message"])

    def _try_again(self, flight: Flight, reason: str) -> None:
        self.flights.remove(flight)
        flight.incoming.discard()
        if flight.attempt >= self.attempts:
            said = f"Its worker or node died {flight.attempt} times, at last: {reason.rstrip('.')}."
            self.summary.end(flight.job, "failed", time.monotonic() - flight.started, said)
            return
        self.progress.warn(
            f"{flight.job.name}: its worker or node died ({reason.rstrip('.')}); attempt {flight.attempt + 1} of {self.attempts}."
        )
        again = self._start(flight.job, flight.attempt + 1, [*flight.tried, flight.node])
        again.started = flight.started
        self.flights.append(again)

    def _end(self, flight: Flight, outcome: str, message: str) -> None:
        self.flights.remove(flight)
        flight.incoming.discard()
        self.summary.end(flight.job, outcome, time.monotonic() - flight.started, message)

    def _tell(self) -> None:
        """Report progress in one line for all jobs, if it has changed. Raises Cancelled after a cancel."""
        ended, total = len(self.summary.outcomes), len(self.summary.jobs)
        failed = self.summary.count("failed")
        at_work = [f"{flight.job.name} {flight.stage} {100 * flight.fraction:.0f} %" for flight in self.flights if flight.node]
        more = [f"{len(at_work) - SHOWN} more at work"] * (len(at_work) > SHOWN)
        parts = [f"{ended - failed} of {total} done"] + [f"{failed} failed"] * bool(failed) + at_work[:SHOWN] + more
        queued = len(self.waiting) + sum(not flight.node for flight in self.flights)
        parts += [f"{queued} wait"] * bool(queued)
        line = ", ".join(parts)
        self.progress.check()
        if line != self._line:
            self._line = line
            self.progress.update((ended + sum(flight.fraction for flight in self.flights)) / total, line)

    def _stop_all(self) -> None:
        """Cancel all running jobs, wait until they have stopped at a safe point (or end them), and note them as cancelled."""
        for flight in self.flights:
            self.cluster.cancel(flight.running, force=False)
        deadline = time.monotonic() + CANCEL_GRACE + 2.0
        left = list(self.flights)
        while left and time.monotonic() < deadline:
            for running in self.cluster.ready([flight.running for flight in left], BEAT):
                flight = next(each for each in left if each.running is running)
                try:
                    ended = self.cluster.next(running) is None
                except (Lost, SeeingWindError):
                    ended = True
                if ended:
                    left.remove(flight)
        for flight in left:
            self.cluster.cancel(flight.running, force=True)
        for flight in list(self.flights):
            self._end(flight, "cancelled", "")
