"""A thin sheet: its mesh in frame 0, and its path through the clip, estimated from the tracks and its constant lengths.

    mesh.py      its vertices, faces and held part    template.py  the costs of stretching, shortening and bending
    riding.py    points that ride on it               view.py      tracks and outline, as one camera saw them
    body.py      the whole stage                      follow.py    its path: shape from template
    frame.py     its shape in one frame               banded.py    the linear systems of that
    farthest.py  the farthest shape: another start
"""

from .body import SheetBuilt, build_sheet, follow_views
from .follow import FEWEST, too_few

__all__ = ["FEWEST", "SheetBuilt", "build_sheet", "follow_views", "too_few"]
