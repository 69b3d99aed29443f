"""MLS-MPM: the forward model and its adjoint. NumPy float64 in and out; Taichi stays inside, torch above it in `autograd` only.

    model.py      what stays the same        model_for.py  chosen from bodies and materials     state.py  what changes
    rollout.py    frames of simulation       body.py       one large body on all cores          autograd.py  for torch
    tangent.py    many changes to first order
    checks.py, failure.py  what is refused, and what stopped a run      device.py, precision.py  Taichi's start and types
    laws/  stress from deformation     lattice/  the grid and its boundary     kernels/  the substep
"""

import os

# Taichi prints its version on import, to stdout, where the worker's messages go, and asks a server for a newer one when it starts.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")

from .model import Model  # noqa: E402
from .model_for import model_for  # noqa: E402
from .rollout import BatchRollout, advance, rollout, rollout_batch  # noqa: E402
from .state import State, Trajectory  # noqa: E402

__all__ = ["BatchRollout", "Model", "State", "Trajectory", "advance", "model_for", "rollout", "rollout_batch"]
