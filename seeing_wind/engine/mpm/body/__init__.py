"""One body on all cores, or copies of it on a core each.

    substeps.py   `Body`: frames of substeps, forwards and backwards
    copies_run.py `CopiesRun`: a frame of many copies, or of one with every substep kept
    packing.py    its particles as the kernels want them, and back
    columns.py    small changes of its state that are carried along
    frame_run.py  one frame, and what is kept of it
"""

from .substeps import Body

__all__ = ["Body"]
