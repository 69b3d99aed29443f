"""Hostile inputs: each family breaks one sound input in one way that Hypothesis and a seeded generator choose, and says how to call."""

from __future__ import annotations

import io
import json
import os
import random
import shutil
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from hypothesis import strategies as st

from seeing_wind.engine.take import toml_text

from .seeds import FPS, FRAMES, HEIGHT, WIDTH, blown

EXTREMES = (0, 1, -1, 2**31, 2**63, -(2**63), 10**400, 1e300, -1e300, 1e-300, float("nan"), float("inf"), -float("inf"), 0.5, True, "", "a")
VALUES = st.recursive(
    st.sampled_from(EXTREMES) | st.none() | st.text(max_size=8) | st.floats() | st.integers(-(10**20), 10**20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)
"""Anything that JSON or TOML can say in the place of what is wanted."""

Family = Callable[[random.Random, Any, Path], list[Any]]

RECOVER = ["recover", "clip.avi", "--take", "o.take", "--distance", 2, "--iterations", 1, "--representation", "point", "--fps", FPS]
SOLVE = ["recover-trajectories", "t.npz", "--take", "o.take", "--iterations", 1, "--representation", "point"]
SAMPLE = ["sample", "whole.take", "--points", "p.npy", "--frame", 0, "--out", "o.npz"]
EXPORT = ["export", "whole.take", "--format", "npz", "--out", "o.npz"]
SIMULATE = ["resimulate", "whole.take", "--edit", "edit.toml", "--take", "o.take"]
LOOK = ["identify", "clip.avi", "--take", "o.take", "--material-endpoint", "http://127.0.0.1:9/v1", "--material-model", "none"]
"""Reads the clip's first frames, and then finds that nobody answers."""
STOP = ["--camera", "none.json"]
"""Ends a recovery after its clip, depth and mask were read: the solve is not what is tried there."""


def call_for(name: str) -> list[Any]:
    """The cheapest call that reads the file `name`."""
    calls = {
        "camera.json": [*RECOVER, "--mask", "mask.png", "--camera", "camera.json"], "depth.npy": [*RECOVER[:4], "--mask", "mask.png",
        "--depth", "depth.npy", "--fps", FPS, *STOP], "tracks.npz": [*RECOVER, "--mask", "mask.png", "--tracks", "tracks.npz"],
        "t.npz": SOLVE, "p.npy": SAMPLE, "edit.toml": SIMULATE, "mesh.obj": SIMULATE, "mesh.npz": SIMULATE, "pins.npy": SIMULATE,
        "mask.png": [*RECOVER, "--mask", "mask.png", *STOP], "pin.png": [*RECOVER, "--mask", "mask.png", "--pin", "pin.png"],
        "clip.avi": LOOK, "objects.json": [*RECOVER, "--objects", "objects.json"],
    }  # fmt: skip
    return calls[name]


READERS = ("camera.json", "depth.npy", "tracks.npz", "t.npz", "p.npy", "edit.toml", "mesh.npz", "mesh.obj", "pins.npy", "mask.png",
           "pin.png", "clip.avi", "objects.json")  # fmt: skip
ARRAYS = ("tracks.npz", "t.npz", "mesh.npz", "depth.npy", "p.npy", "pins.npy")
TAKE_FILES = ("field.safetensors", "particles.npz", "trajectory.npz")


def _edit_with(folder: Path, mesh: str) -> None:
    text = (folder / "edit.toml").read_text()
    (folder / "edit.toml").write_text(text.replace("mesh.obj", mesh))


def prepared(name: str, folder: Path) -> list[Any]:
    """The call that reads `name`, an edit's mesh made to be it."""
    if name == "mesh.npz":
        _edit_with(folder, name)
    return call_for(name)


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


def png(width: int, height: int, data: bytes = b"", depth: int = 8) -> bytes:
    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, depth, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")


def pictures_say(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    """Masks and frames of one pixel, of 1 x 20000, of a thousand million, of another kind than their name says, or none at all."""
    width, height = chance.choice(
        [(1, 1), (20_000, 1), (1, 20_000), (30_000, 30_000), (2**31 - 1, 1), (2**31 - 1, 2**31 - 1), (0, 0), (WIDTH, HEIGHT)]
    )
    small = width * height <= 20_000
    if chance.random() < 0.4:
        (folder / "mask.png").write_bytes(png(width, height, b"\0" * (height * (width + 1)) if small else b"\0" * 1000))
        return call_for("mask.png")
    shutil.rmtree(folder / "frames")
    (folder / "frames").mkdir()
    ending = chance.choice(["png", "png", "png", "bmp", "tif", "webp", "jpg", "exr"])
    for t in range(chance.choice([0, 1, FRAMES])):
        target = folder / f"frames/{t:03d}.{ending}"
        if small and width and ending != "exr":
            cv2.imwrite(str(target), np.full((height, width, 3), 90 + t, np.uint8))
        else:
            target.write_bytes(png(width, height, b"\0" * 1000))
    return [*RECOVER[:1], "frames", *RECOVER[2:], *chance.choice([["--mask", "mask.png"], ["--box", 0, 0, 1, 1], []]), *STOP]


def ranges_say(chance: random.Random, value: Any, folder: Path) -> list[Any]:
    """Options out of range, and a clip of 100,000 frames that are all one file."""
    if chance.random() < 0.03:
        for t in range(FRAMES, 100_000):
            (folder / f"frames/{t:06d}.png").symlink_to("000.png")
        return [*RECOVER[:1], "frames", *RECOVER[2:], "--frames", "99000:99999", "--mask", "mask.png", *STOP]
    more = chance.choice(
        [["--frames", "0:100000"], ["--frames", "5:5"], ["--box", 1e308, -1e308, 1e308, 1e308], ["--box", -1e308, -1e308, 1e308, 1e308],
         ["--points", "1e308,1e308"], ["--points", "nan,1"], ["--distance", 1e-300], ["--pixels-per-metre", 1e300], ["--fov", 1e-300],
         ["--density", 1e300], ["--youngs-modulus", 1e-300], ["--fps", 1e300], ["--particles", 10**9], ["--seed", -1],
         ["--mask", "a" * 5000], ["--material", "a" * 5000], ["--view", "clip.avi", "none.json", "mask.png"], ["--law", "von_mises"],
         ["--frames", f"{'9' * 5000}:1"], ["--gravity", "1e999", 0, 0], ["--depth", "p.npy"], ["--tracks", "t.npz"], ["--camera", "t.npz"]]
    )  # fmt: skip
    return [*RECOVER[:4], "--iterations", 1, *([] if more[0] in ("--mask", "--box", "--points") else ["--mask", "mask.png"]), *more,
            *([] if more[0] in ("--camera", "--fov") else STOP)]  # fmt: skip


FAMILIES: tuple[Family, ...] = (
    flipped, flipped, flipped_take, field_says, tensors_lie, headers_lie, arrays_say, camera_says, objects_say, edit_says, no_files,
    no_take,
    pictures_say, ranges_say,
)  # fmt: skip
