"""The cores and memory that a job needs, from measurements (docs/guide/batch-and-farm.md has the figures)."""

from __future__ import annotations

from dataclasses import dataclass

from .jobs import Job

MIB = 1 << 20


@dataclass(frozen=True)
class Needs:
    """What is reserved for one job on a node."""

    cpus: int
    """Most cores that are of use. A second core is never necessary; it saves 10 to 20 % of the time of a job with an elastic body, almost
    half with a plastic one."""
    memory: int
    """Memory [bytes]."""


TABLE = {
    "recover": Needs(2, 2048 * MIB),
    "recover-trajectories": Needs(2, 1536 * MIB),
    "resimulate": Needs(2, 1024 * MIB),
}
"""Needs by verb: memory is 1.5 times what was measured, and more for a clip, as it depends on the clip's size."""
BLENDER = Needs(1, 1024 * MIB)
"""Needs of Blender for making a file and for rendering a frame of it."""


def needs_of(job: Job) -> Needs:
    """The most that any of the job's verbs needs, as they run one after the other."""
    each = [TABLE[call[0]] for call in job.calls()]
    return Needs(max((need.cpus for need in each), default=1), max((need.memory for need in each), default=256 * MIB))
