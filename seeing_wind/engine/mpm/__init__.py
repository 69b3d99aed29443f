"""MLS-MPM: the forward model and its adjoint. NumPy float64 in and out; Taichi stays inside, torch above it in `autograd` only."""

import os

# Taichi prints its version on import, to stdout, where the worker's messages go, and asks a server for a newer one when it starts.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")

from .model import Model  # noqa: E402
from .model_for import model_for  # noqa: E402
from .rollout import BatchRollout, advance, rollout, rollout_batch  # noqa: E402
from .state import State, Trajectory  # noqa: E402

__all__ = ["BatchRollout", "Model", "State", "Trajectory", "advance", "model_for", "rollout", "rollout_batch"]
