"""Force fields f(x, t) [N/m³].

    force_field.py   what every field can do         representations/  the causal tri-plane and others
    analytic.py      known fields                    distillation.py   a recovery's forces as a field
    confidence.py    how well a value is known       sampling.py       values at points, and export
    storage.py       fields from files               torch_threads.py  torch on one thread
    adam.py          a descent that can go on        trilinear.py     values on a lattice
    optimisers.py    torch's, which start sooner
"""

from .analytic import ForceFieldAnalytic
from .distillation import distill
from .force_field import ForceField
from .sampling import distances, export_field, read_points, sample_points
from .storage import load_field

__all__ = [
    "ForceField",
    "ForceFieldAnalytic",
    "distances",
    "distill",
    "export_field",
    "load_field",
    "read_points",
    "sample_points",
]
