"""Reading files from outside without trusting them: what they declare is checked against what they contain before anything is allocated.

Everything here raises `OSError` if there is no regular file that can be opened (missing, a folder, a pipe, a device), and `ValueError`
with a clause such as "it is nested too deeply" for contents that cannot be used; callers add the file's name and the advice.
No reader executes anything, waits for a pipe, or takes more memory than its limit.
"""

from __future__ import annotations

import dataclasses
import errno
import json
import math
import os
import re
import stat
import tomllib
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy

LARGEST_TEXT = 256 * 2**20
"""Bytes of a JSON, TOML or OBJ file, at most: a camera with a matrix in each of 100,000 frames takes 40 MB."""

DEEPEST = 32
"""Levels of nesting, at most; our own files have up to six."""

_LONG_KEY = re.compile(r"(?:[A-Za-z0-9_-]+[ \t]*\.[ \t]*){1000}")
"""A dotted key, far longer than in any file of ours. The memory of Python's TOML reader grows with the square of its number of parts."""

LARGEST_ARRAYS = 2 * 2**30
"""Bytes that the arrays of a user's file may take in memory: 600 particles in 100,000 frames take 1.4 GB."""

LARGEST_TAKE = 16 * 2**30
"""Bytes that the arrays of a take's file may take in memory; it has a mask for every frame of the clip."""

DEFLATED = 1032
"""Largest compression ratio of deflate."""

KINDS = "biufU"
"""Types of array that are read: booleans, numbers and text. None of them needs pickle."""

_DAMAGED = (ValueError, TypeError, EOFError, SyntaxError, RuntimeError, zipfile.BadZipFile, zlib.error, OverflowError)
"""What NumPy and the standard library raise for an archive that is truncated or garbled; RuntimeError: it has a password."""


class EmptyFile(ValueError):
    """A file without any bytes."""


def regular(path: str | os.PathLike[str]) -> int:
    """Size [bytes] of the file `path`; links are followed.

    Raises:
        OSError: there is nothing, or not a regular file: opening a pipe or a device may wait for ever.
        EmptyFile: the file is empty; ValueError: a path with a NUL character.
    """
    found = os.stat(path)
    if not stat.S_ISREG(found.st_mode):
        kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
        raise OSError(errno.EINVAL, f"it is {kinds.get(stat.S_IFMT(found.st_mode), 'a device')}, not a file", str(path))
    if found.st_size == 0:  # also what the system only presents as files, such as those in /proc
        raise EmptyFile("it is empty")
    return found.st_size


def read_text(path: str | os.PathLike[str]) -> str:
    """The UTF-8 text of a file, without the byte order mark of Windows editors; bytes that are not UTF-8 are replaced."""
    size = regular(path)
    if size > LARGEST_TEXT:
        raise ValueError(f"it is larger than any such file, {size / 1e6:.0f} MB")
    return Path(path).read_bytes().decode("utf-8-sig", errors="replace")


def read_json(path: str | os.PathLike[str]) -> Any:
    """The value in a JSON file."""
    return parse_json(read_text(path))


def parse_json(text: str | bytes, constants: bool = True) -> Any:
    """The value in JSON text; NaN and infinities are accepted only with `constants`. Raises ValueError."""
    return _sane(json.loads if constants else lambda text: json.loads(text, parse_constant=_no_constant), text)


