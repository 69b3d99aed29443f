"""Files from outside: what they declare is checked before anything is allocated, and every refusal is one clause."""

from __future__ import annotations

import dataclasses
import io
import os
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from seeing_wind.engine.reading import (
    DEEPEST,
    array_names,
    check_record,
    parse_json,
    read_array,
    read_arrays,
    read_json,
    read_toml,
    regular,
)  # fmt: skip
from seeing_wind.engine.record_arrays import recovery_of, to_arrays
from seeing_wind.engine.records import Outcome, Recovery


def declaring(shape: str, dtype: str = "'<f8'", data: bytes = b"\0" * 64) -> bytes:
    text = f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (63 - (len(text) + 10) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


@pytest.mark.parametrize("text", ["[" * 200_000, '{"a":' * 200_000, "[" * (DEEPEST + 1) + "]" * (DEEPEST + 1), "9" * 5000, "9" * 30, "{"])
def test_json_that_only_a_hostile_file_holds(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ValueError):
        read_json(tmp_path / "a.json")


@pytest.mark.parametrize("text", ["a = " + "[" * 200_000, "a = " + "9" * 5000, "a = " + "9" * 30, "a = ", "\0", "a.b." * 50_000 + "c = 1"])
def test_toml_that_only_a_hostile_file_holds(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(ValueError):
        read_toml(tmp_path / "a.toml")


def test_what_is_sound_is_read(tmp_path: Path) -> None:
    nested = "[" * DEEPEST + "]" * DEEPEST
    assert parse_json('{"a": [1, 2.5, null, NaN]}')["a"][:3] == [1, 2.5, None] and parse_json(nested)
    with pytest.raises(ValueError, match="NaN"):
        parse_json("[NaN]", constants=False)
    arrays = {"x": np.arange(12.0).reshape(3, 4), "said": np.array("text"), "none": np.zeros((0, 3)), "sure": np.array(True)}
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    found = read_arrays(tmp_path / "a.npz")
    assert set(found) == set(arrays) == set(array_names(tmp_path / "a.npz"))
    assert all((found[key] == arrays[key]).all() and found[key].dtype == arrays[key].dtype for key in arrays)
    assert set(read_arrays(tmp_path / "a.npz", ("x", "y"))) == {"x"}
    np.save(tmp_path / "a.npy", np.asfortranarray(arrays["x"]))
    assert (read_array(tmp_path / "a.npy") == arrays["x"]).all()


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (declaring("(6, 42000000, 3)"), "declares 6.05 GB"),
        (declaring("(1000000000000,)"), "more than the 2.15 GB"),
        (declaring("(1000,)"), "declares 8000 bytes .* and has 192"),
        (declaring("(-5,)"), "shape"),
        (declaring("(8,)", "'|O'"), "object, not plain numbers"),
        (declaring("(1000000000,)", "'<U0'"), "declares"),
        (declaring("(8,)", "[('a', '<f8')]"), "not plain numbers"),
        (declaring("(" * 4000), "header is damaged"),
        (b"garbage, and more of it", "not an array"),
        (b"", "empty"),
    ],
)
def test_an_array_that_lies_about_itself(tmp_path: Path, content: bytes, says: str) -> None:
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(ValueError, match=says):
        read_array(tmp_path / "a.npy")
    if content:
        with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
            archive.writestr("x.npy", content)
        with pytest.raises(ValueError, match=f"x: .*{says}"):
            read_arrays(tmp_path / "a.npz")


def test_an_archive_that_unpacks_to_more_than_it_may(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", x=np.zeros(1_000_000), y=np.zeros(1_000_000))
    assert (tmp_path / "a.npz").stat().st_size < 50_000
    assert len(read_arrays(tmp_path / "a.npz", limit=16_000_000)) == 2
    with pytest.raises(ValueError, match="y: it declares"):
        read_arrays(tmp_path / "a.npz", limit=15_999_999)


def test_an_archive_with_a_wrong_sum_or_a_lying_directory(tmp_path: Path) -> None:
    content = io.BytesIO()
    np.savez(content, x=np.arange(100.0))
    data = bytearray(content.getvalue())
    data[400] ^= 1
    (tmp_path / "a.npz").write_bytes(data)
    with pytest.raises(ValueError, match="x: .*CRC"):
        read_arrays(tmp_path / "a.npz")
    data[400] ^= 1
    at = data.rindex(b"PK\x01\x02")
    data[at + 24 : at + 28] = struct.pack("<I", 0xFFFFFFF0)
    (tmp_path / "a.npz").write_bytes(data)
    with pytest.raises(ValueError, match="x: it declares 4.29 GB, which its"):
        read_arrays(tmp_path / "a.npz")


def test_only_regular_files_are_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "ring").symlink_to("ring")
    for path, says in ((tmp_path / "pipe", "a pipe"), (tmp_path, "a folder"), (Path("/dev/zero"), "a device")):
        with pytest.raises(OSError, match=says):
            regular(path)
    for path in (tmp_path / "none", tmp_path / "ring", tmp_path / ("a" * 300)):
        with pytest.raises(OSError):
            regular(path)
    with pytest.raises(ValueError):
        regular("a\0b")


def recovery(**changes: np.ndarray) -> Recovery:
    x = np.zeros((4, 5, 3))
    sound = Recovery(
        Outcome.CONVERGED, x[:3], x[:3], x, np.zeros((4, 5, 3, 3)), x[0], np.zeros(4), "m", 1, 0.1, stiffness=np.ones(5)
    )
    return dataclasses.replace(sound, **changes)


def test_a_take_from_before_each_component_had_a_deviation_is_read() -> None:
    arrays = to_arrays(recovery())
    arrays["deviation"] = np.arange(15.0).reshape(3, 5)
    read = recovery_of(arrays).deviation
    assert read.shape == (3, 5, 3)
    assert (read == np.arange(15.0).reshape(3, 5, 1)).all()


def test_records_whose_arrays_contradict_each_other() -> None:
    check_record(recovery())
    for changes, says in (
        ({"v0": np.zeros((3, 3))}, "v0 has the shape"),
        ({"stiffness": np.ones(4)}, "stiffness has the shape"),
        ({"F": np.full((4, 5, 3, 3), np.nan)}, "F holds numbers that are not finite"),
        ({"residual": np.array(["a"] * 4)}, "residual does not hold numbers"),
    ):
        with pytest.raises(ValueError, match=says):
            check_record(recovery(**changes))
