"""The wind, or a force of its own, that moved a sheet whose vertices were seen in 3D.

    observed.py  where the sheet was seen              balance.py    the forces on it, as its accelerations tell them
    tension.py   the stress in it, which nobody sees    air.py        what may load it
    problem.py   unknowns, errors, derivative           estimate.py   the most probable field
    valley.py    how well it is known                  stage.py      the stages *recover* and *wind* of a take
    following.py  a simulation that is drawn to it

See docs/reference/wind.md.
"""

from .observed import Observed, observe_sheet
from .stage import SheetSeen, sheet_stage

__all__ = ["Observed", "SheetSeen", "observe_sheet", "sheet_stage"]
