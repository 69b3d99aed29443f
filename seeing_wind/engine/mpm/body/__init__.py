"""One body on all cores, or copies of it, each on one core.

    substeps.py   `Body`: frames of substeps, forwards and backwards
    copies_run.py `CopiesRun`: a frame of many copies, or of one body with every substep kept
    packing.py    the particles in the layout of the kernels, and back
    columns.py    small changes of the body's state that are carried along
    frame_run.py  the inputs of one frame, and the states kept of it
"""

from .substeps import Body

__all__ = ["Body"]
