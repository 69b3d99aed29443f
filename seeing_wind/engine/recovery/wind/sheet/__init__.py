"""The wind, or the force without a drag law, that moved a sheet whose vertices were seen in 3D.

    observed.py     where the sheet was seen                  balance.py    the balance of forces on the sheet
    tension.py      the hidden stress in the sheet            air.py        the loads that the field can be: air or a plain force
    problem.py      unknowns, errors, derivatives             estimate.py   the most probable field
    learning.py     what is learnt by evidence                valley.py     the field's uncertainty
    attenuation.py  what errors of a path do to the wind      following.py  a simulation pulled towards what was seen
    stage.py        the stages *recover* and *wind* of a take

See docs/reference/wind.md.
"""

from .observed import Observed, observe_sheet
from .stage import SheetSeen, sheet_stage

__all__ = ["Observed", "SheetSeen", "observe_sheet", "sheet_stage"]
