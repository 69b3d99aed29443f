"""Hostile inputs: each family breaks one sound input in one way that Hypothesis and a seeded generator choose, and says how to call."""

from __future__ import annotations

import io
import json
import os
import random
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from seeing_wind.engine.settings import toml_text

from .calls import ARRAYS, EXPORT, READERS, RECOVER, SAMPLE, SIMULATE, SOLVE, STOP, TAKE_FILES, prepared
from .images import images_say, ranges_say
from .seeds import blown

EXTREMES = (0, 1, -1, 2**31, 2**63, -(2**63), 10**400, 1e300, -1e300, 1e-300, float("nan"), float("inf"), -float("inf"), 0.5, True, "", "a")
VALUES = st.recursive(
    st.sampled_from(EXTREMES) | st.none() | st.text(max_size=8) | st.floats() | st.integers(-(10**20), 10**20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)
"""Anything that JSON or TOML can say in the place of what is wanted."""

Family = Callable[[random.Random, Any, Path], list[Any]]

def garbled(data: bytes, chance: random.Random) -> bytes:
    """Bytes flipped, cut out, doubled, or the file cut short."""
    raw = bytearray(data)
    way = chance.randrange(4)
    if way == 0 or len(raw) < 8:
        for _ in range(chance.randint(1, 30)):
            raw[chance.randrange(max(len(raw), 1))] ^= chance.randint(1, 255)
        return bytes(raw)
    at, size = chance.randrange(len(raw)), chance.randint(1, max(1, len(raw) // 4))
    if way == 1:
        return bytes(raw[:at])
    return bytes(raw[:at] + raw[at + size :]) if way == 2 else bytes(raw[:at] + raw[at : at + size] * 2 + raw[at + size :])


def flipped(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    name = chance.choice(READERS)
    path = folder / name
    path.write_bytes(garbled(path.read_bytes(), chance))
    call = prepared(name, folder)
    # What is still sound is not solved a hundred times.
    return [*call, *STOP] if call[0] == "recover" and "--camera" not in call else call


def flipped_take(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    path = folder / "whole.take" / chance.choice(TAKE_FILES)
    path.write_bytes(garbled(path.read_bytes(), chance))
    (folder / "edit.toml").write_text('[[body]]\nname = "thing"\nmesh = "recovered"\n')
    return chance.choice((SAMPLE, EXPORT)) if path.suffix == ".safetensors" else SIMULATE


def field_says(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    """Metadata of a field that states something else than its tensors."""
    path = folder / "whole.take/field.safetensors"
    data = path.read_bytes()
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + size])
    meta = header["__metadata__"]
    key = chance.choice([*meta, "shape", "shape", "box"])
    if key == "shape":
        shape = json.loads(meta["shape"])
        shape[chance.choice(list(shape))] = chance.choice([value, 10**7, 10**9, 0, -1, [10**6] * 3, [[10**6] * 3]])
        meta["shape"] = json.dumps(shape, default=str)
    elif key == "box":
        meta["box"] = chance.choice(
            ["[[-1e308,-1e308,-1e308],[1e308,1e308,1e308]]", "[" * 200_000, json.dumps(value), "NaN", "[[0,0,0],[1,1]]"]
        )
    else:
        meta[key] = chance.choice([json.dumps(value), "1e300", "1e-300", "-1", "9" * 5000, "nan", ""])
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + data[8 + size :])
    return chance.choice((SAMPLE, EXPORT))


def tensors_lie(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    """A safetensors header that declares shapes, types or offsets that are not there."""
    path = folder / "whole.take/field.safetensors"
    data = path.read_bytes()
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + size])
    name = chance.choice([key for key in header if key != "__metadata__"])
    key = chance.choice(("shape", "dtype", "data_offsets"))
    header[name][key] = {
        "shape": chance.choice([[10**12], [2**40, 2**40], [], value]), "dtype": chance.choice(["BF16", "F64", "BOOL", "I64", "X"]),
        "data_offsets": [0, chance.choice([2**40, 2**62, -1, 1])],
    }[key]  # fmt: skip
    text = json.dumps(header, default=str).encode()
    length = chance.choice([len(text), len(text), 2**62, 10**8])
    path.write_bytes(length.to_bytes(8, "little") + text + data[8 + size :])
    return SAMPLE


def npy_bytes(shape: str, dtype: str, data: bytes = b"\0" * 64) -> bytes:
    text = f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (63 - (len(text) + 10) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


def headers_lie(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    """NPY headers that declare terabytes, negative lengths, objects, structures or nonsense; bombs that unpack to gigabytes."""
    name = chance.choice(ARRAYS)
    shape = chance.choice(
        [
            "(6, 42000000, 3)",
            "(10**13,)",
            "(1000000000000,)",
            "(-5,)",
            "(6, 10000, 10000, 300)",
            "((1,),)",
            "(" * 4000,
            "(4294967296, 4294967296)",
            "('a',)",
            "(1e9,)",
            "True",
        ]
    )
    dtype = chance.choice(["'<f8'", "'<f8'", "'<f8'", "'|O'", "'<U0'", "'|V2147483647'", "[('a', '<f8')]", "'<c16'", "'<M8[s]'", "'x'"])
    lie = npy_bytes(shape, dtype)
    if chance.random() < 0.25:  # the bytes are there, and compress to nothing
        lie = npy_bytes("(1000000000,)", "'<f8'", b"\0" * (8 << 20))
    if name.endswith(".npy"):
        (folder / name).write_bytes(lie)
        return prepared(name, folder)
    with np.load(folder / name) as sound:
        arrays = {key: sound[key] for key in sound.files}
    target = chance.choice(list(arrays)[:2])
    with zipfile.ZipFile(folder / name, "w", chance.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])) as archive:
        for key, array in arrays.items():
            content = io.BytesIO()
            np.save(content, array)
            archive.writestr(f"{key}.npy", lie if key == target else content.getvalue())
    if chance.random() < 0.3:  # the archive's own directory lies, too
        data = (folder / name).read_bytes()
        at = data.rindex(b"PK\x01\x02")
        (folder / name).write_bytes(data[: at + 24] + struct.pack("<I", 0xFFFFFFF0) + data[at + 28 :])
    return prepared(name, folder)


def arrays_say(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    """Arrays of the right kind with wrong shapes or with numbers that mean nothing."""
    name = chance.choice(ARRAYS[:3] + ("depth.npy", "p.npy"))
    if name.endswith(".npy"):
        array = np.load(folder / name).astype(float)
        array = _spoilt(array, chance)
        np.save(folder / name, array)
        return prepared(name, folder)
    with np.load(folder / name) as sound:
        arrays = {key: sound[key] for key in sound.files}
    key = chance.choice(list(arrays))
    if name == "t.npz" and chance.random() < 0.6:
        key, spoilt = chance.choice(
            [("fps", 1e300), ("fps", 1e-300), ("fps", np.nan), ("E", 1e300), ("E", 0.0), ("rho", 1e-300), ("sigma", 1e300), ("nu", 0.5),
             ("sigma", 1e-300), ("material", "unobtainium"), ("gravity", np.full(3, 1e300)), ("x", blown() + 1e8), ("x", blown()[:0]),
             ("x", blown()[:, :0]), ("x", blown() * 1e300), ("x", blown() + 50.0 * (np.arange(9) > 4)[:, None, None]),
             ("x", blown() + 1e6 * (np.arange(9) > 4)[:, None, None]), ("x", np.zeros_like(blown())),
             ("covariance", np.full((3, 3), np.inf)),
             ("yield_stress", 1e300), ("x", blown()[:3]), ("fixed", np.ones(27, bool)), ("covariance", -np.eye(3)), ("x", "text")]
        )  # fmt: skip
        arrays[key] = np.asarray(spoilt)
    else:
        arrays[key] = _spoilt(np.asarray(arrays[key], dtype=float), chance)
    np.savez(folder / name, **arrays)
    call = prepared(name, folder)
    return [*call, *STOP] if name == "tracks.npz" else call


def _spoilt(array: np.ndarray, chance: random.Random) -> np.ndarray:
    way = chance.randrange(5)
    if way == 0:
        return array[..., None]
    if way == 1:
        return array[:0] if array.ndim else np.zeros(0)
    if way == 2:
        return np.full_like(array, chance.choice([np.nan, np.inf, -1e300, 1e300]))
    if way == 3 and array.ndim:
        return array.repeat(3, axis=chance.randrange(array.ndim))
    return np.where(np.arange(array.size).reshape(array.shape) % 3 == 0, chance.choice([np.nan, 1e300, -np.inf]), array)


def camera_says(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    camera = json.loads((folder / "camera.json").read_text())
    key = chance.choice([*camera, "k1", "p2"])
    camera[key] = value
    text = json.dumps(camera)
    if chance.random() < 0.3:
        text = chance.choice(
            ["[" * 200_000, '{"a":' * 100_000, "9" * 5000, '{"width": ' + "9" * 5000 + "}", "\ufeff{}", "{", "null", '"a"', "[]"]
        )
    (folder / "camera.json").write_text(text, encoding="utf-8")
    return [*RECOVER, "--mask", "mask.png", "--camera", "camera.json"]


def objects_say(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    listed = json.loads((folder / "objects.json").read_text())
    key = chance.choice(list(listed["objects"][0]))
    listed["objects"][0][key] = chance.choice([value, "../../outside", "/etc/passwd", "a\0b", "/dev/zero"])
    text = json.dumps(chance.choice([listed, listed, {"objects": value}, value]))
    (folder / "objects.json").write_text("[" * 200_000 if chance.random() < 0.1 else text)
    return [*RECOVER, "--objects", "objects.json", *STOP]


def edit_says(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    body: dict[str, Any] = {"name": "thing", "mesh": "mesh.obj", "material": "rubber"}
    edit: dict[str, Any] = {"body": [body]}
    key = chance.choice(
        ["name", "mesh", "material", "density", "youngs_modulus", "mass", "mass_scale", "pin", "velocity", "start_frame", "nonsense"]
    )
    hostile = {
        "name": ["a\0b", "../x", "/abs", "a" * 300, "CON", "", ".", "x\n", "\u202e"],
        "mesh": ["../../../etc/passwd", "/dev/zero", "a\0.obj", "."],
        "pin": ["/dev/zero", "none.npy", "mesh.obj", "a\0"], "density": [1e300, -1.0, float("nan")], "youngs_modulus": [1e300, 0.0],
        "mass": [1e300, 1e-300, 0.0], "mass_scale": [1e300, 0.0, float("inf")], "velocity": [[1e300] * 3, [0.0], [float("nan")] * 3],
        "start_frame": [10**9, -1, 2**70], "material": ["unobtainium", ""], "nonsense": [1],
    }[key]  # fmt: skip
    body[key] = chance.choice([*hostile, _plain(value)])
    whole: list[dict[str, Any]] = [
        {"gravity": [1e300] * 3}, {"field_strength": 1e300}, {"field_strength": [1.0]},
        {"collider": [{"name": "w", "plane": [0, 0, -1, 0, 0, 1], "kind": "x"}]},
        {"collider": [{"name": "w", "plane": [1e300] * 6}]}, {"gravity": _plain(value)}, {"body": _plain(value)}, {"contact": "yes"},
    ]  # fmt: skip
    if chance.random() < 0.3:
        body.update(name="thing", mesh="mesh.obj")
        edit |= chance.choice(whole)
    text = toml_text(edit)
    if chance.random() < 0.15:
        text = chance.choice(
            ["a = " + "[" * 200_000, "a = " + "9" * 5000, "[[body]]\n" * 3, "a.b." * 50_000 + "c = 1", "\0", "a = {b = " * 5000]
        )
    (folder / "edit.toml").write_text(text, encoding="utf-8", errors="replace")
    return SIMULATE


def _plain(value: Any) -> Any:
    """A value as TOML can say it."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [item for item in map(_plain, value) if not isinstance(item, dict)]
    return "none" if value is None else value


def no_files(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    """Pipes, devices, folders, links that go in a ring or nowhere, and nothing at all, where a file is wanted."""
    name = chance.choice(READERS)
    path = folder / name
    path.unlink()
    way = chance.randrange(9)
    if way == 0:
        os.mkfifo(path)
    elif way == 1:
        path.mkdir()
    elif way < 7:
        path.symlink_to(("/dev/zero", "/dev/urandom", name, "../../nowhere", "/proc/self/mem")[way - 2])
    elif way == 7:
        path.touch()
    return prepared(name, folder)


def no_take(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    """The same for the files of a take, and results where they cannot go."""
    if chance.random() < 0.6:
        path = folder / "whole.take" / chance.choice(TAKE_FILES)
        path.unlink()
        chance.choice(
            [lambda: os.mkfifo(path), path.mkdir, lambda: path.symlink_to("/dev/zero"), path.touch, lambda: path.symlink_to(path.name)]
        )()
        (folder / "edit.toml").write_text('[[body]]\nname = "thing"\nmesh = "recovered"\n')
        return chance.choice((SAMPLE, EXPORT, SIMULATE))
    (folder / "file").write_text("a file")
    place = chance.choice(["a" * 300, "file/x", "file/x", "/dev/null", "/proc/x", "/dev/null/x", "b/" * 200 + "c" * 250])
    call = list(chance.choice((SAMPLE, EXPORT, SIMULATE, SOLVE)))
    option = "--out" if "--out" in call else "--take"
    if call[0] == "recover-trajectories":
        (folder / "t.npz").unlink()
    call[call.index(option) + 1] = place
    return call


FAMILIES: tuple[Family, ...] = (
    flipped, flipped, flipped_take, field_says, tensors_lie, headers_lie, arrays_say, camera_says, objects_say, edit_says, no_files,
    no_take,
    images_say, ranges_say,
)  # fmt: skip
