"""The object from words, as in the paper: Grounding DINO gives a box, and SAM 2 the mask in it, which it follows through the clip."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from ...errors import ObjectError, WrongModel
from ...progress import Progress
from ..clip.stored import Frames
from .depth import IMAGENET, TRANSFORMERS, network_input
from .folders import config_of, find, load, package, quiet

LEAST_SCORE = 0.25
"""Confidence from which a box counts as found; the value in the authors' demo."""

SHORT_SIDE, LONG_SIDE = 800, 1333
"""Size to which frames are scaled for Grounding DINO [px]: that of the shorter side, unless the longer side would exceed LONG_SIDE."""

ONE = 1
"""The number of the only object in a SAM 2 session."""


def find_box(name: str, text: str, frame: np.ndarray, progress: Progress) -> tuple[float, float, float, float]:
    """The most certain box x0 y0 x1 y1 [px] in `frame` (H, W, 3) uint8 RGB of what `text` describes.

    Raises:
        WrongModel: no such model or wrong files. ObjectError: nothing in the frame matches. MissingPackage: transformers is missing.
    """
    progress.begin("observe", f"looking for '{text}'")
    folder = find(name, "detector")
    _want(folder, "grounding-dino", "Grounding DINO")
    transformers = package("transformers", TRANSFORMERS)
    model = load(transformers.GroundingDinoForObjectDetection, folder, "IDEA-Research/grounding-dino-tiny")
    # The model was trained on phrases in lower case that end with a full stop.
    phrase = text.strip().lower().rstrip(".") + "."
    try:
        with quiet():
            words = transformers.AutoTokenizer.from_pretrained(folder, local_files_only=True)(phrase, return_tensors="pt")
    except (OSError, ValueError) as error:
        raise WrongModel(f"The tokenizer in {folder} cannot be loaded.", "Copy all files of the model.") from error
    height, width = frame.shape[:2]
    scale = min(SHORT_SIDE / min(height, width), LONG_SIDE / max(height, width))
    pixels = network_input(frame, round(width * scale), round(height * scale), folder, IMAGENET)
    with torch.inference_mode():
        found = model(pixel_values=pixels, **words)
    progress.check()
    score = torch.sigmoid(found.logits[0]).amax(dim=-1)
    best = int(score.argmax())
    if not float(score[best]) > LEAST_SCORE:
        raise ObjectError(
            f"Nothing in the first frame looks like '{text}' (best {float(score[best]):.2f}).", "Use other words, or draw a --box."
        )
    x, y, w, h = (float(value) for value in found.pred_boxes[0, best])
    box = np.array([(x - w / 2) * width, (y - h / 2) * height, (x + w / 2) * width, (y + h / 2) * height]) - 0.5
    x0, y0, x1, y1 = np.clip(box, 0.0, [width - 1, height - 1, width - 1, height - 1])
    return float(x0), float(y0), float(x1), float(y1)


class MaskModel:
    """SAM 2 over one clip: a mask in frame 0 from a box or from another mask, then frame by frame."""

    def __init__(self, name: str) -> None:
        """Load the model.

        Raises:
            WrongModel: no such model or wrong files. MissingPackage: transformers is missing.
        """
        self._folder = find(name, "mask")
        _want(self._folder, "sam2_video", "SAM 2")
        self._package = package("transformers", TRANSFORMERS)
        self._model = load(self._package.Sam2VideoModel, self._folder, "facebook/sam2.1-hiera-tiny")
        side = self._model.config.image_size
        self._side = int(side[0]) if isinstance(side, (list, tuple)) else int(side)
        self._session: Any = None

    def in_box(self, frame: np.ndarray, box: tuple[float, float, float, float]) -> np.ndarray:
        """The mask (H, W) bool of the object in `box` (x0 y0 x1 y1 [px]) of `frame` (H, W, 3) uint8 RGB; starts a new clip with it."""
        return self._prompt(frame, np.array(box).reshape(2, 2), [2, 3])

    def at_points(self, frame: np.ndarray, points: np.ndarray) -> np.ndarray:
        """The mask (H, W) bool of the object at `points` (P, 2) [px] of `frame` (H, W, 3) uint8 RGB; starts a new clip with it."""
        return self._prompt(frame, points, [1] * len(points))

    def _prompt(self, frame: np.ndarray, points: np.ndarray, labels: list[int]) -> np.ndarray:
        """The mask (H, W) bool for `points` (P, 2) [px]; `labels`: 1 for a point on the object, 2 and 3 for corners of a box round it."""
        height, width = self._start(frame)
        # Pixel centres are at integers here, at halves in the network's coordinates.
        scale = torch.tensor([self._side / width, self._side / height])
        places = (torch.from_numpy(np.asarray(points, dtype=np.float32)) + 0.5) * scale
        prompt = {"point_coords": places[None, None], "point_labels": torch.tensor([[labels]], dtype=torch.int32)}
        self._session.add_point_inputs(self._session.obj_id_to_idx(ONE), 0, prompt)
        self._session.obj_with_new_inputs = [ONE]
        return self._next(frame)

    def follow(self, frames: Frames, mask: np.ndarray, progress: Progress) -> Iterator[np.ndarray]:
        """The masks (H, W) bool of frames 1 to T of `frames` (T+1, H, W, 3) uint8 RGB, one by one, from `mask` (H, W) bool in frame 0."""
        self._start(frames[0])
        given = cv2.resize(mask.astype(np.float32), (self._side, self._side), interpolation=cv2.INTER_AREA) >= 0.5
        self._session.add_mask_inputs(self._session.obj_id_to_idx(ONE), 0, torch.from_numpy(given.astype(np.float32))[None, None])
        self._session.obj_with_new_inputs = [ONE]
        self._next(frames[0])
        for t in range(1, len(frames)):
            progress.check()
            yield self._next(frames[t])

    def _start(self, frame: np.ndarray) -> tuple[int, int]:
        from transformers.models.sam2_video.modeling_sam2_video import Sam2VideoInferenceSession

        height, width = frame.shape[:2]
        self._session = Sam2VideoInferenceSession(video_height=height, video_width=width, dtype=torch.float32)
        return height, width

    def _next(self, frame: np.ndarray) -> np.ndarray:
        pixels = network_input(frame, self._side, self._side, self._folder, IMAGENET)[0]
        with torch.inference_mode():
            found = self._model(self._session, frame=pixels)
        # The session's memories keep what was seen; the frame itself, 12 MB, is not needed any more.
        self._session.processed_frames[found.frame_idx] = torch.empty(0)
        height, width = frame.shape[:2]
        return cv2.resize(found.pred_masks[0, 0].float().numpy(), (width, height), interpolation=cv2.INTER_LINEAR) > 0.0


def _want(folder: Path, kind: str, name: str) -> None:
    found = config_of(folder).get("model_type")
    if found != kind:
        raise WrongModel(f"The folder {folder} holds a {found or 'nameless'} model, not {name}.", f"Give a folder of {name}.")
