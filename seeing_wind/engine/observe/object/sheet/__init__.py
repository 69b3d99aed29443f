"""A thin sheet: what it is in frame 0, and where it goes, which the tracks and its constant lengths tell.

    mesh.py    its vertices, faces and held part    template.py  what keeps its lengths and resists folds
    riding.py  points that ride on it               view.py      tracks and outline, as one camera saw them
    body.py    the whole of it                      follow.py    where it goes: shape from template
"""

from .body import SheetBuilt, build_sheet, follow_views
from .follow import FEWEST

__all__ = ["FEWEST", "SheetBuilt", "build_sheet", "follow_views"]
