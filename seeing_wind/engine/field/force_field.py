"""The interface of every force field: sampling forces, gradients and confidence, and saving without pickle."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from safetensors.numpy import save

from ..conventions import FARTHEST, FRAME_RATES, in_units
from ..errors import TakeError, UsageError

if TYPE_CHECKING:
    from .confidence import ConfidenceMap

VERSION = 2
"""Version of the field file. In version 2 the confidence's points are relative to an origin; files of version 1 are read, too."""

UNITS = {"force": "N/m3", "wind": "m/s"}
"""The unit of each kind of field."""


class ForceField(ABC):
    """A body-force density f(x, t) [N/m³] over T frame intervals; the force of interval t acts from frame t to frame t + 1.

    Args:
        box: (2, 3) lower and upper corner of the region that the field was made for, world metres.
        frames: T, the number of frame intervals.

    Raises:
        UsageError: for a box without volume or beyond `FARTHEST`, a frame rate that no camera has, or no frame.
    """

    representation: ClassVar[str] = ""
    """The name in the file by which the class is found again."""

    kind = "force"
    """force: the values are force densities [N/m³]. wind: they are velocities of the air [m/s], wherever this class says force."""

    confidence: ConfidenceMap | None = None
    """Where the field can be trusted; None: everywhere."""

    def __init__(self, box: np.ndarray, fps: float, frames: int) -> None:
        self.box = np.array(box, dtype=np.float64)
        self.fps, self.frames = float(fps), int(frames)
        if self.box.shape != (2, 3) or not np.isfinite(self.box).all() or (self.box[1] <= self.box[0]).any():
            raise UsageError("A field's box must be two corners (2, 3) in metres, the lower one first.", f"Got {np.asarray(box).tolist()}.")
        if np.abs(self.box).max() > FARTHEST:
            raise UsageError(f"A field's box reaches {in_units(np.abs(self.box).max(), 'm')} from the origin.", "Check the unit: metres.")
        if not FRAME_RATES[0] <= self.fps <= FRAME_RATES[1] or self.frames < 1:
            raise UsageError(
                f"A field needs a camera's frame rate and at least one frame, not {fps} and {frames}.", "Recover it from a longer clip."
            )

    def sample(self, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Force density (M, 3) [N/m³] and confidence (M,) in 0..1 at points (M, 3) [m] during frame interval `frame`.

        Confidence is 0 far from where mass passed, and 1 where the force is well determined.

        Raises:
            UsageError: for a frame outside 0..T-1 or points that are not finite.
        """
        points = self._checked(points, frame)
        return self._force(points, frame), self._confidence(points, frame)

    def gradient(self, points: np.ndarray, frame: int) -> np.ndarray:
        """d f_i / d x_j (M, 3, 3) [N/m⁴] at points (M, 3) [m]. Raises as `sample`."""
        return self._gradient(self._checked(points, frame), frame)

    def away(self, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Distance of points (M, 3) [m] from the filmed object during frame interval `frame`, and its gradient. Raises as `sample`.

        Returns:
            (M,) [m], 0 on the object, and everywhere in a field without a confidence; (M, 3), 0 where the distance is 0.
        """
        return self._away(self._checked(points, frame), frame)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the field as safetensors: arrays, and the metadata that other readers need (box, fps, frames, units, ...).

        Raises:
            TakeError: when the file cannot be written.
        """
        metadata = {
            "representation": self.representation,
            "version": str(VERSION),
            "units": UNITS[self.kind],
            "box": json.dumps(self.box.tolist()),
            "fps": repr(self.fps),
            "frames": str(self.frames),
            **({} if self.kind == "force" else {"kind": self.kind}),
            **({} if self.confidence is None else {"reach": repr(self.confidence.reach)}),
            **self._metadata(),
        }
        tensors = self._tensors() | ({} if self.confidence is None else self.confidence.tensors())
        content = save({key: np.ascontiguousarray(value) for key, value in tensors.items()}, metadata)
        try:
            Path(path).write_bytes(_reproducible(content))
        except OSError as error:
            raise TakeError(f"Cannot write {path}: {error.strerror or error}.", "Free some space or choose another folder.") from error

    @classmethod
    @abstractmethod
    def from_file(cls, tensors: dict[str, np.ndarray], metadata: dict[str, str], box: np.ndarray, fps: float, frames: int) -> Self:
        """The field from a file's tensors and metadata. Raises KeyError or ValueError for what is missing or has a wrong shape."""

    @abstractmethod
    def _force(self, points: np.ndarray, frame: int) -> np.ndarray:
        """Force density (M, 3) [N/m³] at valid points."""

    @abstractmethod
    def _gradient(self, points: np.ndarray, frame: int) -> np.ndarray:
        """d f_i / d x_j (M, 3, 3) [N/m⁴] at valid points."""

    @abstractmethod
    def _tensors(self) -> dict[str, np.ndarray]:
        """Everything that the file must hold besides the confidence."""

    def _metadata(self) -> dict[str, str]:
        """Metadata beyond what every field has."""
        return {}

    def _confidence(self, points: np.ndarray, frame: int) -> np.ndarray:
        """Confidence (M,) at valid points."""
        return np.ones(len(points)) if self.confidence is None else self.confidence.at(points, frame)

    def _away(self, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """See `away`."""
        return (np.zeros(len(points)), np.zeros(points.shape)) if self.confidence is None else self.confidence.away(points, frame)

    def _checked(self, points: np.ndarray, frame: int) -> np.ndarray:
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise UsageError(f"Points must have shape (M, 3), not {points.shape}.", "Give x, y and z of each, in metres.")
        if not np.isfinite(points).all():
            bad = int((~np.isfinite(points).all(axis=1)).sum())
            raise UsageError(f"{bad} of {len(points)} points are not finite.", "Remove them before sampling.")
        if not 0 <= frame < self.frames:
            raise UsageError(f"The field has no frame {frame}.", f"Its frames are 0 to {self.frames - 1}.")
        return points


def _reproducible(content: bytes) -> bytes:
    """The same safetensors file with a sorted header: the library writes metadata in random order, but stamps are hashes of files."""
    size = int.from_bytes(content[:8], "little")
    header = json.dumps(json.loads(content[8 : 8 + size]), sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    return len(header).to_bytes(8, "little") + header + content[8 + size :]
