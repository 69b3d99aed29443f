"""Force fields f(x, t) [N/m³]: representations, distilling a recovery into one, confidence, sampling and export."""

from .analytic import ForceFieldAnalytic, GustField, UniformField
from .distillation import distill
from .force_field import ForceField
from .sampling import export_field, sample_file, sample_points
from .storage import load_field

__all__ = [
    "ForceField",
    "ForceFieldAnalytic",
    "GustField",
    "UniformField",
    "distill",
    "export_field",
    "load_field",
    "sample_file",
    "sample_points",
]