def _no_constant(name: str) -> float:
    raise ValueError(f"it holds {name}, which is not a number")


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The tables of a TOML file."""
    text = read_text(path)
    if _LONG_KEY.search(text):
        raise ValueError("it is nested too deeply")
    return _sane(tomllib.loads, text)


def _sane(parse: Any, text: str | bytes) -> Any:
    """The result of `parse` on the text; refuses what only a hostile file has: deep nesting, and whole numbers beyond 64 bits."""
    try:
        values = parse(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except ValueError as error:
        if "integer string" in str(error):  # Python's own message suggests raising a limit
            raise ValueError("it holds a number of thousands of digits") from None
        raise
    level, depth = [values], 0
    while level:
        depth += 1
        if depth > DEEPEST:
            raise ValueError("it is nested too deeply")
        if any(isinstance(one, int) and one.bit_length() > 63 for one in level):
            raise ValueError("it holds a whole number beyond 64 bits")
        level = [inner for one in level if isinstance(one, (dict, list)) for inner in (one.values() if isinstance(one, dict) else one)]
    return values


def read_array(path: str | os.PathLike[str]) -> np.ndarray:
    """The array in an NPY file; it may take `LARGEST_ARRAYS` bytes."""
    size = regular(path)
    try:
        with open(path, "rb") as file:
            _check(file, size, LARGEST_ARRAYS)
            file.seek(0)
            return npy.read_array(file, allow_pickle=False)
    except _DAMAGED as error:
        raise ValueError(_clause(error, "an NPY array")) from error
    except MemoryError:
        raise ValueError("there is not enough memory for it") from None


def read_arrays(path: str | os.PathLike[str], keys: Collection[str] | None = None, limit: int = LARGEST_ARRAYS) -> dict[str, np.ndarray]:
    """The arrays in an NPZ file by their names, only those in `keys` if given; together they may take `limit` bytes."""
    size, at = regular(path), ""
    arrays: dict[str, np.ndarray] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if len({member.filename for member in members}) < len(members):
                raise ValueError("it holds two arrays of one name")
            for member in members:
                name = member.filename.removesuffix(".npy")
                if keys is not None and name not in keys:
                    continue
                at = f"{name}: "
                if member.file_size > DEFLATED * min(member.compress_size, size) + 1024:
                    raise ValueError(f"it declares {member.file_size / 1e9:.3g} GB, which its {size} bytes cannot hold")
                with archive.open(member) as file:
                    limit -= _check(file, member.file_size, limit)
                with archive.open(member) as file:
                    arrays[name] = npy.read_array(file, allow_pickle=False)
                    file.read(1)  # reaching the end makes the archive compare its check sum
    except _DAMAGED as error:
        raise ValueError(at + _clause(error, "an NPZ archive")) from error
    except MemoryError:
        raise ValueError(f"{at}there is not enough memory for it") from None
    return arrays


def array_names(path: str | os.PathLike[str]) -> list[str]:
    """Names of the arrays in an NPZ file; the arrays are not read."""
    regular(path)
    try:
        with zipfile.ZipFile(path) as archive:
            return [name.removesuffix(".npy") for name in archive.namelist()]
    except _DAMAGED as error:
        raise ValueError(_clause(error, "an NPZ archive")) from error


def _check(file: IO[bytes], size: int, limit: int) -> int:
    """Bytes of the NPY array that begins here, in a file of `size` bytes; only its header is read.

    Raises:
        ValueError: a type that is not read, or a declared size larger than the file or beyond `limit`.
    """
    try:
        version = npy.read_magic(file)
    except ValueError:
        raise ValueError("it is not an array") from None
    if version not in ((1, 0), (2, 0)):
        raise ValueError("it holds a structure, not plain numbers")
    read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    try:
        shape, _, dtype = read(file)
    except Exception:  # NumPy parses it as Python literals, which may raise anything
        raise ValueError("its header is damaged") from None
    if dtype.kind not in KINDS:
        raise ValueError(f"it holds {dtype}, not plain numbers")
    if any(not isinstance(length, int) or isinstance(length, bool) or length < 0 for length in shape):
        raise ValueError(f"it declares the shape {shape}")
    declared = math.prod(shape) * max(dtype.itemsize, 1)
    if declared > limit:
        raise ValueError(f"it declares {declared / 1e9:.3g} GB (shape {shape}), more than the {limit / 1e9:.3g} GB that are read")
    if declared > size:
        raise ValueError(f"it declares {declared} bytes (shape {shape}), and has {size}")
    return declared


def _clause(error: BaseException, what: str) -> str:
    """The message for a damaged file, on one line; without NumPy's advice on pickles, which are never read here."""
    text = " ".join(str(error).split())
    if "pickle" in text or "Object arrays" in text or isinstance(error, zipfile.BadZipFile) or not text:
        return f"it is not {what} of plain numbers" + ("" if "pickle" in text or not text else f" ({text})")
    return text[:200]


