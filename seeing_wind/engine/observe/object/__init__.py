"""The object: from an observation to particles, material, surface and key points (paper, section 3.1).

    body.py   the whole of it
    shape/    what the object is in frame 0: front and back, particles between them, surface, held part
    sheet/    an object without thickness, such as cloth
    motion/   where its points go: key points, their lift to 3D, later tracks, further views

What the object looks like, its Gaussians, is `engine/look/`: forces do not depend on it.
"""

from .body import Built, build
from .sheet import SheetBuilt

__all__ = ["Built", "SheetBuilt", "build"]
