"""MLS-MPM: the forward model and its adjoint. NumPy float64 in and out; the compiler stays inside, torch above it in `autograd` only.

    model.py      what stays the same        model_for.py  chosen from bodies and materials     state.py  what changes
    rollout.py    frames of simulation       body.py       one large body on all cores          autograd.py  for torch
    tangent.py    many changes to first order              frame_run.py   one frame of a body, and what is kept of it
    checks.py     what is refused            failure.py    what stopped a run                   damping.py  what substeps carry
    laws/  stress from deformation     lattice/  the grid and its boundary     kernels/  the substep     compiler/  Quadrants or Taichi
    shell/ thin sheets, which have no grid: a solver of their own
"""

from .model import Model
from .model_for import model_for
from .rollout import BatchRollout, advance, rollout, rollout_batch
from .state import State, Trajectory

__all__ = ["BatchRollout", "Model", "State", "Trajectory", "advance", "model_for", "rollout", "rollout_batch"]
