"""Whether this build of Blender writes OpenVDB files. Without NumPy: the menu of Export Field asks before anything is written."""

from __future__ import annotations

import importlib.util


def available() -> bool:
    """Whether there is an OpenVDB for Python: in Blender's own builds, not in the `bpy` wheels."""
    return importlib.util.find_spec("openvdb") is not None