# -- records ----------------------------------------------------------------------------------------------------------------------

SHAPES: dict[str, dict[str, str]] = {
    "Observation": {
        "camera.camera_to_world": "... 4 4", "image": "H W 3", "background": "H W 3", "depth": "H W", "pin": "H W",
        "xy": "P K 2", "visible": "P K", "sigma": "P K", "on_centroid": "K",
        "doubts.severity": "D", "recognised.frame": "R", "recognised.first": "R 2", "recognised.xy": "R 2",
    },
    "Body": {
        "particles.x": "N 3", "particles.volume": "N", "particles.pinned": "N", "particles.stiffness": "N", "gaussians.x": "G 3",
        "particles.mixture.density": "N", "particles.mixture.youngs_modulus": "N", "particles.mixture.poisson_ratio": "N",
        "particles.mixture.retardation": "N",
        "gaussians.scale": "G 3", "gaussians.rotation": "G 4", "gaussians.opacity": "G", "gaussians.sh": "G B 3",
        "gaussians.attachment.index": "G J", "gaussians.attachment.weight": "G J", "surface.vertices": "V 3", "surface.triangles": "M 3",
        "surface.uv": "V 2", "surface.attachment.index": "V I", "surface.attachment.weight": "V I", "keypoints.index": "K L",
        "keypoints.weight": "K L", "lifted": "P K 3", "path": "P N 3", "path_sigma": "P N",
        "measured.x": "P N 3", "measured.modes": "N R", "measured.covariance": "P R 3 R 3",
    },
    "Recovery": {
        "force_density": "T N 3", "deviation": "T N 3", "x": "P N 3", "F": "P N 3 3", "v0": "N 3", "residual": "P", "stiffness": "N",
        "section": "2", "section_axes": "2 3", "held_covariance": "4 4", "wild": "T", "borne": "3",
    },
}  # fmt: skip
"""Shapes of the arrays in the records of a take; a letter stands for the same number everywhere in a record."""

FINITE = {
    "Body": ("particles.x", "particles.volume", "particles.mixture.density", "particles.mixture.youngs_modulus",
             "particles.mixture.poisson_ratio", "particles.mixture.retardation", "surface.vertices", "path", "path_sigma", "measured.x",
             "measured.modes", "measured.covariance"),
    "Recovery": ("force_density", "x", "F", "v0", "section", "section_axes", "held_covariance"),
}
"""Arrays that must be finite in an undamaged take."""

POINTS_AT = {"surface.triangles": "V", "surface.attachment.index": "N", "gaussians.attachment.index": "N", "keypoints.index": "N"}
"""Arrays of indices, and the letter of the length that bounds them."""


def check_record(record: Any) -> None:
    """Check the arrays of a record of `records` against each other. Raises ValueError for shapes, indices or values that do not fit."""
    kind, lengths = type(record).__name__, dict[str, int]()
    for name, letters in SHAPES.get(kind, {}).items():
        array = _member(record, name)
        if array is None:
            continue
        names = letters.split()
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf":
            raise ValueError(f"{name} does not hold numbers")
        lengths_of = array.shape[-len(names) + 1 :] if names[0] == "..." else array.shape
        names = names[1:] if names[0] == "..." else names
        wanted = [int(one) if one.isdigit() else lengths.setdefault(one, length) for one, length in zip(names, lengths_of)]
        if len(lengths_of) != len(names) or list(lengths_of) != wanted:
            raise ValueError(f"{name} has the shape {array.shape}, which does not fit the rest")
        if name in FINITE.get(kind, ()) and not np.isfinite(array).all():
            raise ValueError(f"{name} holds numbers that are not finite")
    for name, letter in POINTS_AT.items():
        if letter in lengths and name in SHAPES.get(kind, {}):
            index = _member(record, name)
            if index.size and (index.dtype.kind not in "iu" or index.min() < 0 or index.max() >= lengths[letter]):
                raise ValueError(f"{name} has indices that are out of range")


def _member(record: Any, name: str) -> Any:
    for part in name.split("."):
        if not dataclasses.is_dataclass(record):
            return None
        record = getattr(record, part)
    return record
