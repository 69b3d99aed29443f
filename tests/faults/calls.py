"""The cheapest call of the engine that reads an input."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .seeds import FPS

RECOVER = ["recover", "clip.avi", "--take", "o.take", "--distance", 2, "--iterations", 1, "--representation", "point", "--fps", FPS]
SOLVE = ["recover-trajectories", "t.npz", "--take", "o.take", "--iterations", 1, "--representation", "point"]
SAMPLE = ["sample", "whole.take", "--points", "p.npy", "--frame", 0, "--out", "o.npz"]
EXPORT = ["export", "whole.take", "--format", "npz", "--out", "o.npz"]
SIMULATE = ["resimulate", "whole.take", "--edit", "edit.toml", "--take", "o.take"]
LOOK = ["identify", "clip.avi", "--take", "o.take", "--material-endpoint", "http://127.0.0.1:9/v1", "--material-model", "none"]
"""Reads the clip's first frames, and then finds that nobody answers."""
STOP = ["--camera", "none.json"]
"""Ends a recovery after its clip, depth and mask were read: the solve is not what is tried there."""


def call_for(name: str) -> list[Any]:
    """The cheapest call that reads the file `name`."""
    calls = {
        "camera.json": [*RECOVER, "--mask", "mask.png", "--camera", "camera.json"], "depth.npy": [*RECOVER[:4], "--mask", "mask.png",
        "--depth", "depth.npy", "--fps", FPS, *STOP], "tracks.npz": [*RECOVER, "--mask", "mask.png", "--tracks", "tracks.npz"],
        "t.npz": SOLVE, "p.npy": SAMPLE, "edit.toml": SIMULATE, "mesh.obj": SIMULATE, "mesh.npz": SIMULATE, "pins.npy": SIMULATE,
        "mask.png": [*RECOVER, "--mask", "mask.png", *STOP], "pin.png": [*RECOVER, "--mask", "mask.png", "--pin", "pin.png"],
        "clip.avi": LOOK, "objects.json": [*RECOVER, "--objects", "objects.json"],
    }  # fmt: skip
    return calls[name]


READERS = ("camera.json", "depth.npy", "tracks.npz", "t.npz", "p.npy", "edit.toml", "mesh.npz", "mesh.obj", "pins.npy", "mask.png",
           "pin.png", "clip.avi", "objects.json")  # fmt: skip
ARRAYS = ("tracks.npz", "t.npz", "mesh.npz", "depth.npy", "p.npy", "pins.npy")
TAKE_FILES = ("field.safetensors", "particles.npz", "trajectory.npz")


def _edit_with(folder: Path, mesh: str) -> None:
    text = (folder / "edit.toml").read_text()
    (folder / "edit.toml").write_text(text.replace("mesh.obj", mesh))


def prepared(name: str, folder: Path) -> list[Any]:
    """The call that reads `name`, an edit's mesh made to be it."""
    if name == "mesh.npz":
        _edit_with(folder, name)
    return call_for(name)
