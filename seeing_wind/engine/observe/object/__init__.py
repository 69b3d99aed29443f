"""The object: from an observation to particles, material, surface and key points (paper, section 3.1).

    body.py   the whole stage
    shape/    the object's shape in frame 0: front and back, particles between them, surface, held part
    sheet/    an object without thickness, such as cloth
    motion/   how its points move: key points, their lift to 3D, later tracks, further views

What the object looks like, its Gaussians, is made in `engine/look/`: forces do not depend on it.
"""

from .body import Built, build
from .sheet import SheetBuilt

__all__ = ["Built", "SheetBuilt", "build"]
