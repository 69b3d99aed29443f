"""The files of a clip, and whether two paths lead to the same film. Without bpy, since `takes`, which `clips` imports, uses it too."""

from __future__ import annotations

import functools
import hashlib
import os
import re
from pathlib import Path

from ....engine.conventions import IMAGE_SUFFIXES, image_files, is_sequence

IMAGES = {*IMAGE_SUFFIXES, ".dpx"}
PIECES, PIECE = 16, 4096
"""Number of pieces of a file in its digest, and bytes of each piece."""


def as_pattern(path: str) -> str:
    """For an image of a numbered sequence, the pattern of the sequence, which the engine reads; any other path unchanged."""
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
    """The files of a clip in order: the video itself, or the images that the engine reads for a folder, pattern or image."""
    pattern = as_pattern(path)
    return (image_files(pattern) if is_sequence(pattern) else []) or [Path(path)]


def opened_by(path: str) -> str:
    """The path by which Blender opens a clip: for a sequence, its first image, from which the engine counts too."""
    return str(files_of(path)[0])


def is_another_film(path: str, than: str) -> bool:
    """Whether two paths lead to different films.

    A copy is the same film. So is a moved one: its name is the same, and at least one of the two files no longer exists.
    """
    one, other = opened_by(path), opened_by(than)
    if os.path.realpath(one) == os.path.realpath(other):
        return False
    if os.path.isfile(one) and os.path.isfile(other):
        return content_of(one) != content_of(other)
    return os.path.basename(as_pattern(path)) != os.path.basename(as_pattern(than))


def content_of(path: str | os.PathLike[str]) -> str:
    """Digest of a file for use in a digest of settings: of pieces spread over its content, not its date, which a copy may not keep.

    Reading whole files, as the engine does before it calls a stage done, would be too slow for a panel that is redrawn at every change.

    Raises:
        OSError: when the file does not exist.
    """
    entry = os.stat(path)
    return _pieces(os.fspath(path), entry.st_size, entry.st_mtime_ns)


@functools.lru_cache(maxsize=1 << 14)
def _pieces(path: str, size: int, changed: int) -> str:
    """Digest of the pieces, cached until size or modification time `changed` differ. An unreadable file is left for a job to report."""
    digest = hashlib.sha256(str(size).encode())
    try:
        with open(path, "rb") as file:
            for number in range(PIECES):
                file.seek(max(size - PIECE, 0) * number // (PIECES - 1))
                digest.update(file.read(PIECE))
    except OSError:
        digest.update(str(changed).encode())
    return digest.hexdigest()[:16]
