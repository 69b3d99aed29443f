"""Coarser bodies than in the full result, for a preview.

    solid.py   fewer particles for a mesh
    sheet.py   a sheet with fewer vertices, on which the full one rides
"""

from .sheet import Ridden, coarser_sheet
from .solid import fill_coarser

__all__ = ["Ridden", "fill_coarser", "coarser_sheet"]
