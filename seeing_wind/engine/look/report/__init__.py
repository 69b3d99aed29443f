"""What the user looks at after a recovery.

    report.py       report.json, and the order of the rest       figure.py   report.png
    overlay.py      overlay.mp4 (arrows.py, dials.py, colours.py)
    resimulated.py  resimulated.mp4, over a clean plate (backdrop.py)
    video.py        writing MP4                                  accuracy.py errors against a known field
"""

from .accuracy import field_errors, uniform_errors
from .overlay import write_overlay
from .report import write_report, write_trajectory_report

__all__ = ["field_errors", "uniform_errors", "write_overlay", "write_report", "write_trajectory_report"]
