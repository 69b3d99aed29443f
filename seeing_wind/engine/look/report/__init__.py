"""What the user looks at after a recovery.

    report.py       report.json, and the order of the rest       products.py  each product apart from the others
    figure.py       report.png                                   footage.py   the clip once more, small
    overlay.py      overlay.mp4                                  drawing.py   its arrows and instruments
    resimulated.py  resimulated.mp4                              backdrop.py  its clean plate
    colours.py      from weak to strong                          accuracy.py  errors against a known field
"""

from .accuracy import field_errors, uniform_errors
from .overlay import write_overlay
from .report import write_report, write_trajectory_report

__all__ = ["field_errors", "uniform_errors", "write_overlay", "write_report", "write_trajectory_report"]
