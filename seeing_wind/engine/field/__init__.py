"""Force fields f(x, t) [N/m³].

    force_field.py   the interface of every field    representations/  the causal tri-plane and others
    analytic.py      fields in closed form           distillation.py   a field fitted to a recovery's forces
    confidence.py    how well a value is known       sampling.py       values at points, and export
    storage.py       fields from files               torch_threads.py  torch on one thread
    adam.py          Adam that can be resumed        trilinear.py      interpolation on a lattice
    optimisers.py    torch's optimisers without its compiler
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
