"""An observation that is killed again and again, and each time continues from its journal."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.mask.follow import MaskFollower
from seeing_wind.engine.observe.mask.through import Follower
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.record_arrays import to_arrays
from seeing_wind.engine.records import Observation
from seeing_wind.engine.recovery import journal as journals
from seeing_wind.engine.recovery.journal import TakeJournal
from seeing_wind.engine.settings import ObserveSettings
from seeing_wind.engine.take import Take


class Killed(BaseException):
    """An exception that no computation expects."""


def in_pieces(
    clip: Path, settings: ObserveSettings, folder: Path, every: int, follower: type[Follower] = MaskFollower
) -> tuple[Observation, int, int]:
    """The observation of `clip`, killed each time the object has been followed in a given number of frames.

    Returns:
        The observation, how often it was killed, and in how many frames the object was followed in total.
    """
    advance, frames, kills, since = follower.advance, 0, 0, 0

    def counted(self: Follower, frame: np.ndarray) -> np.ndarray:
        nonlocal frames, since
        if since == every:
            since = 0
            raise Killed
        frames, since = frames + 1, since + 1
        return advance(self, frame)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(follower, "advance", counted)
        patch.setattr(journals, "LATEST", 0.0)  # everything is written at once
        while True:
            try:
                with TakeJournal(Take(folder), "clip", NoProgress()) as journal:
                    return observe(clip, settings, NoProgress(), journal), kills, frames
            except Killed:
                kills += 1


def assert_same(found: Observation, wanted: Observation) -> None:
    """Two observations are the same to the last bit."""
    ours, theirs = to_arrays(found), to_arrays(wanted)
    assert ours.keys() == theirs.keys()
    for key, values in ours.items():
        assert values.dtype == theirs[key].dtype and np.array_equal(values, theirs[key], equal_nan=values.dtype.kind == "f"), key
