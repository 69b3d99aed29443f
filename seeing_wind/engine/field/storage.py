"""Reading fields from files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open

from ..errors import UsageError, WrongTake, clause
from ..reading import LARGEST_ARRAYS, parse_json, regular
from .analytic import ForceFieldAnalytic
from .force_field import UNITS, VERSION, ForceField
from .representations.kplanes import ForceFieldKPlanes
from .representations.lattice import ForceFieldLattice
from .representations.point import ForceFieldPoint
from .representations.triplane import ForceFieldTriPlane

REPRESENTATIONS: dict[str, type[ForceField]] = {
    cls.representation: cls
    for cls in (ForceFieldTriPlane, ForceFieldKPlanes, ForceFieldPoint, ForceFieldAnalytic, ForceFieldLattice)
}
"""Every class that a field file can contain, by its name in the file."""


def load_field(path: str | PathLike[str]) -> ForceField:
    """Read a field written by `ForceField.save`. Nothing in the file can execute code.

    Raises:
        WrongTake: when the file is missing, damaged, incomplete, of another version, or holds numbers that are not finite.
    """
    path = Path(path)
    again = "Run `recover` for this take again."
    if not path.is_file():
        raise WrongTake(f"There is no field at {path}.", "Run `recover` for this take first.")
    try:
        if regular(path) > LARGEST_ARRAYS:
            raise ValueError("it is larger than any field")
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {key: file.get_tensor(key) for key in file.keys()}
        if foreign := [key for key, tensor in tensors.items() if tensor.dtype.isbuiltin != 1]:  # another package has added the type
            raise TypeError(f"{foreign[0]} holds numbers of the type {tensors[foreign[0]].dtype}")
    except (OSError, SafetensorError, ValueError, TypeError, AttributeError, MemoryError) as error:  # AttributeError: types NumPy lacks
        raise WrongTake(f"{path} cannot be read as a field: {clause(error)}.", again) from error
    try:
        name, version, units, kind = metadata["representation"], int(metadata["version"]), metadata["units"], metadata.get("kind", "force")
        if version > VERSION or units != UNITS.get(kind) or name not in REPRESENTATIONS:
            raise ValueError(f"representation {name}, version {version}, kind {kind}, units {units}")
        for key, tensor in tensors.items():
            if not np.isfinite(tensor).all():
                raise ValueError(f"{key} holds numbers that are not finite")
        box, fps, frames = parse_json(metadata["box"]), float(metadata["fps"]), int(metadata["frames"])
        field = REPRESENTATIONS[name].from_file(tensors, metadata, box, fps, frames)
        field.kind = kind
        return field
    except (KeyError, ValueError, TypeError, RuntimeError, OverflowError, UsageError) as error:
        raise WrongTake(f"{path} is not a field that this version can read: {clause(error)}.", again) from error
