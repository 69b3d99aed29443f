"""Hostile frames, clips and options: families of `inputs`."""

from __future__ import annotations

import random
import shutil
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from .calls import RECOVER, STOP, call_for
from .seeds import FRAMES, HEIGHT, WIDTH


def png(width: int, height: int, data: bytes = b"", depth: int = 8) -> bytes:
    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, depth, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")


def images_say(chance: random.Random, value: Any, folder: Path) -> list[Any]:
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
