"""A thin sheet: what it is in frame 0, and where it goes, which the tracks and its constant lengths tell.

    mesh.py      its vertices, faces and held part    template.py  what keeps its lengths and resists folds
    riding.py    points that ride on it               follow.py    where it goes: shape from template
    body.py      the whole of it
"""

from .body import SheetBuilt, build_sheet, followed_together
from .follow import FEWEST

__all__ = ["FEWEST", "SheetBuilt", "build_sheet", "followed_together"]
