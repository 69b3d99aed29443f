"""The files of a clip, and which of them are one film. Without bpy: the takes ask too, on which the movie clips of a scene stand."""

from __future__ import annotations

import functools
import hashlib
import os
import re
from pathlib import Path

from ....engine.conventions import IMAGE_SUFFIXES, image_files, is_sequence

IMAGES = {*IMAGE_SUFFIXES, ".dpx"}
PIECES, PIECE = 16, 4096
"""Of a file, by which a changed one is known from a copy, and bytes of each."""


def as_pattern(path: str) -> str:
    """The path of a video as it is; that of one image of a sequence as the pattern of all, which the engine reads."""
    place = Path(path)
    if place.suffix.lower() not in IMAGES or "%" in place.name or "*" in place.name:
        return path
    numbers = list(re.finditer(r"\d+", place.stem))
    if not numbers:
        return path
    last = numbers[-1]
    pattern = f"{place.stem[: last.start()]}%0{len(last.group())}d{place.stem[last.end() :]}{place.suffix}"
    return str(place.with_name(pattern))


def files_of(path: str) -> list[Path]:
    """The files of a clip in their order: the video itself, or the images that the engine reads for a folder, pattern or image."""
    pattern = as_pattern(path)
    return (image_files(pattern) if is_sequence(pattern) else []) or [Path(path)]


def opened_by(path: str) -> str:
    """The path by which Blender opens a clip: a sequence by its first frame, from which the engine counts too."""
    return str(files_of(path)[0])


def is_another_film(path: str, than: str) -> bool:
    """Whether two paths lead to different films.

    A film that was copied is no other one, nor is one that was moved: it has its name, and there is none any more where it was.
    """
    one, other = opened_by(path), opened_by(than)
    if os.path.realpath(one) == os.path.realpath(other):
        return False
    if os.path.isfile(one) and os.path.isfile(other):
        return content_of(one) != content_of(other)
    return os.path.basename(as_pattern(path)) != os.path.basename(as_pattern(than))


def content_of(path: str | os.PathLike[str]) -> str:
    """What stands for a file in a digest of settings: pieces spread over its content, whatever its date, which a copy may not keep.

    The engine reads files whole before it calls a stage done; a panel that is drawn at every change cannot.

    Raises:
        OSError: it is not there.
    """
    entry = os.stat(path)
    return _pieces(os.fspath(path), entry.st_size, entry.st_mtime_ns)


@functools.lru_cache(maxsize=1 << 14)
def _pieces(path: str, size: int, changed: int) -> str:
    """Read once as long as the file is not written to, which `changed` tells. A job says what is wrong with one that cannot be read."""
    digest = hashlib.sha256(str(size).encode())
    try:
        with open(path, "rb") as file:
            for number in range(PIECES):
                file.seek(max(size - PIECE, 0) * number // (PIECES - 1))
                digest.update(file.read(PIECE))
    except OSError:
        digest.update(str(changed).encode())
    return digest.hexdigest()[:16]
