"""What a job takes of a machine, measured (docs/batch.md has the figures)."""

from __future__ import annotations

from dataclasses import dataclass

from .jobs import Job

MIB = 1 << 20


@dataclass(frozen=True)
class Needs:
    """What is reserved for one job on a node."""

    cpus: int
    memory: int
    """Bytes."""


TABLE = {
    "recover": Needs(2, 1536 * MIB),
    "recover-trajectories": Needs(2, 1024 * MIB),
    "resimulate": Needs(2, 1024 * MIB),
}
"""By verb: a body of about a thousand particles, and a clip of up to 720 lines and 100 frames with room to spare."""
RENDER = Needs(2, 2048 * MIB)
"""Blender, for a frame of such a clip."""


def needs_of(job: Job) -> Needs:
    """The most that any of its verbs needs; they run one after the other."""
    each = [TABLE[call[0]] for call in job.calls()]
    return Needs(max((need.cpus for need in each), default=1), max((need.memory for need in each), default=256 * MIB))
