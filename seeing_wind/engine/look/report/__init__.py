"""What the user looks at after a recovery: report.json, report.png, overlay.mp4 and resimulated.mp4."""

from .accuracy import field_errors, uniform_errors
from .overlay import write_overlay
from .report import write_report, write_trajectory_report

__all__ = ["field_errors", "uniform_errors", "write_overlay", "write_report", "write_trajectory_report"]
