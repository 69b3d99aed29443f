"""Clips that are many pictures: a folder, or a pattern of names like shot_%04d.png or shot_*.png."""

from __future__ import annotations

import re
from pathlib import Path

PICTURE_SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".exr"}


def is_sequence(path: str) -> bool:
    """Whether a path names many pictures and no file."""
    return Path(path).is_dir() or "*" in path or re.search(r"%0?\d*d", Path(path).name) is not None


def pictures_of(path: str) -> list[Path]:
    """The files of a sequence, ordered by the numbers in their names; none where there are none."""
    place = Path(path)
    if place.is_dir():
        files = [file for file in place.iterdir() if file.suffix.lower() in PICTURE_SUFFIXES]
    elif "*" in path:
        files = list(place.parent.glob(place.name)) if place.parent.is_dir() else []
    else:
        name = re.sub(r"%0?\d*d", r"(\\d+)", re.sub(r"([.()\[\]+])", r"\\\1", place.name))
        files = [file for file in place.parent.glob("*") if re.fullmatch(name, file.name)] if place.parent.is_dir() else []
    return sorted(files, key=lambda file: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)])
