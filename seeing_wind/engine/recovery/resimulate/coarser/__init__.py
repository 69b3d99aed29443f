"""Less to simulate than in the full result, for a preview.

    solid.py   fewer particles
    sheet.py   a mesh of fewer vertices, and the full one that rides on it
"""

from .sheet import Ridden, coarser_sheet
from .solid import fill_coarser

__all__ = ["Ridden", "fill_coarser", "coarser_sheet"]
