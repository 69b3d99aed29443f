"""The files that show the user the result of a recovery.

    report.py       report.json, and the order of the products   products.py  making each product independently of the others
    figure.py       report.png                                   footage.py   the clip again, reduced for the videos
    overlay.py      overlay.mp4                                  drawing.py   its arrows and instruments
    resimulated.py  resimulated.mp4                              backdrop.py  its background
    colours.py      colours from weak to strong                  accuracy.py  errors against a known field
"""

from .accuracy import field_errors, uniform_errors
from .overlay import write_overlay
from .report import write_report, write_trajectory_report

__all__ = ["field_errors", "uniform_errors", "write_overlay", "write_report", "write_trajectory_report"]
