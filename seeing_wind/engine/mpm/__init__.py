"""MLS-MPM: the forward model and its adjoint. NumPy float64 in and out; torch stands above it, in `autograd` only.

    model.py      what stays the same        model_for.py  chosen from bodies and materials     state.py  what changes
    rollout.py    frames of simulation       body.py       one large body on all cores          autograd.py  for torch
    tangent.py    many changes to first order
    checks.py, failure.py  what is refused, and what stopped a run      device.py, precision.py  the compiler's start, types
    laws/  stress from deformation     lattice/  the grid and its boundary     kernels/  the substep
    compiler/  the one door to what compiles laws and kernels
"""

from .model import Model
from .model_for import model_for
from .rollout import BatchRollout, advance, rollout, rollout_batch
from .state import State, Trajectory

__all__ = ["BatchRollout", "Model", "State", "Trajectory", "advance", "model_for", "rollout", "rollout_batch"]
