"""What is installed, what works, and what to do about the rest."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import os
import platform
import sys
from collections.abc import Callable
from typing import Any

from ..errors import extra

REQUIRED = ("numpy", "scipy", "torch", "opencv-python-headless", "safetensors", "trimesh", "matplotlib")
"""Required packages, apart from the solver's compiler, which the check *solver* tries."""
OPTIONAL = {"transformers": f"Optional perception models: {extra('models')}."}


def examine() -> list[dict[str, Any]]:
    """One mapping per check: name, ok, detail and, if the check failed and something can be done, advice."""
    checks = [
        {
            "name": "python",
            "ok": sys.version_info >= (3, 11),
            "detail": f"{platform.python_version()} {platform.machine()} {platform.system()}",
        }
    ]
    checks += [_package(name, "Run Install Engine, or `make setup`.") for name in REQUIRED]
    checks += [{**_package(name, advice), "optional": True} for name, advice in OPTIONAL.items()]
    checks += optional_models()
    for name, check in (("solver", _solver), ("torch", _torch), ("clarabel", _clarabel), ("video codec", _codec)):
        checks.append(_attempt(name, check))
    return checks


def _package(name: str, advice: str) -> dict[str, Any]:
    try:
        return {"name": name, "ok": True, "detail": importlib.metadata.version(name)}
    except importlib.metadata.PackageNotFoundError:
        return {"name": name, "ok": False, "detail": "not installed", "advice": advice}


def optional_models() -> list[dict[str, Any]]:
    """Checks of the optional models: whether the hub's cache has them and the packages that they need, and their licences."""
    from ..observe.models.catalogue import KNOWN, cached
    from ..settings.observe import installed_network

    checks = []
    for entry in KNOWN:
        installed = importlib.util.find_spec(entry.package) is not None
        outlines = entry.task == "outline"
        folder = None if outlines else cached(entry.name)
        there = os.path.exists(installed_network() or "") if outlines else folder is not None and any(folder.glob("*.safetensors"))
        licence = entry.licence + ("" if entry.commercial else ", no commercial use")
        lacks = [] if installed else [f"package {entry.package} is not installed"]
        lacks += [] if there else ["not installed" if outlines else "no safetensors in the hub's cache"]
        detail = f"{licence}; {' and '.join(lacks) or 'ready'}"
        check = {"name": f"{entry.task} model {entry.name}", "ok": installed and there, "detail": detail, "optional": True}
        checks.append(check if check["ok"] else {**check, "advice": entry.how})
    return checks


def _attempt(name: str, check: Callable[[], str]) -> dict[str, Any]:
    try:
        return {"name": name, "ok": True, "detail": check()}
    except Exception as error:  # whatever fails is the result of the check
        return {"name": name, "ok": False, "detail": f"{type(error).__name__}: {error}", "advice": "Run Install Engine again."}


def _clarabel() -> str:
    import clarabel

    return str(clarabel.__version__)


def _solver() -> str:
    """Simulate the free fall of eight particles, and measure the solver's speed, from which a preview estimates the time of a solve."""
    import numpy as np

    from ..materials import find
    from ..mpm.compiler import NAME
    from ..mpm.model_for import model_for
    from ..mpm.rollout import advance
    from ..mpm.state import State
    from ..records import Particles
    from ..recovery.cost import measure_speed

    x = np.stack(np.meshgrid(*[[0.0, 0.01]] * 3, indexing="ij"), -1).reshape(-1, 3)
    model, _ = model_for(Particles(x, np.full(8, 1e-6), np.zeros(8, dtype=bool), 0.01), find("leaf"), fps=30.0, gravity=(0.0, 0.0, -9.81))
    fallen = advance(model, State.at_rest(x), np.zeros((8, 3))).v[:, 2].mean()
    if not abs(fallen + 9.81 / 30.0) < 1e-6:
        raise ArithmeticError(f"eight particles fall at {fallen} m/s after a frame instead of {-9.81 / 30.0}")
    speed = measure_speed(plastic=False)
    return f"runs on the CPU, compiled by {NAME}, {1e-6 / speed.copy:.1f} million substeps of a particle a second"


def _torch() -> str:
    import torch

    return f"CUDA on {torch.cuda.get_device_name(0)}" if torch.cuda.is_available() else "CPU only"


def _codec() -> str:
    import cv2

    formats = [line.strip() for line in cv2.getBuildInformation().splitlines() if "FFMPEG" in line or "avcodec" in line]
    if not formats:
        raise RuntimeError("this OpenCV cannot read video")
    return ", ".join(" ".join(line.split()) for line in formats)
