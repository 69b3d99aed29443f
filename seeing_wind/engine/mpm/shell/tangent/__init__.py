"""Tangents of a shell: how its motion changes with whatever loads it, carried forwards beside the motion.

    blocks.py    sparse matrices out of small blocks for each face       faces.py    derivatives of the forces of the faces
    substep.py   the derivative of one substep
"""

from .blocks import Corners
from .faces import FaceSlopes
from .substep import Change, LoadSlopes, Tangent, tangent_of

__all__ = ["Change", "Corners", "FaceSlopes", "LoadSlopes", "Tangent", "tangent_of"]
