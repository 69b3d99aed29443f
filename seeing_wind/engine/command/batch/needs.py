"""What a job takes of a machine, measured (docs/guide/batch-and-farm.md has the figures)."""

from __future__ import annotations

from dataclasses import dataclass

from .jobs import Job

MIB = 1 << 20


@dataclass(frozen=True)
class Needs:
    """What is reserved for one job on a node."""

    cpus: int
    """At most: a second core makes an elastic body's job a tenth to a fifth shorter, a plastic one's almost half. None needs it."""
    memory: int
    """Bytes."""


TABLE = {
    "recover": Needs(2, 2048 * MIB),
    "recover-trajectories": Needs(2, 1536 * MIB),
    "resimulate": Needs(2, 1024 * MIB),
}
"""By verb: half as much again as was measured, and more for a clip, whose size counts."""
BLENDER = Needs(1, 1024 * MIB)
"""To make a file, and to render a frame of it."""


def needs_of(job: Job) -> Needs:
    """The most that any of its verbs needs; they run one after the other."""
    each = [TABLE[call[0]] for call in job.calls()]
    return Needs(max((need.cpus for need in each), default=1), max((need.memory for need in each), default=256 * MIB))
