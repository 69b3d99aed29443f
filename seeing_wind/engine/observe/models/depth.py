"""Metric depth of frame 0 from a network: Depth Anything V2 (metric), Depth Pro, UniDepth (the paper's, section 3.1)."""

from __future__ import annotations

import contextlib
import importlib
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from ...errors import ModelError, WrongModel, extra
from ...progress import Progress
from ...reading import read_json
from .catalogue import known
from .folders import config_of, find, load, load_plain, package

IMAGENET = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
HALF = ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))

TRANSFORMERS = f"Install it: {extra('models')}."

ODD_VIEW = 1.15
"""Ratio between the focal length that a network estimates and the camera's from which the user is warned."""


def predict_depth(name: str, frame: np.ndarray, focal: float, progress: Progress) -> np.ndarray:
    """Depth (H, W) float32 [m] along the view axis of `frame` (H, W, 3) uint8 RGB.

    Args:
        name: a model's folder, or its name in the hub's cache.
        focal: the camera's focal length [px].

    Raises:
        WrongModel: no such model, wrong files, or a model of relative depth. ModelError: a depth that is not positive and finite.
        MissingPackage: a package that the model needs is not installed.
    """
    progress.begin("observe", f"depth by {name}")
    folder = find(name, "depth")
    config = config_of(folder)
    kind = config.get("model_type")
    with torch.inference_mode():
        if kind == "depth_anything":
            depth = _depth_anything(folder, config, frame)
        elif kind == "depth_pro":
            depth = _depth_pro(folder, config, frame, focal, progress)
        elif str(config.get("model", {}).get("name", "") if isinstance(config.get("model"), dict) else "").startswith("UniDepth"):
            depth = _unidepth(folder, config, frame, focal)
        else:
            raise WrongModel(
                f"The folder {folder} holds a {kind or 'nameless'} model, which gives no metric depth here.",
                "Known: Depth Anything V2 (metric), Depth Pro, UniDepth V2.",
            )
    progress.check()
    if not (np.isfinite(depth) & (depth > 0)).all():
        raise ModelError(f"The depth by {name} is not positive and finite everywhere.", "Use another model, or give --distance.")
    return depth.astype(np.float32)


def network_input(frame: np.ndarray, width: int, height: int, folder: Path, default: Any) -> torch.Tensor:
    """`frame` (H, W, 3) uint8 as a network's input (1, 3, height, width) float32, normalised by the mean and standard deviation in the
    folder's `preprocessor_config.json`, or else by `default`."""
    mean, deviation = default
    place = folder / "preprocessor_config.json"
    if place.is_file():
        try:
            values = read_json(place)
            mean, deviation = values.get("image_mean", mean), values.get("image_std", deviation)
        except (OSError, ValueError, AttributeError) as error:
            raise WrongModel(f"{place} cannot be read ({error}).", "Copy all files of the model.") from error
    shrinks = width * height < frame.shape[0] * frame.shape[1]
    small = cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC).astype(np.float32) / 255.0
    return torch.from_numpy(((small - np.float32(mean)) / np.float32(deviation)).transpose(2, 0, 1)[None].copy())


def _upsample(values: torch.Tensor, frame: np.ndarray) -> np.ndarray:
    return cv2.resize(values.float().numpy(), frame.shape[1::-1], interpolation=cv2.INTER_LINEAR)


def _depth_anything(folder: Path, config: dict[str, Any], frame: np.ndarray) -> np.ndarray:
    if config.get("depth_estimation_type") != "metric":
        raise WrongModel(f"{folder} gives relative depth, which has no scale.", "Use a Metric-Indoor or Metric-Outdoor version of it.")
    kind = package("transformers", TRANSFORMERS).DepthAnythingForDepthEstimation
    model = load(kind, folder, "Depth-Anything-V2-Metric")
    # The authors' size: 518 along the shorter side, and both sides multiples of the patch.
    patch, side = int(config.get("patch_size", 14)), int(model.config.backbone_config.image_size)
    scale = side / min(frame.shape[:2])
    width, height = (max(patch, round(length * scale / patch) * patch) for length in frame.shape[1::-1])
    return _upsample(model(pixel_values=network_input(frame, width, height, folder, IMAGENET)).predicted_depth[0], frame)


def _depth_pro(folder: Path, config: dict[str, Any], frame: np.ndarray, focal: float, progress: Progress) -> np.ndarray:
    model = load(package("transformers", TRANSFORMERS).DepthProForDepthEstimation, folder, "apple/DepthPro-hf")
    side = _depth_pro_side(config)
    found = model(pixel_values=network_input(frame, side, side, folder, HALF))
    width = frame.shape[1]
    if found.field_of_view is not None:
        seen = 0.5 * width / np.tan(0.5 * np.radians(float(found.field_of_view.ravel()[0])))
        if np.isfinite(seen) and seen > 0 and not 1 / ODD_VIEW < seen / focal < ODD_VIEW:
            angles = [float(np.degrees(2 * np.arctan(0.5 * width / one))) for one in (seen, focal)]
            progress.warn(f"Depth Pro sees a field of view of {angles[0]:.0f} degrees, the camera says {angles[1]:.0f}: check --fov.")
    # The network's output is canonical inverse depth: 1 / depth = output * width / focal (Bochkovskii et al. 2024, Eq. 1).
    inverse = _upsample(found.predicted_depth[0], frame) * width / focal
    return 1.0 / np.clip(inverse, 1e-4, 1e4)


def _depth_pro_side(config: dict[str, Any]) -> int:
    """Side [px] of the square frame that Depth Pro takes: 1536 in the published model."""
    ratios = config.get("scaled_images_ratios") or [0.25, 0.5, 1]
    return round(int(config.get("patch_size", 384)) / min(ratios))


def _unidepth(folder: Path, config: dict[str, Any], frame: np.ndarray, focal: float) -> np.ndarray:
    entry = known("lpiccinelli/unidepth-v2-vits14")
    # The output of the authors' code must not get among the engine's messages.
    with contextlib.redirect_stdout(sys.stderr):
        package("unidepth", entry.how if entry else "")
        kind = getattr(importlib.import_module("unidepth.models"), str(config["model"]["name"]), None)
        if kind is None:
            raise ModelError(f"The installed unidepth has no {config['model']['name']}.", "Update it.")
        model = load_plain(kind(config), folder, "lpiccinelli/unidepth-v2-vits14")
        height, width = frame.shape[:2]
        intrinsics = torch.tensor([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])
        found = model.infer(torch.from_numpy(frame.transpose(2, 0, 1).copy()), intrinsics)
    return found["depth"].float().numpy().reshape(height, width)
