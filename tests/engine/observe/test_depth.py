"""Depth of the object: a plane, or a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.observe.clip.depth import object_depth, read_depth, typical_depth
from seeing_wind.engine.progress import NoProgress, Progress

MASK = np.zeros((20, 30), bool)
MASK[5:15, 8:22] = True


def test_plane() -> None:
    depth = object_depth(None, "", MASK, 1.5, NoProgress())
    assert depth.dtype == np.float32 and (depth[MASK] == 1.5).all() and np.isinf(depth[~MASK]).all()


def test_file_is_infinite_off_the_object(tmp_path: Path) -> None:
    values = np.tile(np.linspace(1, 2, 30), (20, 1))
    np.save(tmp_path / "d.npy", values)
    depth = object_depth(read_depth(str(tmp_path / "d.npy"), *MASK.shape), "d.npy", MASK, 9.0, NoProgress())
    assert np.allclose(depth[MASK], values[MASK]) and np.isinf(depth[~MASK]).all()
    assert typical_depth(read_depth(str(tmp_path / "d.npy"), *MASK.shape), MASK) == pytest.approx(np.median(values[MASK]))


def test_rim_takes_the_objects_own_depth(tmp_path: Path) -> None:
    values = np.full((20, 30), 7.0)
    values[MASK] = 1.0
    values[5, 8:22] = np.inf
    np.save(tmp_path / "d.npy", values)
    told: list[dict] = []
    depth = object_depth(read_depth(str(tmp_path / "d.npy"), *MASK.shape), "d.npy", MASK, 9.0, Progress(told.append))
    assert (depth[MASK] == 1.0).all() and told[0]["type"] == "warning"


@pytest.mark.parametrize("case", ["shape", "half", "empty", "text", "none", "object", "bool"])
def test_files_refused(tmp_path: Path, case: str) -> None:
    path = tmp_path / "d.npy"
    values = np.ones((20, 30))
    if case == "shape":
        np.save(path, np.ones((30, 20)))
    elif case == "half":
        values[:, 15:] = np.nan
        np.save(path, values)
    elif case == "empty":
        np.save(path, -values)
    elif case == "text":
        path.write_text("no array")
    elif case == "bool":
        np.save(path, values > 0.0)
    elif case == "object":
        np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(UsageError) as caught:
        object_depth(read_depth(str(path), *MASK.shape), "d.npy", MASK, 1.0, NoProgress())
    assert caught.value.hint


@pytest.mark.parametrize("content", [b"", b"garbage", b"PK\x03\x04garbage"])
def test_a_file_that_is_no_depth(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "d.npy").write_bytes(content)
    with pytest.raises(UsageError, match="depth file"):
        object_depth(read_depth(str(tmp_path / "d.npy"), *MASK.shape), "d.npy", MASK, 1.0, NoProgress())


def test_noise_is_no_depth() -> None:
    noise = np.random.default_rng(2).uniform(0.1, 1e4, MASK.shape).astype(np.float32)
    with pytest.raises(UsageError, match="from pixel to pixel"):
        object_depth(noise, "d.npy", MASK, 1.0, NoProgress())
    tilted = np.broadcast_to(np.geomspace(1.0, 3.0, MASK.shape[1]), MASK.shape).astype(np.float32)
    assert np.array_equal(object_depth(tilted, "d.npy", MASK, 1.0, NoProgress())[MASK], tilted[MASK])
