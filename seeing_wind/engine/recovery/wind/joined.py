"""Stage *wind* for several takes of one clip: one wind that moved all their objects -> `wind.safetensors` and `wind.json` in each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import ObjectError, UsageError, WrongTake
from ...field import ForceField, distill
from ...progress import Progress
from ...record_arrays import TRAJECTORY, read_body, recovery_of
from ...records import Body, Particles, Recovery
from ...settings import RecoverSettings, from_mapping
from ...take import Take, stamp_of
from .estimate import Estimate, wind_of
from .stage import clear, felt_in, write_wind
from .together import FeltTogether, basis_together
from .verdict import figures, objection, sentence

VERSION = 1
"""Part of the stamp: raise it when the results change."""


@dataclass(frozen=True)
class Taken:
    """An object of the clip, as read from its take."""

    take: Take
    body: Body
    recovery: Recovery
    fps: float
    solving: RecoverSettings

    @staticmethod
    def of(take: Take) -> Taken:
        """Read an object from its take.

        Raises:
            UsageError: if the take cannot be joined with others. WrongTake: if it is damaged.
        """
        if not take.file("particles.npz").is_file() or not take.file(TRAJECTORY).is_file():
            raise UsageError(f"{take.path} holds no object recovered from a clip.", "Run `recover` with --take for this folder first.")
        body = read_body(take)
        if body.sheet is not None:
            raise UsageError(
                f"{take.path} holds a thin sheet. A sheet's wind comes from the forces on its vertices and cannot be joined with others.",
                "Recover the object with --form solid to join it.",
            )
        stage = take.description().get("stages", {}).get("recover", {})
        arrays = take.read_arrays(TRAJECTORY)
        if "settings" not in stage or "fps" not in arrays:
            raise WrongTake(f"{take.path} does not say how it was recovered.", "Run `recover` with --take for this folder again.")
        solving = from_mapping(RecoverSettings, stage["settings"], str(take.path))
        return Taken(take, body, recovery_of(arrays), float(arrays["fps"]), solving)

    @property
    def name(self) -> str:
        """Name of the take's folder."""
        return self.take.path.name


def join_winds(takes: Sequence[Take], progress: Progress) -> dict[str, Any]:
    """Find one wind that explains how the objects of all takes moved, and write it to each take.

    Returns:
        The contents of `wind.json`.

    Raises:
        UsageError: for fewer than two takes, takes that differ in frames or frame rate, or a take without a solid object from a clip.
        ObjectError: if no wind can have caused one of the forces. The takes are then left as they were.
    """
    if len({take.path.resolve() for take in takes}) < 2:
        raise UsageError("One wind for several objects needs at least two different takes.", "Name the takes of two objects of a clip.")
    seen = [Taken.of(take) for take in takes]
    first = seen[0]
    for one in seen[1:]:
        if (len(one.recovery.force_density), one.fps) != (len(first.recovery.force_density), first.fps):
            raise UsageError(
                f"{one.name} has {len(one.recovery.force_density)} frames at {one.fps:g} per second, {first.name} "
                f"{len(first.recovery.force_density)} at {first.fps:g}.",
                "Join objects that were recovered from the same frames of the same clip.",
            )
    progress.begin("wind", "finding the wind of all objects")
    estimate, particles, recovery = _estimated(seen, progress)
    progress.begin("wind", "fitting the wind")
    field: ForceField = distill(recovery, particles, first.fps, first.solving.representation, first.solving.seed, progress)
    field.kind = "wind"
    names = [one.name for one in seen]
    told = {"field": "wind", "why": f"One wind for {', '.join(names)}.", **figures(estimate), "joined": names}
    told["notes"] = [told["why"], sentence(told)]
    stamp = stamp_of("joined wind", VERSION, *(one.take.file(TRAJECTORY) for one in seen))
    for one in seen:
        clear(one.take)
        write_wind(one.take, field, told, stamp)
    return told


def _estimated(seen: Sequence[Taken], progress: Progress) -> tuple[Estimate, Particles, Recovery]:
    """The wind at the particles of all objects in order, these particles as one body, and its recovery with the wind as its force."""
    parts = [felt_in(one.body, one.body.particles, one.body.material, one.recovery, one.fps, one.solving) for one in seen]
    counts = [len(one.body.particles.x) for one in seen]
    union = basis_together([basis for _, basis, _ in parts], [one.body.particles.x for one in seen])
    path = np.concatenate([one.recovery.x for one in seen], axis=1)
    found = wind_of(FeltTogether(tuple(felt for felt, _, _ in parts)), union, path, progress, counts)
    moving = np.concatenate([np.repeat(~still[:, None], count, axis=1) for (_, _, still), count in zip(parts, counts)], axis=1)
    found = replace(found, velocity=found.velocity * moving[..., None], deviation=found.deviation * moving[..., None])
    for one, begin, count in zip(seen, np.cumsum([0, *counts]), counts):
        rows = slice(begin, begin + count)
        own = replace(found, velocity=found.velocity[:, rows], deviation=found.deviation[:, rows])
        against = objection(own, one.recovery, one.body.particles, one.body.material.density, one.fps, one.solving.gravity)
        if against:
            raise ObjectError(f"No wind moves the object of {one.name}. {against}", "Join the others without it.")
    bodies = [one.body.particles for one in seen]
    particles = Particles(
        np.concatenate([one.x for one in bodies]), np.concatenate([one.volume for one in bodies]),
        np.concatenate([one.pinned for one in bodies]), min(one.spacing for one in bodies),
    )  # fmt: skip
    recovery = replace(
        seen[0].recovery, force_density=found.velocity, deviation=found.deviation, x=path,
        F=np.concatenate([one.recovery.F for one in seen], axis=1), v0=np.concatenate([one.recovery.v0 for one in seen]),
    )  # fmt: skip
    return found, particles, recovery
