"""The base of all learned representations: normalised coordinates in, normalised force out; torch inside, NumPy outside."""

from __future__ import annotations

import json
from typing import Any, ClassVar, Self

import numpy as np
import torch
from torch import nn

from ...reading import parse_json
from ..confidence import ConfidenceMap
from ..force_field import ForceField
from .planes import Stencil

STRONGEST = 1e15
"""Force density [N/m³] beyond which a number must be damaged: the densest matter at a million g needs 2e11."""


class NeuralModule(nn.Module):
    """A representation as a torch module: coordinates in the box, scaled to 0..1, and a frame -> force over the field's scale.

    A query goes through `stencil` (where the point lies in the planes; constant while fitting to fixed points), `latent` and `decoder`.

    Args:
        shape: the constructor's arguments other than `frames`, for the file.
    """

    decoder: nn.Sequential

    def __init__(self, shape: dict[str, Any]) -> None:
        super().__init__()
        self.shape = shape

    def stencil(self, s: torch.Tensor, frame: torch.Tensor) -> Stencil:
        """Coordinates (S, 3) in 0..1 and frames (S,) -> the nodes that each query depends on, and their weights."""
        raise NotImplementedError

    def latent(self, stencil: Stencil, frame: torch.Tensor) -> torch.Tensor:
        """Feature vectors (S, features) that the decoder turns into forces."""
        raise NotImplementedError

    def roughness(self) -> tuple[torch.Tensor, torch.Tensor]:
        """L_space and L_time of Eq. (14), without their factors."""
        raise NotImplementedError

    def rates(self) -> list[dict[str, Any]]:
        """Adam's parameter groups with their learning rates."""
        raise NotImplementedError

    def forward(self, s: torch.Tensor, frame: torch.Tensor) -> torch.Tensor:
        """Normalised force (S, 3)."""
        return self.decoder(self.latent(self.stencil(s, frame), frame))


class ForceFieldNeural(ForceField):
    """A force field whose values come from a `NeuralModule`.

    Args:
        box, fps, frames: as in `ForceField`; points outside the box get the force of the nearest point of the box.
        module: float32 weights; evaluated in double precision.
        scale: force density [N/m³] of a normalised force of one.
        confidence: where the field can be trusted.

    Raises:
        ValueError: for a scale beyond `STRONGEST`; else as `ForceField`.
    """

    module_class: ClassVar[type[NeuralModule]]
    confidence: ConfidenceMap

    def __init__(self, box: np.ndarray, fps: float, frames: int, module: NeuralModule, scale: float, confidence: ConfidenceMap) -> None:
        super().__init__(box, fps, frames)
        self.module = module.double().requires_grad_(False)
        self.scale, self.confidence = float(scale), confidence
        if not abs(self.scale) <= STRONGEST:
            raise ValueError(f"a scale of {scale} N/m³")

    def _force(self, points: np.ndarray, frame: int) -> np.ndarray:
        with torch.no_grad():
            return (self.scale * self.module(self._normalised(points), torch.full((len(points),), frame))).numpy()

    def _gradient(self, points: np.ndarray, frame: int) -> np.ndarray:
        s = self._normalised(points).requires_grad_(True)
        force = self.scale * self.module(s, torch.full((len(points),), frame))
        rows = [torch.autograd.grad(force[:, axis].sum(), s, retain_graph=axis < 2)[0] for axis in range(3)]
        return torch.stack(rows, dim=1).numpy() / (self.box[1] - self.box[0])

    def _normalised(self, points: np.ndarray) -> torch.Tensor:
        return torch.from_numpy((points - self.box[0]) / (self.box[1] - self.box[0]))

    def _tensors(self) -> dict[str, np.ndarray]:
        return {f"module.{key}": value.numpy().astype(np.float32) for key, value in self.module.state_dict().items()}

    def _metadata(self) -> dict[str, str]:
        return {"shape": json.dumps(self.module.shape), "scale": repr(self.scale)}

    @classmethod
    def from_file(cls, tensors: dict[str, np.ndarray], metadata: dict[str, str], box: np.ndarray, fps: float, frames: int) -> Self:
        weights = {key.removeprefix("module."): torch.from_numpy(value) for key, value in tensors.items() if key.startswith("module.")}
        shape = _checked_shape(parse_json(metadata["shape"]), frames, weights, cls.representation == "kplanes")
        module = cls.module_class(frames=frames, **shape)  # type: ignore[call-arg]
        module.load_state_dict(weights)
        confidence = ConfidenceMap.from_file(tensors, metadata)
        return cls(box, fps, frames, module, float(metadata["scale"]), confidence)


def _checked_shape(shape: Any, frames: int, weights: dict[str, torch.Tensor], planes_of_time: bool) -> dict[str, Any]:
    """The constructor's arguments from a file, checked against the number of `weights` that the file has.

    The check comes first, because the module allocates its memory before its weights can be compared with the file's. `planes_of_time`:
    the module also has planes over space and time.

    Raises:
        KeyError, ValueError: for arguments that are missing, invalid, or ask for more weights than there are.
    """
    if not isinstance(shape, dict) or shape.get("degree", 2) not in (1, 2):
        raise ValueError("its shape is not one of this version")
    values = sum(weight.numel() for weight in weights.values())
    for key, value in [("frames", frames), *shape.items()]:
        numbers = np.ravel(value).tolist()
        least, most = 3 if key == "nodes" else 1, len(weights) if key == "hidden" else values
        if len(numbers) > values or not all(isinstance(one, int) and least <= one <= most for one in numbers):
            raise ValueError(f"{key} is {str(value)[:40]}, and it has {values} weights in {len(weights)} tensors")
    features, width, hidden = (shape.get(key, 1) for key in ("features", "width", "hidden"))
    x, y, z = np.array(shape["nodes"], dtype=float).reshape(-1, 3).T
    space, time = float((x * y + x * z + y * z).sum()), float((x + y + z).sum()) * frames
    needed = features * max(space, time if planes_of_time else 0.0, frames, width) + (hidden - 1) * width**2
    if needed > values:
        raise ValueError(f"its shape asks for {needed:.3g} weights, and it has {values}")
    return shape
