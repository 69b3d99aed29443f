"""One body on all cores.

    substeps.py   `Body`: frames of substeps, forwards and backwards
    packing.py    its particles as the kernels want them, and back
    frame_run.py  one frame, and what is kept of it
"""

from .substeps import Body

__all__ = ["Body"]
