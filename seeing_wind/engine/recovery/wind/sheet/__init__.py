"""The wind, or a force of its own, that moved a sheet whose vertices were seen in 3D.

    observed.py   where the sheet was seen               following.py  a simulation that is drawn to it
    air.py        what may load it                       problem.py    unknowns, what is compared, its derivative
    start.py      a first wind                           estimate.py   the most probable field
    stage.py      the stages *recover* and *wind* of a take

See docs/reference/wind.md.
"""

from .observed import Observed, observed
from .stage import SheetSeen, sheet_stage

__all__ = ["Observed", "SheetSeen", "observed", "sheet_stage"]
