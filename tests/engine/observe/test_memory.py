"""Memory does not grow with the clip's length: frames are kept on disk, masks are packed."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import Scene, write_video

from seeing_wind.engine.errors import FAILED, SeeingWindError
from seeing_wind.engine.observe.clip.frames import read_clip
from seeing_wind.engine.observe.clip.stored import StoredFrames

resource = pytest.importorskip("resource")

OBSERVE = """
import resource, sys
from seeing_wind.engine.observe import observe
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.settings import ObserveSettings
observe(sys.argv[1], ObserveSettings(box=tuple(map(float, sys.argv[2:6])), distance=1.0, frames=(0, int(sys.argv[6]))), NoProgress())
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024))
"""


def peak(path: Path, box: tuple[float, ...], last: int) -> int:
    """Peak resident memory [bytes] of a process that observes frames 0 to `last`."""
    command = [sys.executable, "-c", OBSERVE, str(path), *map(str, box), str(last)]
    return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1])


def test_a_longer_clip_takes_no_more_memory(disc: Scene, tmp_path: Path) -> None:
    there = list(disc.frames[:12])
    # To and fro, so that the object stays in the frame however long the clip is.
    write_video(tmp_path / "long.avi", (there + there[::-1]) * 5, 30.0)
    short, long = peak(tmp_path / "long.avi", disc.box, 23), peak(tmp_path / "long.avi", disc.box, 71)
    masks = 48 * disc.masks[0].nbytes
    # The frames, or masks of a byte a pixel, would each show: the slack is for the allocator.
    assert long - short < 0.5 * masks, f"{(long - short) / 1e6:.1f} MB more; unpacked masks are {masks / 1e6:.0f} MB"


def test_stored_frames_read_like_an_array() -> None:
    frames = np.random.default_rng(0).integers(0, 256, (4, 6, 5, 3)).astype(np.uint8)
    stored = StoredFrames(6, 5)
    for frame in frames:
        stored.append(frame)
    assert stored.shape == frames.shape and len(stored) == 4 and np.array_equal(stored, frames)
    assert np.array_equal(stored[-1], frames[-1]) and np.array_equal(stored[2, 1:4], frames[2, 1:4])
    assert np.array_equal(np.stack(list(stored)), frames)
    first = stored[0]
    first[:] = 0
    assert np.array_equal(stored[0], frames[0]), "a copy that the caller owns"
    with pytest.raises(IndexError, match="frame 4 of 4"):
        stored[4]


def test_a_full_disk_says_what_to_do(disc: Scene) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        for frames, says in ((0.5, "frames: no file may be so large"), (3, "frames after the first 3: no file may be so large")):
            resource.setrlimit(resource.RLIMIT_FSIZE, (round(frames * disc.frames[0].nbytes), before[1]))
            with pytest.raises(SeeingWindError, match=f"no room for the clip's {says}") as caught:
                read_clip(disc.path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert caught.value.exit_code == FAILED, "the clip itself could be used"
    assert "ulimit" in caught.value.hint and "TMPDIR" in caught.value.hint and "--frames" in caught.value.hint


def test_frames_are_reduced_as_they_are_decoded_and_some_kept(disc: Scene) -> None:
    whole = read_clip(disc.path)
    small = read_clip(disc.path, resized=lambda height, width: (height // 2, width // 2), keep=(0, 3))
    height, width = disc.frames.shape[1:3]
    assert small.frames.shape == (len(disc.frames), height // 2, width // 2, 3) and small.size == (height, width)
    assert small.kept == (0, 3)
    assert np.array_equal(small.as_filmed(3), whole.frames[3]) and np.array_equal(whole.as_filmed(3), whole.frames[3])
